//! The file behind a memory: a trait, because this library uses no file system.

use std::error::Error;
use std::fmt::Debug;

use super::Flash;

/// The reason why a file cannot be written or put aside, in one line with the file's name.
pub type MemoryFileError = Box<dyn Error + Send + Sync>;

/// A file with the image of a flash.
pub trait MemoryFile: Debug + Send {
    /// Replaces the image; it is on disk when this returns.
    ///
    /// # Errors
    /// When the file cannot be written. It still holds the earlier image.
    fn write(&self, image: &[u8]) -> Result<(), MemoryFileError>;

    /// Puts the content aside for the user; the next write creates the file anew. Returns a line for the user.
    ///
    /// # Errors
    /// When the file cannot be put aside. It is unchanged.
    fn put_aside(&self) -> Result<String, MemoryFileError>;
}

/// The content of a file when it was opened.
#[derive(Debug)]
pub enum Content {
    /// There was no file.
    New,
    /// The image of a flash.
    Image(Flash),
    /// Not the image of a flash.
    Damaged,
}
