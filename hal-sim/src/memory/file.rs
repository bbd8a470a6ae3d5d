//! The file behind a memory, as a trait, because this library does not access the file system.

use std::error::Error;
use std::fmt::Debug;

use super::Flash;

/// The reason why a file cannot be written or put aside. Its text is one line that includes the file name.
pub type MemoryFileError = Box<dyn Error + Send + Sync>;

/// A file with the image of a flash.
pub trait MemoryFile: Debug + Send {
    /// Replaces the image. When the function returns, the image is on disk.
    ///
    /// # Errors
    /// If the file cannot be written. The file then still contains the previous image.
    fn write(&self, image: &[u8]) -> Result<(), MemoryFileError>;

    /// Moves unusable content aside; the next write creates a new file. Returns a one-line message for the user.
    ///
    /// # Errors
    /// If the file cannot be moved. The file is then unchanged.
    fn put_aside(&self) -> Result<String, MemoryFileError>;
}

/// The content of a memory file when it is opened.
#[derive(Debug)]
pub enum Content {
    /// The file did not exist.
    New,
    /// The image of a flash.
    Image(Flash),
    /// The content is not a flash image.
    Damaged,
}
