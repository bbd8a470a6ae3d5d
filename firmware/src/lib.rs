//! What of the firmware needs no board: tested on the host.
//!
//! ```text
//! bit_timing    the bit rates       filter_bank  the filters of the CAN controller
//! console       what can be typed   settings     what the board is
//! ```
#![no_std]
#![forbid(unsafe_code)]

pub mod bit_timing;
pub mod console;
pub mod filter_bank;
pub mod settings;

pub use protocol_core::device::plant;
