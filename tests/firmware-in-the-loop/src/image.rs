//! The image that is flashed: where it is, and what is in it.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use crate::symbols::Symbols;

/// Names the ELF file; `./run` sets it.
pub const VARIABLE: &str = "FIRMWARE_ELF";

/// An image of the firmware.
pub struct Image {
    path: PathBuf,
    symbols: Symbols,
    loaded: Vec<rigless::image::Image>,
}

impl Image {
    /// The image that [`VARIABLE`] names, or the one that `cargo firmware` has built.
    ///
    /// # Panics
    /// When there is none.
    #[must_use]
    pub fn get() -> &'static Self {
        static IMAGE: LazyLock<Image> = LazyLock::new(|| {
            let built = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/thumbv7em-none-eabihf/firmware/firmware");
            Image::load(Path::new(&std::env::var_os(VARIABLE).unwrap_or_else(|| built.into())))
        });
        &IMAGE
    }

    fn load(path: &Path) -> Self {
        let image = rigless::image::Image::read(path, None)
            .unwrap_or_else(|error| panic!("{}: {error} (`./run` builds it)", path.display()));
        let symbols = std::fs::read(path).map(|elf| Symbols::read(&elf));
        let symbols = symbols.expect("it was just read").expect("what is loaded is an ELF file");
        Self { path: path.to_owned(), symbols, loaded: vec![image] }
    }

    /// What is in it.
    #[must_use]
    pub const fn symbols(&self) -> &Symbols {
        &self.symbols
    }

    /// The ELF file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn for_emulator(&self) -> &[rigless::image::Image] {
        &self.loaded
    }
}
