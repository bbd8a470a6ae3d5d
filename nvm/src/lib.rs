//! The non-volatile memory of the devices: records in a NOR flash of two sectors. The host runs it over a simulated
//! flash, the board over its own: what a power cut cannot break there, it cannot break here.
#![no_std]
#![forbid(unsafe_code)]

mod item_lengths;
mod store;
mod sure_erase;

pub use store::{BUFFER, Records, Unreadable};
pub use sure_erase::{ERASED, SureErase};
