//! The file behind a memory, as a trait: this library does not access the file system.

use std::error::Error;
use std::fmt::Debug;

use super::Flash;

/// The reason why a file cannot be written or put aside: one line that includes the file name.
pub type MemoryFileError = Box<dyn Error + Send + Sync>;

/// A file with the image of a flash.
pub trait MemoryFile: Debug + Send {
    /// Replaces the image. The image is on disk when this returns.
    ///
    /// # Errors
    /// If the file cannot be written. It then still holds the previous image.
    fn write(&self, image: &[u8]) -> Result<(), MemoryFileError>;

    /// Moves unusable content aside; the next write creates a new file. Returns one line of information for the user.
    ///
    /// # Errors
    /// If the file cannot be moved. It is then unchanged.
    fn put_aside(&self) -> Result<String, MemoryFileError>;
}

/// The content of a file when it was opened.
#[derive(Debug)]
pub enum Content {
    /// The file did not exist.
    New,
    /// The image of a flash.
    Image(Flash),
    /// The content is not a flash image.
    Damaged,
}
