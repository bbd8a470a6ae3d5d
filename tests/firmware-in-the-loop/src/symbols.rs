//! The content of the image, by its symbols: the addresses of functions, and the flash and RAM of each crate.

use std::collections::BTreeMap;

use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind};

use crate::board::Board;

/// The name for bytes of no crate: constants without a name, and gaps between symbols.
const NOBODY: &str = "(constants without a name)";
/// The name for symbols of no crate: start-up code, and the functions that a compiler expects.
const NO_CRATE: &str = "(start-up, compiler)";
/// The type in which tasks are stored and polled. Its code belongs to the firmware, with all that was inlined there.
const TASKS: &str = "embassy_executor::raw::TaskStorage";

/// A function or a variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Symbol {
    /// The path of the symbol.
    pub name: String,
    /// The address of the symbol.
    pub address: u64,
    /// The size in bytes; 0 for a mark of the linker.
    pub size: u64,
}

/// The number of bytes in flash and in RAM.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Size {
    /// The bytes in flash, without the initial values of variables.
    pub flash: u64,
    /// The bytes in RAM.
    pub ram: u64,
}

/// The symbols of an image.
#[derive(Clone, Debug)]
pub struct Symbols {
    symbols: Vec<Symbol>,
    board: &'static Board,
    flash: u64,
    ram: u64,
}

impl Symbols {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// Returns an error for any other file.
    pub fn read(elf: &[u8], board: &'static Board) -> object::Result<Self> {
        let file = ElfFile32::<Endianness>::parse(elf)?;
        let mut symbols: Vec<Symbol> = file
            .symbols()
            .filter(|symbol| matches!(symbol.kind(), SymbolKind::Text | SymbolKind::Data | SymbolKind::Unknown))
            .filter_map(|symbol| {
                let name = format!("{:#}", rustc_demangle::demangle(symbol.name().ok()?));
                // The lowest bit of the address of a function marks Thumb code.
                let thumb = u64::from(symbol.kind() == SymbolKind::Text);
                Some(Symbol { name, address: symbol.address() & !thumb, size: symbol.size() })
            })
            .collect();
        symbols.sort_by_key(|symbol| (symbol.address, symbol.size));
        let header = |header: &object::elf::ProgramHeader32<Endianness>| {
            let endian = file.endian();
            let loaded = header.p_type(endian) == PT_LOAD && board.flash.contains(&header.p_paddr(endian).into());
            if loaded { u64::from(header.p_filesz(endian)) } else { 0 }
        };
        let flash = file.elf_program_headers().iter().map(header).sum();
        let in_ram =
            file.sections().filter(|section| board.ram.contains(&section.address())).map(|section| section.size());
        Ok(Self { symbols, board, flash, ram: in_ram.sum() })
    }

    /// Returns the flashed bytes, and the bytes of all variables.
    #[must_use]
    pub const fn total(&self) -> Size {
        Size { flash: self.flash, ram: self.ram }
    }

    /// Returns the functions whose path contains one of `names`, those of the first name first.
    #[must_use]
    pub fn functions(&self, names: &[&str]) -> Vec<&Symbol> {
        let code =
            || self.symbols.iter().filter(|symbol| self.board.flash.contains(&symbol.address) && symbol.size > 0);
        names.iter().flat_map(|name| code().filter(move |symbol| symbol.name.contains(name))).collect()
    }

    /// Returns the address of a symbol by its whole name.
    #[must_use]
    pub fn address(&self, name: &str) -> Option<u64> {
        self.symbols.iter().find(|symbol| symbol.name == name).map(|symbol| symbol.address)
    }

    /// Returns the size of each crate, the biggest first, and of the bytes of no crate. The sum is
    /// [`total`](Self::total).
    #[must_use]
    pub fn by_crate(&self) -> Vec<(String, Size)> {
        let mut crates: BTreeMap<String, Size> = BTreeMap::new();
        let mut left = self.total();
        let mut end = 0;
        for symbol in self.symbols.iter().filter(|symbol| symbol.size > 0) {
            // Equal functions share one address and have several names.
            let from = symbol.address.max(end);
            let size = (symbol.address + symbol.size).saturating_sub(from);
            end = end.max(symbol.address + symbol.size);
            let owner = if symbol.name.starts_with('.') { NOBODY } else { crate_of(&symbol.name) };
            let entry = crates.entry(owner.to_owned()).or_default();
            if self.board.flash.contains(&symbol.address) {
                entry.flash += size;
                left.flash = left.flash.saturating_sub(size);
            } else if self.board.ram.contains(&symbol.address) {
                entry.ram += size;
                left.ram = left.ram.saturating_sub(size);
            }
        }
        let nobody = crates.entry(NOBODY.to_owned()).or_default();
        *nobody = Size { flash: nobody.flash + left.flash, ram: nobody.ram + left.ram };
        let mut crates: Vec<_> = crates.into_iter().filter(|(_, size)| *size != Size::default()).collect();
        crates.sort_by_key(|(_, size)| std::cmp::Reverse(size.flash + size.ram));
        crates
    }
}

/// Returns the crate of a path: that of `<protocol_core::frame::Frame as core::fmt::Debug>::fmt` is `protocol_core`.
fn crate_of(path: &str) -> &str {
    if path.contains(TASKS) {
        return "firmware";
    }
    let start = path.trim_start_matches(['<', '&', '*', '[', '(', '_']);
    let start = ["mut ", "dyn ", "const "].iter().fold(start, |rest, word| rest.strip_prefix(word).unwrap_or(rest));
    let end = start.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(start.len());
    let (name, rest) = start.split_at(end);
    if rest.starts_with("::") && !name.is_empty() { name } else { NO_CRATE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crate_of_a_path() {
        for (path, name) in [
            ("protocol_core::wire::sdo::parse", "protocol_core"),
            ("<protocol_core::frame::Frame as core::fmt::Debug>::fmt", "protocol_core"),
            ("<&mut nvm::store::Records as core::fmt::Debug>::fmt", "nvm"),
            ("core::ptr::drop_in_place<firmware::x>", "core"),
            ("embassy_executor::raw::TaskStorage<F>::poll", "firmware"),
            ("Reset", NO_CRATE),
            ("__aeabi_memcpy", NO_CRATE),
        ] {
            assert_eq!(crate_of(path), name, "{path}");
        }
    }
}
