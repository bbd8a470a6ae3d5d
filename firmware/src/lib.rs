//! What of the firmware needs no board: tested on the host.
#![no_std]
#![forbid(unsafe_code)]

pub mod bit_timing;
pub mod console;
pub mod filter_bank;
