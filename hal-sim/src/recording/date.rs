//! The date format of ASC, in UTC, as in `Tue Nov 14 22:13:20.042 2023`. The parser also accepts `10:13:20.042 pm`.

use std::fmt;

use crate::log::Timestamp;

const WEEKDAYS: [&str; 7] = ["Thu", "Fri", "Sat", "Sun", "Mon", "Tue", "Wed"];
const MONTHS: [&str; 12] = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
/// German month names that differ from the English ones.
const GERMAN: [(&str, u32); 4] = [("mär", 3), ("mai", 5), ("okt", 10), ("dez", 12)];

const SECOND: u64 = 1_000_000;
const DAY: u64 = 86_400 * SECOND;

/// A time that is written as a date, with milliseconds.
pub(super) struct Date(pub(super) Timestamp);

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let micros = self.0.as_micros();
        let days = micros / DAY;
        let weekday = WEEKDAYS[(days % 7) as usize];
        let (year, month, day) = civil(days);
        let month = MONTHS[month as usize - 1];
        let (first, rest) = month.split_at(1);
        let (ms, seconds) = (micros / 1000 % 1000, micros % DAY / SECOND);
        let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
        let first = first.to_ascii_uppercase();
        write!(f, "{weekday} {first}{rest} {day:02} {hours:02}:{minutes:02}:{seconds:02}.{ms:03} {year}")
    }
}

/// Parses a date from 1970 to 9999; `None` for any other text.
pub(super) fn parse(text: &str) -> Option<Timestamp> {
    let words: Vec<String> = text.split_whitespace().map(str::to_lowercase).collect();
    let month = |word: &String| {
        let start: String = word.chars().take(3).collect();
        let english = MONTHS.iter().zip(1..).find(|(name, _)| **name == start);
        let german = GERMAN.iter().find(|(name, _)| *name == start);
        english.map(|(_, number)| number).or(german.map(|(_, number)| *number))
    };
    // The first word that begins like a month is the month: no weekday begins with the three letters of a month.
    let (at, month) = words.iter().enumerate().find_map(|(at, word)| Some((at, month(word)?)))?;
    let (day, time, half, year) = match &words[at + 1..] {
        [day, time, half, year, ..] if matches!(half.as_str(), "am" | "pm") => (day, time, half.as_str(), year),
        [day, time, year, ..] => (day, time, "", year),
        _ => return None,
    };
    let day: u32 = day.parse().ok().filter(|day| (1..=31).contains(day))?;
    let year: u64 = year.parse().ok().filter(|year| (1970..=9999).contains(year))?;
    let mut parts = time.splitn(3, ':');
    let mut number = || parts.next()?.parse::<u64>().ok();
    let hours = match (number()?, half) {
        (hours @ 1..=12, "am") => hours % 12,
        (hours @ 1..=12, "pm") => hours % 12 + 12,
        (hours @ 0..=23, "") => hours,
        _ => return None,
    };
    let minutes = number().filter(|minutes| *minutes < 60)?;
    let seconds: Timestamp = parts.next()?.parse().ok()?;
    let seconds = Some(seconds.as_micros()).filter(|seconds| *seconds < 61 * SECOND)?;
    Some(Timestamp::from_micros(days(year, month, day) * DAY + (hours * 60 + minutes) * 60 * SECOND + seconds))
}

/// Returns the number of days from 1970-01-01 to a date. Internally, years begin in March, so that a leap day is the
/// last day of the year.
const fn days(year: u64, month: u32, day: u32) -> u64 {
    let year = if month <= 2 { year - 1 } else { year };
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    year * 365 + year / 4 - year / 100 + year / 400 + day_of_year as u64 - EPOCH
}

/// The number of days from 0000-03-01 to 1970-01-01.
const EPOCH: u64 = 719_468;

/// Returns the year, month and day of a number of days since 1970-01-01.
const fn civil(days: u64) -> (u64, u32, u32) {
    const ERA: u64 = 146_097;
    let days = days + EPOCH;
    let (era, day) = (days / ERA, days % ERA);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    (era * 400 + year + next, month as u32, day as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

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
