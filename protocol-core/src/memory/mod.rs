//! The records of a device in its non-volatile memory, and their encoding (SPEC 6).
//!
//! The core never accesses a flash. Through an [`Effect`](crate::device::Effect), the core demands the write of a
//! record, and receives the result. At a start, the core reads a [`Memory`]: an [`Image`] of all records, or the flash
//! itself.

mod image;
mod record;

pub use image::{Content, Corrupt, Image, Memory};
pub use record::{RECORD_MAX, Record, RecordKey, StoreError, begin, complete, open, seal};
