//! The non-volatile memory of the devices: records in a NOR flash of two sectors. The host runs it over a simulated
//! flash, the board over its own: what a power cut cannot break there, it cannot break here.
//!
//! Every call runs to its end: a flash that takes its time blocks the caller, which on the board is a task below all
//! others. Nothing can be dropped half done, and the image is 6 KiB smaller than with a flash that is awaited.
#![no_std]
#![forbid(unsafe_code)]

mod item_lengths;
mod preview;
mod store;
mod sure_erase;

pub use store::{BUFFER, Contents, Records, SETTING_MAX, Setting, Unreadable};
pub use sure_erase::{ERASED, SureErase};

/// The sectors of a memory: one holds it, the other is where it goes when that is full.
const SECTORS: usize = 2;
