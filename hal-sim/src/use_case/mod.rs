//! The use cases of the manuals, frame by frame (SPEC 8): written once, played on anything that is a [`Bench`].
//!
//! ```text
//! script     what a use case is: what the master does, what the device must answer
//! canopen    the manual's six
//! isobus     the valve on ISOBUS
//! hat        the angle sensor
//! play       goes through a script on a bench and compares
//! simulated  the bench of the simulator: a world in virtual time
//! ```

mod canopen;
mod hat;
mod isobus;
mod play;
mod script;
mod simulated;

pub use crate::world::Plant;
pub use canopen::CANOPEN;
pub use hat::HAT;
pub use isobus::ISOBUS;
pub use play::{Bench, Deviation, play};
pub use script::{Device, Position, Step, UseCase};
pub use simulated::SimulatedBench;

/// Returns every use case there is, in order.
#[must_use]
pub fn all() -> Vec<&'static UseCase> {
    CANOPEN.iter().chain([&ISOBUS, &HAT]).collect()
}

/// Returns the use case of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static UseCase> {
    all().into_iter().find(|case| case.name == name)
}
