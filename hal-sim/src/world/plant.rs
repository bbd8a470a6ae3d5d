//! What acts on a device besides the bus: its plant, by the words and units of the control interface.

use std::fmt;

use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::device::Senses;
use protocol_core::encoder::{Shaft, TURN_CDEG};
use protocol_core::time::Instant;

use super::{NodeId, World};

/// A change of what a device senses. Its text is the word and the value that a console takes: `supply_mv 8500`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plant {
    /// Valves: the supply, in millivolt.
    SupplyMv(u32),
    /// Valves: the temperature, in °C.
    TemperatureC(i16),
    /// Valves: what is wrong with the spool.
    Spool(SpoolFault),
    /// Valves: where the hand lever pushes the spool, −16384…16384; `None`: it is let go.
    Lever(Option<i16>),
    /// Encoders: the angle of the shaft, 0…35999 1/100 degree. A shaft that turns goes on from there.
    AngleCdeg(u32),
    /// Encoders: the speed of the shaft, in turns a minute, positive clockwise. It turns from where it is, to a whole
    /// 1/100 degree.
    SpeedRpm(i32),
    /// Encoders: the sensor unit detects a measuring error.
    MeasuringError(bool),
    /// An internal fault is there, or taken away.
    InternalFault(bool),
    /// The CAN controller is kept bus-off, or left to recover.
    BusOff(bool),
}

/// The plant of a device cannot be changed so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlantError {
    /// Another product has that.
    #[error("{0}: no plant word of this kind of device")]
    OtherProduct(Plant),
    /// A value that cannot be.
    #[error("{0}: out of range")]
    OutOfRange(Plant),
    /// The valve at the other end of the link turns the shaft.
    #[error("{0}: the shaft is linked to a valve")]
    Linked(Plant),
}

impl World {
    /// Changes what acts on a device from outside, now.
    ///
    /// # Errors
    /// [`PlantError`]; nothing is changed then.
    pub fn set_plant(&mut self, node: NodeId, plant: Plant) -> Result<(), PlantError> {
        self.set_plants(node, &[plant])
    }

    /// Changes several things that act on a device from outside, all at once.
    ///
    /// # Errors
    /// [`PlantError`] for the first that cannot be; nothing is changed then.
    pub fn set_plants(&mut self, node: NodeId, plants: &[Plant]) -> Result<(), PlantError> {
        self.follow_links(node);
        let mut senses = *self.senses(node);
        for plant in plants {
            if matches!(plant, Plant::SpeedRpm(speed) if *speed != 0) && self.is_linked(node) {
                return Err(PlantError::Linked(*plant));
            }
            plant.apply(&mut senses, self.now)?;
        }
        for plant in plants {
            if let Plant::AngleCdeg(angle) = plant {
                self.turn_link(node, *angle);
            }
        }
        if senses != *self.senses(node) {
            self.set_senses(node, senses);
        }
        for plant in plants {
            if let Plant::BusOff(there) = plant {
                self.force_bus_off(node, *there);
            }
        }
        Ok(())
    }
}

impl Plant {
    fn apply(self, senses: &mut Senses, now: Instant) -> Result<(), PlantError> {
        let (other, range) = (PlantError::OtherProduct(self), PlantError::OutOfRange(self));
        match self {
            Self::SupplyMv(millivolt) => senses.valve_mut().ok_or(other)?.supply_mv = millivolt,
            Self::TemperatureC(celsius) => senses.valve_mut().ok_or(other)?.temperature_c = celsius,
            Self::Spool(fault) => senses.valve_mut().ok_or(other)?.spool.fault = fault,
            Self::Lever(pushed) => {
                let valve = senses.valve_mut().ok_or(other)?;
                valve.spool.lever = pushed.map(|raw| Position::new(raw).ok_or(range)).transpose()?;
            }
            Self::AngleCdeg(angle_cdeg) => {
                let shaft = senses.shaft_mut().ok_or(other)?;
                if angle_cdeg >= TURN_CDEG {
                    return Err(range);
                }
                *shaft = Shaft { angle_cdeg, since: now, ..*shaft };
            }
            Self::SpeedRpm(speed_rpm) => {
                let shaft = senses.shaft_mut().ok_or(other)?;
                *shaft = Shaft { angle_cdeg: shaft.angle_at(now), speed_rpm, since: now, ..*shaft };
            }
            Self::MeasuringError(there) => senses.shaft_mut().ok_or(other)?.measuring_error = there,
            Self::InternalFault(there) => senses.internal_fault = there,
            Self::BusOff(_) => {}
        }
        Ok(())
    }
}

impl fmt::Display for Plant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SupplyMv(millivolt) => write!(f, "supply_mv {millivolt}"),
            Self::TemperatureC(celsius) => write!(f, "temperature_c {celsius}"),
            Self::Spool(fault) => f.write_str(match fault {
                SpoolFault::None => "spool ok",
                SpoolFault::Stuck => "spool stuck",
                SpoolFault::Slow => "spool slow",
                SpoolFault::Drifting => "spool drifting",
                SpoolFault::NoFloat => "spool no-float",
            }),
            Self::Lever(Some(position)) => write!(f, "lever {position}"),
            Self::Lever(None) => f.write_str("lever off"),
            Self::AngleCdeg(angle) => write!(f, "angle_cdeg {angle}"),
            Self::SpeedRpm(speed) => write!(f, "speed_rpm {speed}"),
            Self::MeasuringError(there) => write!(f, "measuring_error {there}"),
            Self::InternalFault(there) => write!(f, "internal_fault {there}"),
            Self::BusOff(there) => write!(f, "bus_off {there}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_units_of_the_control_interface() {
        for (plant, text) in [
            (Plant::SupplyMv(8_500), "supply_mv 8500"),
            (Plant::TemperatureC(-41), "temperature_c -41"),
            (Plant::Spool(SpoolFault::None), "spool ok"),
            (Plant::Spool(SpoolFault::NoFloat), "spool no-float"),
            (Plant::Lever(Some(-4_000)), "lever -4000"),
            (Plant::Lever(None), "lever off"),
            (Plant::AngleCdeg(35_999), "angle_cdeg 35999"),
            (Plant::SpeedRpm(-30), "speed_rpm -30"),
            (Plant::MeasuringError(true), "measuring_error true"),
            (Plant::InternalFault(true), "internal_fault true"),
            (Plant::BusOff(false), "bus_off false"),
        ] {
            assert_eq!(plant.to_string(), text);
        }
    }
}
