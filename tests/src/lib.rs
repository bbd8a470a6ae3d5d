//! What the tests share.

mod rig;

pub use rig::{Rig, frame};
