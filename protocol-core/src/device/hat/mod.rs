//! The angle sensors HAT 1000 and HAT 3000 (SPEC 9).

mod shaft;

pub use shaft::{STEPS, Shaft, TURN_CDEG};
