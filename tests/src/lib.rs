//! What the tests share.
//!
//! ```text
//! answers        which requests have had none
//! rig            one device on a bus of its own: for what a device says and does
//! inputs         the inputs of a valve
//! hostile        what can happen to any device, for random tests
//! nmt, lss, sdo  frames of these services, which read like the manuals
//! bench          valves and a master in a simulated world: for bus errors, flashes, several devices
//! ```

mod answers;
mod bench;
pub mod hostile;
mod inputs;
pub mod isobus;
pub mod lss;
pub mod nmt;
mod rig;
pub mod sdo;

pub use answers::unanswered;
pub use bench::Bench;
pub use inputs::Inputs;
pub use rig::{Rig, frame};
