//! Non-volatile memory: the records of a device and their encoding (SPEC 6).
//!
//! The core never accesses a flash. It requests the write of a record by an [`Effect`](crate::device::Effect), receives
//! the result, and reads a [`Memory`] at a start: an [`Image`] of all contents, or the flash itself.

mod image;
mod record;

pub use image::{Content, Corrupt, Image, Memory};
pub use record::{RECORD_MAX, Record, RecordKey, StoreError, begin, complete, open, seal};
