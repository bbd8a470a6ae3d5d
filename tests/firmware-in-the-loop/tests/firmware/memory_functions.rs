//! What the compiler calls to copy and fill memory (`firmware/examples/memory_functions.rs` tries it).

use firmware_in_the_loop::board::NUCLEO_F429ZI;
use firmware_in_the_loop::image::Image;
use firmware_in_the_loop::machine::Machine;
use firmware_in_the_loop::part::Connections;

/// Long enough for all of it, in nanoseconds.
const RUN: u64 = 1_000_000_000;

#[test]
fn copies_and_fillings_are_right_in_all_alignments_and_overlaps() {
    let image = Image::example(NUCLEO_F429ZI.profile, "memory_functions");
    let address = |name: &str| image.symbols().address(name).expect(name);
    let (right, wrong) = (address("all_is_right"), address("wrong"));
    let mut machine = Machine::power_on(image, Connections::default());
    machine.watch(right);
    machine.watch(wrong);
    machine.start(RUN);
    machine.wait();
    let ends: Vec<u64> = machine.arrivals().iter().map(|arrival| arrival.address).collect();
    assert_eq!(ends, [right]);
}
