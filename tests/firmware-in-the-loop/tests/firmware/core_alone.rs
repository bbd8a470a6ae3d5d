//! What the core alone takes (`firmware/examples/core_alone.rs`): flash, RAM, stack, and instructions for a frame
//! through the pump, in the profile that is flashed.

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::machine::Machine;
use firmware_in_the_loop::part::Connections;
use firmware_in_the_loop::stack;

use super::budgets::{KIB, kib, print};

/// One CANopen valve: code and constants.
const FLASH: u64 = 30 * KIB;
/// Its variables.
const RAM: u64 = 1536;
/// Its stack at the deepest: as the device starts from an image of the memory, which lies on the stack.
const STACK: u64 = 2300;
/// Long enough for all rows, in nanoseconds.
const RUN: u64 = 50_000_000;

/// The rows in their order, each with the most instructions that it may take. The comments have those of CANopenNode -Os:
/// the calls that the frame needs, and its whole millisecond (docs/board.md).
const ROWS: [(&str, u64); 7] = [
    ("SDO upload", 570),   // 682, 908
    ("SDO download", 730), // 616, 842
    ("for nobody", 50),    // 71
    ("nothing due", 20),   // 451 in its millisecond
    ("nothing due, pumped", 205),
    ("RPDO -> TPDO", 745),  // 539, 767
    ("new set-point", 820), // 539, 767, without an actuator
];

#[test]
fn core_alone() {
    let image = Image::example(NUCLEO_F429ZI.profile, "core_alone");
    let symbols = image.symbols();
    let mut machine = Machine::power_on(image, Connections::default());
    stack::paint(&machine);
    let done = symbols.address("row_is_done").expect("the end of a row");
    machine.watch(done);
    for row in symbols.functions(&["row_of_"]) {
        machine.watch(row.address);
    }
    machine.start(RUN);
    machine.wait();
    let arrivals = machine.arrivals();
    // What lies between two rows goes the same ways: only the last arrival before the end of a row is its own.
    let counts = arrivals.windows(2).filter(|pair| pair[1].address == done);
    let counts: Vec<u64> = counts.map(|pair| pair[1].instructions - pair[0].instructions).collect();
    assert_eq!(counts.len(), ROWS.len());
    for ((row, limit), count) in ROWS.iter().zip(&counts) {
        print(&format!("{row:<24} {count:>6} instructions of {limit}"));
    }
    let (size, stack) = (symbols.total(), stack::used(&machine));
    print(&format!("the core alone: flash {}, RAM {}, stack {stack} bytes", kib(size.flash), size.ram));
    for ((row, limit), count) in ROWS.iter().zip(&counts) {
        assert!(count <= limit, "{row}: {count} instructions");
    }
    assert!(size.flash <= FLASH && size.ram <= RAM && stack <= STACK, "{size:?}, stack {stack}");
}
