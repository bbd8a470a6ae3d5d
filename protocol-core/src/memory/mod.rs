//! Non-volatile memory: the records that a device keeps, and how they are encoded (SPEC 6).
//!
//! The core never touches a flash. It asks for a record to be written by an [`Effect`](crate::device::Effect), is told
//! when that is done, and is handed an [`Image`] of everything stored when it starts.

mod image;
mod record;

pub use image::{Content, Corrupt, Image};
pub use record::{RECORD_MAX, Record, RecordKey, StoreError, begin, complete, open, seal};
