//! The protocol-independent valve: set-point, spool, monitors, faults, power save and LED (SPEC 2).
//!
//! This module contains no CAN identifiers, object dictionaries or diagnostic codes. The protocols present the state of
//! the [`Valve`].
//!
//! ```text
//! set_point    set-points, positions, and the scales of the protocols
//! travel       travel of the spool over time, in integers
//! spool        effect of solenoids, springs, lever and spool faults
//! power_save   switching the solenoids off
//! environment  monitors of supply and temperature
//! monitor      monitor with a delay, and the time guard of the set-points
//! fault        faults in order of priority      counters   occurrence counters of the faults
//! register     active faults and their changes
//! led          state of the LED
//! valve        the valve, which combines them
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
    DRIFT_PERCENT, DRIFT_STROKE, END_BAND_PERCENT, NO_FLOAT_PERCENT, Roughness, SLOWNESS, SOLENOID_STROKE,
    SPRING_STROKE, SpoolFault, SpoolSense, SpoolTimes,
};
pub use valve::{ActuatorType, Drive, SpoolMonitors, Valve, ValveConfig, ValveInputs};

#[cfg(test)]
mod tests;
