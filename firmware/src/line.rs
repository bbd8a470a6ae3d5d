//! The reception of console lines, character by character.

use heapless::String;

/// The maximum length of a line, in bytes.
pub const LONGEST: usize = 48;

/// The condition of a received line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// The line is complete and undamaged.
    Whole,
    /// The line is longer than [`LONGEST`].
    TooLong,
    /// Characters of the line were lost or altered in transmission.
    Damaged,
}

const BACKSPACE: u8 = 0x08;
/// The character that many terminals send instead of backspace.
const DELETE: u8 = 0x7F;

/// A console line, which ends with CR, LF or both. The next character begins a new line.
#[derive(Debug, Default)]
pub struct Line {
    text: String<LONGEST>,
    is_too_long: bool,
    is_damaged: bool,
    has_ended: bool,
    last: u8,
}

impl Line {
    /// Creates an empty line.
    #[must_use]
    pub const fn new() -> Self {
        Self { text: String::new(), is_too_long: false, is_damaged: false, has_ended: false, last: 0 }
    }

    /// Returns the received part of the line, or the complete line after its end.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Adds a character. `is_damaged` is true if this character, or a character received with it, is damaged. Returns
    /// the condition of a line that the character ends.
    ///
    /// If the beginning of a line is lost together with the previous line, the rest is not [damaged](Arrival::Damaged).
    /// The rest cannot be parsed, because no command ends with another command.
    pub fn push(&mut self, character: u8, is_damaged: bool) -> Option<Arrival> {
        let last = core::mem::replace(&mut self.last, character);
        if character == b'\n' && last == b'\r' {
            return None;
        }
        if core::mem::take(&mut self.has_ended) {
            self.text.clear();
            (self.is_too_long, self.is_damaged) = (false, false);
        }
        self.is_damaged |= is_damaged;
        match character {
            b'\r' | b'\n' => self.has_ended = true,
            BACKSPACE | DELETE => drop(self.text.pop()),
            character => self.is_too_long |= self.text.push(char::from(character)).is_err(),
        }
        self.has_ended.then_some(match self {
            Self { is_damaged: true, .. } => Arrival::Damaged,
            Self { is_too_long: true, .. } => Arrival::TooLong,
            _ => Arrival::Whole,
        })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::{String, ToString as _};
    use std::vec::Vec;
    use std::{format, vec};

    use super::*;
    use crate::console::Command;
    use protocol_core::device::Kind;

    /// Returns the received lines and their conditions; the characters at the indices `damaged` are damaged.
    fn lines(typed: &str, damaged: &[usize]) -> Vec<(String, Arrival)> {
        let mut line = Line::new();
        let arrived = typed.bytes().enumerate().filter_map(|(place, character)| {
            let arrival = line.push(character, damaged.contains(&place))?;
            Some((line.text().to_string(), arrival))
        });
        arrived.collect()
    }

    fn whole(text: &str) -> (String, Arrival) {
        (text.to_string(), Arrival::Whole)
    }

    #[test]
    fn lines_end_as_the_terminal_likes_and_characters_are_taken_back() {
        assert_eq!(lines("status\nhelp\rblank\r\nhelp\n", &[]), ["status", "help", "blank", "help"].map(whole));
        assert_eq!(lines("stut\u{8}\u{7F}atus\n\n", &[]), ["status", ""].map(whole));
    }

    #[test]
    fn a_line_too_long_says_so_and_the_next_one_is_new() {
        let longest = "x".repeat(LONGEST);
        assert_eq!(lines(&format!("{longest}\n{longest}"), &[]), [whole(&longest)]);
        let told = lines(&format!("{longest}x\nhelp\n"), &[]);
        assert_eq!(told, [(longest, Arrival::TooLong), whole("help")]);
    }

    #[test]
    fn a_damaged_character_damages_its_line_and_no_other() {
        let typed = "help\nstatus\nblank\n";
        let first = typed.find("status").expect("a line");
        for place in first..first + "status\n".len() {
            let told = lines(typed, &[place]);
            let arrivals: Vec<_> = told.iter().map(|(_, arrival)| *arrival).collect();
            assert_eq!(arrivals, [Arrival::Whole, Arrival::Damaged, Arrival::Whole], "at {place}");
        }
        assert_eq!(lines("a\u{8}b\n", &[0])[0].1, Arrival::Damaged, "although it was taken back");
    }

    #[test]
    fn the_second_half_of_an_end_belongs_to_no_line() {
        assert_eq!(lines("help\r\nstatus\r\n", &[5]), ["help", "status"].map(whole));
    }

    #[test]
    fn no_command_is_left_of_a_line_without_its_beginning() {
        let mut commands = vec!["status".to_string(), "help".to_string(), "power-cycle".to_string()];
        commands.extend(["blank", "blank 7", "kind hat1000 0x1F"].map(str::to_string));
        commands.extend(Kind::ALL.map(|kind| format!("kind {kind}")));
        for kind in Kind::ALL {
            let plant = crate::plant::Plant::healthy(kind);
            let words = plant.words(protocol_core::time::Instant::MIN).map(|change| change.text().0);
            let values = ["24000", "-5", "0", "on", "off", "ok", "stuck", "write-fails"];
            commands.extend(words.flat_map(|word| values.map(|value| format!("{word} {value}"))));
        }
        for command in commands {
            for lost in 1..command.len() {
                assert_eq!(Command::parse(&command[lost..]), None, "{command:?} without its first {lost}");
            }
        }
    }
}
