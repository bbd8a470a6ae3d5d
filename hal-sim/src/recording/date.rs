//! The date format of ASC, in UTC, as in `Tue Nov 14 22:13:20.042 2023`. The parser also accepts `10:13:20.042 pm`.

use std::fmt;

use chrono::{DateTime, Month, NaiveDateTime};

use crate::log::Timestamp;

/// A time that is written as a date, with milliseconds. A time after the year 262,142 is written as 1970-01-01.
pub(super) struct Date(pub(super) Timestamp);

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let micros = i64::try_from(self.0.as_micros()).ok();
        let date = micros.and_then(DateTime::from_timestamp_micros).unwrap_or_default();
        date.format("%a %b %d %H:%M:%S%.3f %Y").fmt(f)
    }
}

/// Parses a date from 1970 on; `None` for any other text.
pub(super) fn parse(text: &str) -> Option<Timestamp> {
    let words: Vec<String> = text.split_whitespace().map(str::to_lowercase).collect();
    let month = |word: &String| {
        let start: String = word.chars().take(3).collect();
        match start.as_str() {
            // German names that differ from the English ones.
            "mär" => Some(Month::March),
            "mai" => Some(Month::May),
            "okt" => Some(Month::October),
            "dez" => Some(Month::December),
            english => english.parse().ok(),
        }
    };
    // The first word that begins like a month is the month: no weekday begins with the three letters of a month.
    let (at, month) = words.iter().enumerate().find_map(|(at, word)| Some((at, month(word)?.number_from_month())))?;
    let (text, format) = match &words[at + 1..] {
        [day, time, half, year, ..] if matches!(half.as_str(), "am" | "pm") => {
            (format!("{year}-{month}-{day} {time} {half}"), "%Y-%m-%d %I:%M:%S%.f %p")
        }
        [day, time, year, ..] => (format!("{year}-{month}-{day} {time}"), "%Y-%m-%d %H:%M:%S%.f"),
        _ => return None,
    };
    let micros = NaiveDateTime::parse_from_str(&text, format).ok()?.and_utc().timestamp_micros();
    u64::try_from(micros).ok().map(Timestamp::from_micros)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A day in microseconds.
    const DAY: u64 = 86_400_000_000;

    #[test]
    fn dates_of_every_spelling() {
        let at = Timestamp::from_micros(1_700_000_000_042_000);
        assert_eq!(Date(at).to_string(), "Tue Nov 14 22:13:20.042 2023");
        for text in
            ["Tue Nov 14 22:13:20.042 2023", "Tue Nov 14 10:13:20.042 pm 2023", "Die Nov 14 10:13:20.042 PM 2023"]
        {
            assert_eq!(parse(text), Some(at), "{text}");
        }
        assert_eq!(parse("Don Mär 1 12:00:00 am 1973"), Some(Timestamp::from_micros(1155 * DAY)));
        assert_eq!(Date(Timestamp::from_micros(0)).to_string(), "Thu Jan 01 00:00:00.000 1970");
        for text in
            ["", "Nov", "Nov 14 2023", "Nov 0 10:00:00 2023", "Nov 1 24:00:00 2023", "Nov 1 10:60:00 2023", "x y z"]
        {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    /// Every day of 250 years, including leap days and the year 2100, which is not a leap year.
    #[test]
    fn every_day_is_read_as_it_was_written() {
        for day in 0..250 * 365 {
            let at = Timestamp::from_micros(day * DAY + day % 1000 * 1000);
            assert_eq!(parse(&Date(at).to_string()), Some(at));
        }
    }
}
