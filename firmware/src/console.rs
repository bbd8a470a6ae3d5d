//! The words of the console: what the device senses, changed by hand.

use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::device::Senses;

/// Why a line was not understood.
pub const USAGE: &str =
    "supply_mv N | temperature_c N | spool ok|stuck|slow|no-float | lever N|off | internal_fault on|off";

/// Obeys a line. `None` when it is not understood, and nothing has changed.
#[must_use]
pub fn obey(line: &str, senses: &Senses) -> Option<Senses> {
    let mut words = line.split_ascii_whitespace();
    let (word, value) = (words.next()?, words.next()?);
    if words.next().is_some() {
        return None;
    }
    let mut senses = *senses;
    match word {
        "supply_mv" => senses.supply_mv = value.parse().ok()?,
        "temperature_c" => senses.temperature_c = value.parse().ok()?,
        "spool" => {
            senses.spool.fault = match value {
                "ok" => SpoolFault::None,
                "stuck" => SpoolFault::Stuck,
                "slow" => SpoolFault::Slow,
                "no-float" => SpoolFault::NoFloat,
                _ => return None,
            }
        }
        "lever" if value == "off" => senses.spool.lever = None,
        "lever" => senses.spool.lever = Some(Position::new(value.parse().ok()?)?),
        "internal_fault" => {
            senses.internal_fault = match value {
                "on" => true,
                "off" => false,
                _ => return None,
            }
        }
        _ => return None,
    }
    Some(senses)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(line: &str) -> Option<Senses> {
        obey(line, &Senses::default())
    }

    #[test]
    fn every_word() {
        assert_eq!(after("supply_mv 8500").unwrap().supply_mv, 8500);
        assert_eq!(after(" temperature_c  -41 ").unwrap().temperature_c, -41);
        assert_eq!(after("spool stuck").unwrap().spool.fault, SpoolFault::Stuck);
        assert_eq!(after("lever 4000").unwrap().spool.lever, Position::new(4000));
        assert_eq!(after("lever off").unwrap().spool.lever, None);
        assert!(after("internal_fault on").unwrap().internal_fault);
    }

    #[test]
    fn anything_else_changes_nothing() {
        for line in
            ["", "supply_mv", "supply_mv x", "supply_mv 1 2", "spool bent", "lever 16385", "internal_fault 1", "kind"]
        {
            assert_eq!(after(line), None, "{line}");
        }
    }
}
