//! The image, broken in flash while it runs: a function that hangs, returns, panics or faults at its next call.
//!
//! The change stays over a reset, as in a flash. It must be mended before the restarted image reaches the function.

use crate::machine::Machine;

/// The way in which a function is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Break {
    /// The function never returns: it jumps to itself.
    Hang,
    /// The function returns at once.
    Return,
    /// The function calls the panic of an `assert!`.
    Panic,
    /// The function executes an undefined instruction.
    Fault,
}

/// The code in the place of the break.
#[derive(Clone, Debug)]
pub struct Mended {
    address: u64,
    bytes: Vec<u8>,
}

/// The functions that panic. They receive in r0 to r2 a message, its length and the position in the source. The first
/// of them can receive the position alone.
const WITH_MESSAGE: [&str; 2] = ["core::panicking::panic", "core::option::expect_failed"];
const WITH_PLACE: [&str; 2] = ["core::option::unwrap_failed", "core::panicking::panic_const::"];

/// The distance from the end of the flash to the arguments of a panic. No image reaches so far.
const NOTES: u64 = 64;
const MESSAGE: &[u8; 20] = b"broken on purpose\0\0\0";

impl Break {
    /// Breaks the first function of the image whose path contains one of `names`.
    ///
    /// # Panics
    /// Panics without such a function, and if the image has no panic to call.
    #[must_use]
    pub fn apply(self, machine: &Machine, names: &[&str]) -> Mended {
        let symbols = machine.image().symbols();
        let found = symbols.functions(names);
        let address = found.first().unwrap_or_else(|| panic!("the image has none of {names:?}")).address;
        let code = match self {
            Self::Hang => 0xE7FE_u16.to_le_bytes().to_vec(),
            Self::Return => 0x4770_u16.to_le_bytes().to_vec(),
            Self::Fault => 0xDE00_u16.to_le_bytes().to_vec(),
            Self::Panic => call_of_panic(machine, address),
        };
        let bytes = machine.read(address..address + code.len() as u64);
        machine.write(address, &code);
        Mended { address, bytes }
    }
}

impl Mended {
    /// Restores the image.
    pub fn mend(self, machine: &Machine) {
        machine.write(self.address, &self.bytes);
    }
}

/// Returns code for `address` that calls a panic. The arguments of the panic are stored elsewhere.
fn call_of_panic(machine: &Machine, address: u64) -> Vec<u8> {
    let symbols = machine.image().symbols();
    // A name is the entire path or its beginning, as the entry says.
    let find = |names: &[&str]| {
        let is = |found: &str, name: &str| found == name || name.ends_with("::") && found.starts_with(name);
        names.iter().find_map(|name| symbols.functions(&[name]).into_iter().find(|symbol| is(&symbol.name, name)))
    };
    let notes = machine.image().board().flash.end - NOTES;
    let place = notes + MESSAGE.len() as u64;
    machine.write(notes, MESSAGE);
    // The position in the source: file, its length, line, column.
    let words = [notes as u32, 6, 7, 8].map(u32::to_le_bytes).concat();
    machine.write(place, &words);
    let (target, given) = match (find(&WITH_MESSAGE), find(&WITH_PLACE)) {
        (Some(panic), _) => (panic.address, [notes as u32, 17, place as u32]),
        (None, Some(panic)) => (panic.address, [place as u32, 0, 0]),
        (None, None) => panic!("nothing in the image panics"),
    };
    let mut code: Vec<u8> = (0..).zip(given).flat_map(|(register, value)| load(register, value)).collect();
    code.extend(branch(address + code.len() as u64, target));
    code
}

/// Encodes `movw` and `movt` of a value into a register (ARMv7-M, A7.7.76 and A7.7.79).
fn load(register: u32, value: u32) -> Vec<u8> {
    let half = |opcode: u32, value: u32| {
        let (imm4, i, imm3, imm8) = (value >> 12 & 0xF, value >> 11 & 1, value >> 8 & 7, value & 0xFF);
        thumb(opcode | i << 26 | imm4 << 16 | imm3 << 12 | register << 8 | imm8)
    };
    [half(0xF240_0000, value & 0xFFFF), half(0xF2C0_0000, value >> 16)].concat()
}

/// Encodes `b.w` (ARMv7-M, A7.7.12, T4).
fn branch(from: u64, to: u64) -> Vec<u8> {
    let offset = (to as i64 - (from as i64 + 4)) as u32;
    let sign = offset >> 24 & 1;
    let (j1, j2) = ((offset >> 23 & 1 ^ 1) ^ sign, (offset >> 22 & 1 ^ 1) ^ sign);
    let (imm10, imm11) = (offset >> 12 & 0x3FF, offset >> 1 & 0x7FF);
    thumb(0xF000_9000 | sign << 26 | imm10 << 16 | j1 << 13 | j2 << 11 | imm11)
}

/// Encodes an instruction of two halves, the upper one first.
fn thumb(instruction: u32) -> Vec<u8> {
    [((instruction >> 16) as u16).to_le_bytes(), (instruction as u16).to_le_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_as_an_assembler_writes_them() {
        // movw r2, #0x1234; movt r2, #0x0800
        assert_eq!(load(2, 0x0800_1234), [0x41, 0xF2, 0x34, 0x22, 0xC0, 0xF6, 0x00, 0x02]);
        // b.w to the next instruction, to itself, and a megabyte back
        assert_eq!(branch(0x100, 0x104), [0x00, 0xF0, 0x00, 0xB8]);
        assert_eq!(branch(0x100, 0x100), [0xFF, 0xF7, 0xFE, 0xBF]);
        assert_eq!(branch(0x10_0000, 0), [0xFF, 0xF6, 0xFE, 0xBF]);
    }
}
