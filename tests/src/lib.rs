//! What the tests share.

pub mod isobus;
mod rig;

pub use rig::{Rig, frame};
