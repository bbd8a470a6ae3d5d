//! The file that keeps a memory beyond the process: a trait, as this library touches no file system.

use std::error::Error;
use std::fmt::Debug;

use super::Flash;

/// The reason for which a file cannot be written or put aside, in one line that names the file.
pub type MemoryFileError = Box<dyn Error + Send + Sync>;

/// A file that keeps the image of a flash.
pub trait MemoryFile: Debug + Send {
    /// Replaces the image; it is on disk when this returns.
    ///
    /// # Errors
    /// When it cannot be written. The file holds the earlier image then.
    fn write(&self, image: &[u8]) -> Result<(), MemoryFileError>;

    /// Puts what is kept aside for the user; the next write begins anew. Returns a line about it.
    ///
    /// # Errors
    /// When it cannot be put aside. It is not changed then.
    fn put_aside(&self) -> Result<String, MemoryFileError>;
}

/// The content of a file when it was opened.
#[derive(Debug)]
pub enum Content {
    /// There was no file.
    New,
    /// The image of a flash.
    Image(Flash),
    /// Something else.
    Damaged,
}
