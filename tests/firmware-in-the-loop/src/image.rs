//! The flashed image: its file and its symbols.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use crate::board::{Board, NUCLEO_F429ZI, NUCLEO_F446RE};
use crate::symbols::Symbols;

/// An image of the firmware.
pub struct Image {
    board: &'static Board,
    path: PathBuf,
    symbols: Symbols,
    loaded: Vec<rigless::image::Image>,
}

impl Image {
    /// Returns the image for a board: that of its environment variable, or the one that cargo has built.
    ///
    /// # Panics
    /// Panics without an image.
    #[must_use]
    pub fn of(board: &'static Board) -> &'static Self {
        static IMAGES: [LazyLock<Image>; 2] =
            [LazyLock::new(|| Image::load(&NUCLEO_F429ZI)), LazyLock::new(|| Image::load(&NUCLEO_F446RE))];
        &IMAGES[usize::from(std::ptr::eq(board, &NUCLEO_F446RE))]
    }

    /// Returns an image of `firmware/examples` for the NUCLEO-F429ZI, built in a profile. It lies beside the image for
    /// that board.
    ///
    /// # Panics
    /// Panics without an image.
    #[must_use]
    pub fn example(profile: &str, name: &str) -> &'static Self {
        let path = Image::of(&NUCLEO_F429ZI).path.with_file_name("..").join(profile).join("examples").join(name);
        Box::leak(Box::new(Image::load_from(&NUCLEO_F429ZI, path)))
    }

    fn load(board: &'static Board) -> Self {
        let target = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/thumbv7em-none-eabihf");
        let built = || Path::new(target).join(board.profile).join("firmware").into_os_string();
        Self::load_from(board, PathBuf::from(std::env::var_os(board.variable).unwrap_or_else(built)))
    }

    fn load_from(board: &'static Board, path: PathBuf) -> Self {
        let image = rigless::image::Image::read(&path, None)
            .unwrap_or_else(|error| panic!("{}: {error} (`./run` builds it)", path.display()));
        let symbols = std::fs::read(&path).map(|elf| Symbols::read(&elf, board));
        let symbols = symbols.expect("it was just read").expect("what is loaded is an ELF file");
        Self { board, path, symbols, loaded: vec![image] }
    }

    /// Returns the board of the image.
    #[must_use]
    pub const fn board(&self) -> &'static Board {
        self.board
    }

    /// Returns the symbols of the image.
    #[must_use]
    pub const fn symbols(&self) -> &Symbols {
        &self.symbols
    }

    /// Returns the path of the ELF file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn for_emulator(&self) -> &[rigless::image::Image] {
        &self.loaded
    }
}
