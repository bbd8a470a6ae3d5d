//! The lines of the console.

use protocol_core::device::pve::Kind;

use crate::plant::Plant;

/// What can be said, a word a line.
pub const HELP: &str = "\
supply_mv N                       supply voltage in mV\r\n\
temperature_c N                   temperature in degrees Celsius\r\n\
spool ok|stuck|slow|drifting|no-float\r\n\
lever N|off                       hand lever, 16384 is 100 %\r\n\
internal_fault on|off\r\n\
memory ok|write-fails\r\n\
bus_off on|off                    keeps the controller off the bus\r\n\
status                            what it is, and what acts on it\r\n\
kind KIND [SERIAL]                becomes a new valve: pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus\r\n\
blank [SERIAL]                    becomes a new valve without a node ID\r\n\
power-cycle                       restarts\r\n";

/// The answer to a line that is not understood.
pub const USAGE: &str = "not understood: help tells all words";

/// A line that was understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// What acts on the device changes to this.
    Plant(Plant),
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
    pub fn parse(line: &str, plant: &Plant) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let command = match (words.next()?, words.next()) {
            ("status", None) => Self::Status,
            ("power-cycle", None) => Self::PowerCycle,
            ("help", None) => Self::Help,
            ("kind", Some(name)) => Self::Kind(Kind::from_name(name)?, serial(words.next())?),
            ("blank", value) => Self::Blank(serial(value)?),
            (word, Some(value)) => Self::Plant(plant.with(word, value)?),
            _ => return None,
        };
        words.next().is_none().then_some(command)
    }
}

/// A serial number, decimal or with 0x, if there is one; `None` for what is none.
fn serial(word: Option<&str>) -> Option<Option<u32>> {
    let Some(word) = word else { return Some(None) };
    let number = match word.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => word.parse(),
    };
    number.ok().map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Option<Command> {
        Command::parse(line, &Plant::default())
    }

    #[test]
    fn every_command() {
        assert_eq!(parse(" status "), Some(Command::Status));
        assert_eq!(parse("help"), Some(Command::Help));
        assert_eq!(parse("blank"), Some(Command::Blank(None)));
        assert_eq!(parse("blank 7"), Some(Command::Blank(Some(7))));
        assert_eq!(parse("power-cycle"), Some(Command::PowerCycle));
        assert_eq!(parse("kind pveo-isobus"), Some(Command::Kind(Kind::PveoIsobus, None)));
        assert_eq!(parse("kind pveo-isobus 0x1F"), Some(Command::Kind(Kind::PveoIsobus, Some(31))));
        let plant = Plant::default().with("supply_mv", "8500").unwrap();
        assert_eq!(parse(" supply_mv  8500"), Some(Command::Plant(plant)));
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
            assert_eq!(parse(line), None, "{line}");
        }
    }
}
