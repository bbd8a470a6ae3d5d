//! The stand-in's firmware image, unmodified, in an emulated NUCLEO-F429ZI on the simulated bus.
#![forbid(unsafe_code)]

pub mod bench;
pub mod bxcan;
pub mod flash;
pub mod image;
pub mod machine;
pub mod part;
pub mod rig;
