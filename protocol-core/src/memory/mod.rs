//! Non-volatile memory: the records that a device keeps, and how they are encoded (SPEC 6).
//!
//! The core never touches a flash. It requests the write of a record by an [`Effect`](crate::device::Effect), takes the
//! result, and reads a [`Memory`] when it starts: an [`Image`] of everything stored, or the flash itself.

mod image;
mod record;

pub use image::{Content, Corrupt, Image, Memory};
pub use record::{RECORD_MAX, Record, RecordKey, StoreError, begin, complete, open, seal};
