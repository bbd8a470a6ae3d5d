//! The host hardware.

pub mod cli;
pub mod kind;
