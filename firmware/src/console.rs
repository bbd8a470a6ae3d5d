//! The commands of the console.

use protocol_core::device::Kind;

use crate::plant::{Change, Word, natural};

/// The help for the commands of the board, one line for each command. The help for the plant words precedes it.
pub const HELP: &str = "\
status              prints kind, node ID, bit rate, bus, counters and plant\r\n\
kind KIND [SERIAL]  makes the board a new device: pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus, hat1000, hat3000\r\n\
blank [SERIAL]      makes the board a new device without a node ID\r\n\
power-cycle         restarts the board\r\n";

/// Writes the help line of a plant word to `put` in parts, in the columns of [`HELP`].
pub fn tell_help(word: &Word, put: &mut dyn FnMut(&str)) {
    const COLUMN: usize = "kind KIND [SERIAL]  ".len();
    word.tell(COLUMN, put);
    put("\r\n");
}

/// The answer to an invalid line.
pub const USAGE: &str = "invalid line: help lists all words";

/// The answer to a line with lost or altered characters.
pub const DAMAGED: &str = "damaged in transmission: send the line again";

/// The answer to a plant word of another product.
pub const OTHER_KIND: &str = "not a word of this kind of device: help lists all words";

/// A command of the console.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Change the plant of the device.
    Plant(Change),
    /// Print the status of the device.
    Status,
    /// Make the board a new device of this kind, with this serial number.
    Kind(Kind, Option<u32>),
    /// Make the board a new device of the present kind without a node ID, with this serial number or the present one.
    Blank(Option<u32>),
    /// Restart the board as after power-up.
    PowerCycle,
    /// Print the help.
    Help,
}

impl Command {
    /// Parses a line; `None` for an invalid line.
    #[must_use]
    pub fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let command = match (words.next()?, words.next()) {
            ("status", None) => Self::Status,
            ("power-cycle", None) => Self::PowerCycle,
            ("help", None) => Self::Help,
            ("kind", Some(name)) => Self::Kind(Kind::from_name(name)?, serial(words.next())?),
            ("blank", value) => Self::Blank(serial(value)?),
            (word, Some(value)) => Self::Plant(Change::parse_on_board(word, value)?),
            _ => return None,
        };
        words.next().is_none().then_some(command)
    }
}

/// Parses an optional serial number, decimal or hexadecimal with 0x; `None` for an invalid number.
fn serial(word: Option<&str>) -> Option<Option<u32>> {
    let Some(word) = word else { return Some(None) };
    let (digits, radix) = word.strip_prefix("0x").map_or((word, 10), |digits| (digits, 16));
    natural(digits, radix).map(Some)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;
    use std::string::String;

    use super::*;
    use crate::plant::WORDS;

    #[test]
    fn every_command() {
        assert_eq!(Command::parse(" status "), Some(Command::Status));
        assert_eq!(Command::parse("help"), Some(Command::Help));
        assert_eq!(Command::parse("boot_ms 5"), None, "a word of the simulator alone");
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
    fn the_help_of_a_word_is_a_line_in_the_columns_of_the_others() {
        let mut help = String::new();
        let words = || WORDS.iter().filter(|word| !word.simulated);
        words().for_each(|word| tell_help(word, &mut |part| help.push_str(part)));
        assert!(help.starts_with("supply_mv           supply voltage: 0 to 100000 mV\r\n"), "{help}");
        help.push_str(HELP);
        assert_eq!(help.lines().count(), words().count() + 4);
        for line in help.split_terminator("\r\n") {
            let (word, rest) = line.split_at(20);
            assert!(word.ends_with(' ') && !rest.starts_with(' ') && line.chars().count() <= 120, "{line}");
        }
    }
}
