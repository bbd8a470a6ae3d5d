//! The text form of a device: `KIND[@ID][,key=value…]`.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

use protocol_core::actuator::SpoolTimes;
use protocol_core::controller::BitRate;
use protocol_core::time::Duration;

use super::NamedDevice;
use crate::Kind;
use crate::world::{Change, Roughness};

/// The accepted keys of a device specification.
const KEYS: &str = "name=, serial=, bit-rate=, stroke-ms=, return-ms=, boot-ms=, answer-ms=, cycle-ms=, brown-out-mv=, noise=, \
     dead-band=, oil, blank";

/// The maximum length of a device name, in characters.
const NAME_MAX: usize = 32;

/// A device as requested by the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceSpec {
    /// The requested name; `None` for a default name.
    pub name: Option<String>,
    /// The device, to which [`named`](super::named) gives its name.
    pub device: NamedDevice,
}

impl DeviceSpec {
    /// Creates a specification of this kind in factory state.
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        Self { name: None, device: NamedDevice::new("", kind) }
    }
}

/// The name of the control interface in traces. No device can have this name.
pub const CONTROL: &str = "http";

impl FromStr for DeviceSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',');
        let head = parts.next().unwrap_or_default();
        let (kind, id) = match head.split_once('@') {
            Some((kind, id)) => (kind, Some(id)),
            None => (head, None),
        };
        let kind = Kind::from_name(kind).ok_or_else(|| {
            let known: Vec<&str> = Kind::ALL.into_iter().map(Kind::name).collect();
            format!("unknown kind '{kind}'; accepted: {}", known.join(", "))
        })?;
        let is_sensor = matches!(kind, Kind::Hat(_));
        let Self { mut name, mut device } = Self::new(kind);
        let NamedDevice { setup, electronics, roughness, .. } = &mut device;
        if let Some(id) = id {
            setup.node_id = Some(node_id(kind, id)?);
        }
        let (mut stroke_ms, mut return_ms) = (SpoolTimes::DEFAULT.stroke_ms(), SpoolTimes::DEFAULT.return_ms());
        let mut has_oil = false;
        for pair in keys(parts) {
            let (key, value) = pair?;
            let given = value.ok_or_else(|| format!("'{key}' needs a value, as in {key}=…"));
            match key {
                "oil" | "blank" if value.is_some() => return Err(format!("'{key}' takes no value")),
                "stroke-ms" | "return-ms" | "oil" if is_sensor => {
                    return Err(format!("'{key}' applies to a valve's spool; a {kind} has none"));
                }
                "brown-out-mv" if is_sensor => {
                    return Err(format!(
                        "'{key}' applies to a valve's supply; the supply of a {kind} is not simulated"
                    ));
                }
                "blank" if !kind.can_be_blank() => {
                    return Err(format!("a {kind} always has an address; give @ID, or omit 'blank' for the default"));
                }
                "blank" if id.is_some() => {
                    return Err("a blank device has no node ID; use either @ID or blank".to_owned());
                }
                "blank" => setup.node_id = None,
                "oil" => has_oil = true,
                "name" => name = Some(device_name(given?)?),
                "bit-rate" => setup.bit_rate = Some(bit_rate_of(kind, given?)?),
                "serial" => setup.serial = Some(serial_number(given?)?),
                "stroke-ms" => stroke_ms = spool_time(given?)?,
                "return-ms" => return_ms = spool_time(given?)?,
                "boot-ms" => electronics.boot = millis(given?, Change::BootMs(0))?,
                "answer-ms" => electronics.answer = answer_times(given?)?,
                "cycle-ms" => electronics.cycle = millis(given?, Change::CycleMs(0))?,
                "brown-out-mv" => electronics.brown_out_mv = Some(brown_out(given?)?),
                "noise" | "dead-band" => {
                    let (max, unit) = match kind {
                        Kind::Pve(_) => (Roughness::MAX_OF_SPOOL, ", 16384 is full stroke"),
                        Kind::Hat(_) => (Roughness::MAX_OF_SHAFT, ", in 1/100 degree"),
                    };
                    let limit = up_to(given?, max, key, unit)?;
                    if key == "noise" { roughness.noise = limit } else { roughness.dead_band = limit }
                }
                _ => return Err(format!("unknown key '{key}'; accepted: {KEYS}")),
            }
        }
        let spool_times = SpoolTimes::new(stroke_ms, return_ms).unwrap_or_default();
        Ok(Self { name, device: NamedDevice { spool_times, has_oil, ..device } })
    }
}

/// Splits the parts of a text into keys with their values, if any. Refuses a key that is given twice.
pub(super) fn keys<'a>(
    parts: impl Iterator<Item = &'a str>,
) -> impl Iterator<Item = Result<(&'a str, Option<&'a str>), String>> {
    let mut seen = Vec::new();
    parts.map(move |part| {
        let (key, value) = part.split_once('=').map_or((part, None), |(key, value)| (key, Some(value)));
        if seen.contains(&key) {
            return Err(format!("duplicate key '{key}'"));
        }
        seen.push(key);
        Ok((key, value))
    })
}

/// Checks the number that a text contains, if any, against a range. `what` names the number, and `unit` ends the
/// message about another text.
pub(super) fn in_range<T: PartialOrd + Display>(
    text: &str,
    number: Option<T>,
    range: RangeInclusive<T>,
    what: &str,
    unit: &str,
) -> Result<T, String> {
    number
        .filter(|number| range.contains(number))
        .ok_or_else(|| format!("'{text}' is not a valid {what}; accepted: {}–{}{unit}", range.start(), range.end()))
}

/// Parses a number up to a limit.
pub(super) fn up_to<T: FromStr + PartialOrd + Display + Default>(
    text: &str,
    max: T,
    what: &str,
    unit: &str,
) -> Result<T, String> {
    in_range(text, text.parse().ok(), T::default()..=max, what, unit)
}

fn node_id(kind: Kind, text: &str) -> Result<u8, String> {
    let range = kind.node_ids();
    number(text).and_then(|id| u8::try_from(id).ok()).filter(|id| range.contains(id)).ok_or_else(|| {
        let (low, high) = (range.start(), range.end());
        format!(
            "'{text}' is not a valid {} of {kind}; accepted: {low}–{high}, or 0x{low:02X}–0x{high:02X}",
            kind.protocol().id_name()
        )
    })
}

/// Parses a bit rate that the kind supports, in bit/s or in a form such as `250k`.
fn bit_rate_of(kind: Kind, text: &str) -> Result<BitRate, String> {
    let rates = kind.bit_rates();
    bit_rate(text).filter(|rate| rates.contains(rate)).ok_or_else(|| {
        let mut rates: Vec<u32> = rates.iter().map(|rate| rate.bits_per_second()).collect();
        rates.sort_unstable();
        let rates: Vec<String> = rates.iter().map(ToString::to_string).collect();
        format!("'{text}' is not a valid bit rate of {kind}; accepted: {}", rates.join(", "))
    })
}

/// Parses a bit rate of CiA 301, in bit/s or in a form such as `250k` or `1M`.
#[must_use]
pub fn bit_rate(text: &str) -> Option<BitRate> {
    let (digits, unit) = match text.char_indices().next_back() {
        Some((end, 'k' | 'K')) => (&text[..end], 1_000),
        Some((end, 'm' | 'M')) => (&text[..end], 1_000_000),
        _ => (text, 1),
    };
    let bits = digits.parse::<u32>().ok().and_then(|number| number.checked_mul(unit));
    bits.and_then(BitRate::from_bits_per_second)
}

/// Parses a spool time in milliseconds.
fn spool_time(text: &str) -> Result<u16, String> {
    in_range(text, text.parse().ok(), SpoolTimes::RANGE_MS, "spool time", ", in milliseconds")
}

/// Returns the range of a plant word.
fn range(word: Change) -> RangeInclusive<i64> {
    let (min, max) = word.word().values.range().unwrap_or_default();
    min.into()..=max.into()
}

/// Parses a time in milliseconds, in the range of a plant word.
fn millis(text: &str, word: Change) -> Result<Duration, String> {
    let ms = in_range(text, number(text).map(i64::from), range(word), "time", ", in milliseconds")?;
    Ok(Duration::from_millis(ms.unsigned_abs()))
}

/// Parses a time or a range of times, in milliseconds: `20` or `5..20`.
fn answer_times(text: &str) -> Result<(Duration, Duration), String> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    let word = Change::AnswerMs(0, 0);
    let times = (millis(from, word)?, millis(to, word)?);
    if times.0 > times.1 {
        return Err(format!("'{text}' is not a valid range; accepted: the smaller time first, as in 5..20"));
    }
    Ok(times)
}

/// Parses an undervoltage limit in millivolts.
fn brown_out(text: &str) -> Result<u32, String> {
    let range = range(Change::BrownOutMv(None));
    in_range(text, number(text).map(i64::from), range, "supply", ", in millivolts").map(|limit| limit as u32)
}

fn serial_number(text: &str) -> Result<u32, String> {
    number(text)
        .ok_or_else(|| format!("'{text}' is not a valid serial number; accepted: 0–{}, or 0x0–0xFFFFFFFF", u32::MAX))
}

fn device_name(text: &str) -> Result<String, String> {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if text.is_empty() || text.len() > NAME_MAX || !text.chars().all(allowed) {
        return Err(format!(
            "'{text}' is not a valid device name; accepted: 1–{NAME_MAX} characters of a–z, 0–9 and '-'"
        ));
    }
    if text == CONTROL {
        return Err(format!("'{text}' is reserved for the control interface; use another name"));
    }
    if is_reserved_by_windows(text) {
        return Err(format!("'{text}' is reserved as a file name on Windows; use another name"));
    }
    Ok(text.to_owned())
}

/// Returns whether a name is reserved by Windows in every folder and with any extension: `con.nvm`, for example, refers
/// to the console.
fn is_reserved_by_windows(name: &str) -> bool {
    let (word, number) = name.split_at(name.len().min(3));
    match word {
        "con" | "prn" | "aux" | "nul" => number.is_empty(),
        "com" | "lpt" => number.len() == 1 && number.bytes().all(|digit| digit.is_ascii_digit()),
        _ => false,
    }
}

/// Parses an unsigned number, decimal, or hexadecimal after `0x`. Signs and blanks are not accepted.
fn number(text: &str) -> Option<u32> {
    let (digits, radix) = match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(hex) => (hex, 16),
        None => (text, 10),
    };
    if !digits.chars().all(|c| c.is_digit(radix)) {
        return None;
    }
    u32::from_str_radix(digits, radix).ok()
}
