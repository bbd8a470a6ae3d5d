//! The valve without a protocol: set-point, spool, monitors, faults, power save and LED (SPEC 2).
//!
//! Nothing here knows a CAN identifier, an object dictionary or a diagnostic code: the protocols present what the
//! [`Valve`] says.
//!
//! ```text
//! set_point    what is asked for, and the scales in which protocols write it
//! travel       where the spool is at any instant: whole numbers, no rounding
//! spool        what solenoids, springs, lever and faults of the spool make of it
//! power_save   when the solenoids rest
//! environment  supply and temperature
//! monitor      what all monitors are made of, and the guard of set-points
//! fault        the faults, by priority        counters   how often each occurred
//! register     which are active, and what has changed
//! led          what the LED shows
//! valve        ties them together
//! ```

mod counters;
mod environment;
mod fault;
mod led;
mod monitor;
mod power_save;
mod register;
mod set_point;
mod spool;
mod travel;
mod valve;

pub use counters::{COUNTER_MAX, Counters};
pub use environment::{SUPPLY_DELAY, TEMPERATURE_DELAY};
pub use fault::{Fault, FaultIter, FaultSet, InternalCause};
pub use led::{Color, Condition, Led};
pub use monitor::{FLOAT_DELAY, GUARD_TIME, SET_POINT_DELAY, SET_POINT_PERCENT};
pub use power_save::POWER_SAVE_DELAY;
pub use register::Changes;
pub use set_point::{Position, Scale, SetPoint};
pub use spool::{
    DRIFT_PERCENT, DRIFT_STROKE, END_BAND_PERCENT, NO_FLOAT_PERCENT, SLOWNESS, SOLENOID_STROKE, SPRING_STROKE,
    SpoolFault, SpoolSense, SpoolTimes,
};
pub use valve::{ActuatorType, Drive, SpoolMonitors, Valve, ValveConfig, ValveInputs};

#[cfg(test)]
mod tests;
