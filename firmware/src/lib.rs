//! The hardware-independent parts of the firmware, tested on the host.
//!
//! ```text
//! bit_timing    bit rates                  filter_bank  filters of the CAN controller
//! console       commands of the console    line         lines of the console
//! settings      settings of the board
//! ```
//!
//! For the target, the crate also contains `memory_functions`: the functions that the compiler calls to copy, move and
//! fill memory.
#![no_std]
#![deny(unsafe_code)]

pub mod bit_timing;
pub mod console;
pub mod filter_bank;
pub mod line;
#[cfg(target_os = "none")]
#[allow(unsafe_code, reason = "assembler code replaces the functions of the compiler")]
mod memory_functions;
pub mod settings;

pub use protocol_core::device::plant;
