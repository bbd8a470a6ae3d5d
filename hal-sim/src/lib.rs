//! The host hardware.

pub mod cli;
pub mod gateway;
pub mod kind;
pub mod trace;
