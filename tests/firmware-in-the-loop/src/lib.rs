//! The stand-in's firmware image, unmodified, in an emulated NUCLEO-F429ZI on the simulated bus.
#![deny(unsafe_code)]

pub mod bench;
pub mod broken;
pub mod bxcan;
pub mod content;
pub mod flash;
pub mod image;
pub mod machine;
pub mod part;
pub mod rig;
pub mod stack;
pub mod symbols;
mod warm;
