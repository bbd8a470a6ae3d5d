//! The replay report: describes the differences between a log and its replay.

use std::fmt;

use protocol_core::frame::Frame;
use protocol_core::time::Duration;

use super::{Outcome, ReplayOptions};
use crate::log::Timestamp;

/// A difference between a log and its replay: a log frame not sent as logged, or an additional sent frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The time of the logged frame, or of the additional frame, in log time.
    pub at: Timestamp,
    /// The line or packet number in the log; `None` for an additional frame.
    pub number: Option<u64>,
    /// The kind of the difference.
    pub what: What,
    /// The logged frame and its explanation.
    pub logged: Option<(Frame, String)>,
    /// The sent frame and its explanation.
    pub sent: Option<(Frame, String)>,
}

/// The kind of a difference between a replay and its log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// The frame was not sent.
    Missing,
    /// The frame is not in the log.
    Additional,
    /// The frame was sent with different data.
    Different,
    /// The frame was sent earlier by this time.
    Early(Duration),
    /// The frame was sent later by this time.
    Late(Duration),
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |time: &Duration| format!("{}.{:03} ms", time.as_micros() / 1000, time.as_micros() % 1000);
        match self {
            Self::Missing => f.write_str("missing"),
            Self::Additional => f.write_str("additional"),
            Self::Different => f.write_str("different data"),
            Self::Early(time) => write!(f, "{} too early", ms(time)),
            Self::Late(time) => write!(f, "{} too late", ms(time)),
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "({}) ", self.at)?;
        if let Some(number) = self.number {
            write!(f, "line {number}: ")?;
        }
        write!(f, "{}", self.what)?;
        for (who, frame) in [("log", &self.logged), ("simulated", &self.sent)] {
            if let Some((frame, meaning)) = frame {
                write!(f, "\n  {who:<9} {:<35}  {meaning}", frame.to_string())?;
            }
        }
        Ok(())
    }
}

impl Outcome {
    /// Returns the differences and a summary as lines of text.
    #[must_use]
    pub fn report(&self, options: &ReplayOptions) -> String {
        let names: Vec<&str> = options.devices.iter().map(|device| device.name.as_str()).collect();
        let mut text: String = self.told.iter().map(|difference| format!("{difference}\n")).collect();
        let more = self.differences - self.told.len() as u64;
        if more > 0 {
            text += &format!("and {more} more\n");
        }
        let count = |count: u64, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
        let differences = match self.differences {
            0 => "no differences".to_owned(),
            differences => count(differences, "difference"),
        };
        let left_out = match self.error_frames {
            0 => String::new(),
            frames => format!(", {} skipped", count(frames, "error frame")),
        };
        let skipped = match self.skipped {
            0 => String::new(),
            1 => ", 1 entry before the first boot-up or address claim skipped".to_owned(),
            entries => format!(", {entries} entries before the first boot-up or address claim skipped"),
        };
        let power_up = |(name, entry): (&&str, &Option<u64>)| match entry {
            Some(number) => format!("{name} aligned with line {number}"),
            None => format!("{name} on before the log"),
        };
        let power_ups: Vec<String> = names.iter().zip(&self.power_ups).map(power_up).collect();
        text += &format!(
            "{} of {} compared within {} ms: {differences}; {} of other nodes sent{left_out}{skipped}; \
             power-up not compared: {}\n",
            count(self.compared, "frame"),
            names.join(", "),
            options.tolerance.as_millis(),
            count(self.played, "frame"),
            power_ups.join(", ")
        );
        text
    }
}
