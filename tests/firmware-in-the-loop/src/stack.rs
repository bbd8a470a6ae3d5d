//! The depth of the stack. RAM without a variable is painted before the first instruction and examined later.

use std::ops::Range;

use crate::machine::Machine;

const PAINT: u8 = 0xA5;
/// The number of painted bytes in a row that were never used. It exceeds every local variable that is never written.
const UNUSED: usize = 4096;

/// Returns the RAM between the last variable and the top of the stack.
///
/// # Panics
/// Panics if the image has no stack there.
fn room(machine: &Machine) -> Range<u64> {
    let (symbols, ram) = (machine.image().symbols(), &machine.image().board().ram);
    let top = symbols.address("_stack_start").expect("the image has a stack");
    let ends = ["__ebss", "__euninit", "__edata"].iter().filter_map(|name| symbols.address(name));
    let end = ends.filter(|end| ram.contains(end)).max().expect("the image has variables");
    assert!(end < top && top <= ram.end, "the stack is between {end:#x} and {top:#x}");
    end..top
}

/// Paints the stack of a board before its first instruction.
pub fn paint(machine: &Machine) {
    let room = room(machine);
    machine.write(room.start, &vec![PAINT; (room.end - room.start) as usize]);
}

/// Returns the largest number of used bytes of the stack since it was painted.
///
/// # Panics
/// Panics if the entire stack was used.
#[must_use]
pub fn used(machine: &Machine) -> u64 {
    let bytes = machine.read(room(machine));
    let mut painted = 0;
    // From the top down: gaps between two used positions count as used.
    for (below, byte) in bytes.iter().rev().enumerate() {
        painted = if *byte == PAINT { painted + 1 } else { 0 };
        if painted == UNUSED {
            return (below + 1 - UNUSED) as u64;
        }
    }
    panic!("the stack was used to its end");
}
