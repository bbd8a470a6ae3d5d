//! The lines of the console.

use protocol_core::device::pve::Kind;

use crate::plant::Plant;

/// What can be said.
pub const USAGE: &str = "\
supply_mv N | temperature_c N | spool ok|stuck|slow|drifting|no-float | lever N|off | internal_fault on|off\r\n\
memory ok|write-fails | bus_off on|off | status | kind KIND | blank | power-cycle";

/// A line that was understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// What acts on the device changes to this.
    Plant(Plant),
    /// Tell how the device is.
    Status,
    /// Become a new device of this kind.
    Kind(Kind),
    /// Become a new device of the present kind, without a node ID.
    Blank,
    /// Start as if power had come back.
    PowerCycle,
}

impl Command {
    /// Reads a line. `None` when it is not understood.
    #[must_use]
    pub fn parse(line: &str, plant: &Plant) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let word = words.next()?;
        let value = words.next();
        if words.next().is_some() {
            return None;
        }
        match (word, value) {
            ("status", None) => Some(Self::Status),
            ("blank", None) => Some(Self::Blank),
            ("power-cycle", None) => Some(Self::PowerCycle),
            ("kind", Some(name)) => Kind::from_name(name).map(Self::Kind),
            (word, Some(value)) => plant.with(word, value).map(Self::Plant),
            _ => None,
        }
    }
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
        assert_eq!(parse("blank"), Some(Command::Blank));
        assert_eq!(parse("power-cycle"), Some(Command::PowerCycle));
        assert_eq!(parse("kind pveo-isobus"), Some(Command::Kind(Kind::PveoIsobus)));
        let plant = Plant::default().with("supply_mv", "8500").unwrap();
        assert_eq!(parse(" supply_mv  8500"), Some(Command::Plant(plant)));
    }

    #[test]
    fn anything_else_is_not_understood() {
        for line in
            ["", "supply_mv", "supply_mv 1 2", "status now", "kind", "kind pvea", "kind pvea-isobus 1", "blank 1"]
        {
            assert_eq!(parse(line), None, "{line}");
        }
    }
}
