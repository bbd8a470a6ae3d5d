//! The use cases of the manuals, frame by frame (SPEC 8): written once, played on anything that is a [`Bench`].
//!
//! ```text
//! script     what a use case is: what the master does, what the valve must answer
//! canopen    the manual's six
//! isobus     the valve on ISOBUS
//! plant      what acts on a valve besides the bus
//! play       goes through a script on a bench and compares
//! simulated  the bench of the simulator: a world in virtual time
//! ```

mod canopen;
mod isobus;
mod plant;
mod play;
mod script;
mod simulated;

pub use canopen::CANOPEN;
pub use isobus::ISOBUS;
pub use plant::Plant;
pub use play::{Bench, Deviation, play};
pub use script::{Position, Step, UseCase, Valve};
pub use simulated::SimulatedBench;

/// Every use case there is, in order.
#[must_use]
pub fn all() -> Vec<&'static UseCase> {
    CANOPEN.iter().chain([&ISOBUS]).collect()
}

/// The use case of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static UseCase> {
    all().into_iter().find(|case| case.name == name)
}
