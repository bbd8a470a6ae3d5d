//! The lines of the console.

use protocol_core::device::{Kind, ProductSenses};

use crate::plant::{Change, natural};

/// What can be said to every kind, a word a line.
pub const HELP: &str = "\
internal_fault on|off\r\n\
memory ok|write-fails\r\n\
bus_off on|off                    keeps the controller off the bus\r\n\
status                            what it is, and what acts on it\r\n\
kind KIND [SERIAL]                becomes a new device: pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus, \
hat1000, hat3000\r\n\
blank [SERIAL]                    becomes a new device without a node ID\r\n\
power-cycle                       restarts\r\n";

const VALVE_HELP: &str = "\
supply_mv N                       supply voltage in mV\r\n\
temperature_c N                   temperature in degrees Celsius\r\n\
spool ok|stuck|slow|drifting|no-float\r\n\
lever N|off                       hand lever, 16384 is 100 %\r\n";

const SENSOR_HELP: &str = "\
angle_cdeg N                      angle of the shaft, 0 to 35999 1/100 degree\r\n\
speed_rpm N                       turns a minute, by itself; positive is clockwise\r\n\
measuring_error on|off\r\n";

/// Returns what can be said to a product besides, a word a line.
#[must_use]
pub const fn help_of(product: &ProductSenses) -> &'static str {
    match product {
        ProductSenses::Valve(_) => VALVE_HELP,
        ProductSenses::Encoder(_) => SENSOR_HELP,
    }
}

/// The answer to a line that is not understood.
pub const USAGE: &str = "not understood: help tells all words";

/// The answer to a line of which characters were lost or altered.
pub const DAMAGED: &str = "damaged in transmission: send it again";

/// The answer to a word that another product has.
pub const OTHER_KIND: &str = "another kind of device has this word: help tells all words";

/// A line that was understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Change what acts on the device.
    Plant(Change),
    /// Tell how the device is.
    Status,
    /// Become a new device of this kind, perhaps with a serial number of its own.
    Kind(Kind, Option<u32>),
    /// Become a new device of the present kind, without a node ID.
    Blank(Option<u32>),
    /// Start as if power had come back.
    PowerCycle,
    /// Tell all words.
    Help,
}

impl Command {
    /// Reads a line. `None` when it is not understood.
    #[must_use]
    pub fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let command = match (words.next()?, words.next()) {
            ("status", None) => Self::Status,
            ("power-cycle", None) => Self::PowerCycle,
            ("help", None) => Self::Help,
            ("kind", Some(name)) => Self::Kind(Kind::from_name(name)?, serial(words.next())?),
            ("blank", value) => Self::Blank(serial(value)?),
            (word, Some(value)) => Self::Plant(Change::parse(word, value)?),
            _ => return None,
        };
        words.next().is_none().then_some(command)
    }
}

/// Returns a serial number, decimal or with 0x, if there is one; `None` for what is none.
fn serial(word: Option<&str>) -> Option<Option<u32>> {
    let Some(word) = word else { return Some(None) };
    let (digits, radix) = word.strip_prefix("0x").map_or((word, 10), |digits| (digits, 16));
    natural(digits, radix).map(Some)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;

    use super::*;
    use crate::plant::Plant;
    use protocol_core::time::Instant;

    #[test]
    fn every_command() {
        assert_eq!(Command::parse(" status "), Some(Command::Status));
        assert_eq!(Command::parse("help"), Some(Command::Help));
        assert_eq!(Command::parse("blank"), Some(Command::Blank(None)));
        assert_eq!(Command::parse("blank 7"), Some(Command::Blank(Some(7))));
        assert_eq!(Command::parse("power-cycle"), Some(Command::PowerCycle));
        for kind in Kind::ALL {
            assert_eq!(Command::parse(&format!("kind {kind}")), Some(Command::Kind(kind, None)));
            assert_eq!(Command::parse(&format!("kind {kind} 0x1F")), Some(Command::Kind(kind, Some(31))));
            assert!(HELP.contains(kind.name()), "{kind}");
        }
        assert_eq!(Command::parse(" supply_mv  8500"), Some(Command::Plant(Change::SupplyMv(8_500))));
        assert_eq!(Command::parse("speed_rpm -60"), Some(Command::Plant(Change::SpeedRpm(-60))));
    }

    #[test]
    fn anything_else_is_not_understood() {
        for line in [
            "",
            "supply_mv",
            "supply_mv 1 2",
            "status now",
            "kind",
            "kind pvea",
            "kind pvea-isobus x",
            "kind pvea-isobus 1 2",
            "blank x",
            "blank 1 2",
            "blank 4294967296",
        ] {
            assert_eq!(Command::parse(line), None, "{line}");
        }
    }

    #[test]
    fn help_tells_every_word_of_the_product_and_no_other() {
        let sets = Kind::ALL.map(Plant::healthy);
        for plant in sets {
            let help = format!("{}{HELP}", help_of(&plant.senses.product));
            for other in sets {
                for (word, _) in other.words(Instant::MIN).map(Change::text) {
                    let is_own = plant.words(Instant::MIN).any(|own| own.text().0 == word);
                    assert_eq!(help.lines().any(|line| line.starts_with(word)), is_own, "{word}");
                }
            }
        }
    }
}
