//! What acts on a valve besides the bus: its plant, by the words and units of the control interface.

use std::fmt;

use protocol_core::actuator::SpoolFault;

/// A change of what a valve senses. Its text is the word and the value that a console takes: `supply_mv 8500`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plant {
    /// The supply, in millivolt.
    SupplyMv(u32),
    /// The temperature, in °C.
    TemperatureC(i16),
    /// What is wrong with the spool.
    Spool(SpoolFault),
    /// Where the hand lever pushes the spool, −16384…16384; `None`: it is let go.
    Lever(Option<i16>),
    /// An internal fault is there, or taken away.
    InternalFault(bool),
    /// The CAN controller is kept bus-off, or left to recover.
    BusOff(bool),
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
            (Plant::InternalFault(true), "internal_fault true"),
            (Plant::BusOff(false), "bus_off false"),
        ] {
            assert_eq!(plant.to_string(), text);
        }
    }
}
