//! The text form of a device: `KIND[@ID][,key=value…]`.

use std::str::FromStr;

use protocol_core::actuator::SpoolTimes;
use protocol_core::controller::BitRate;
use protocol_core::device::Setup;
use protocol_core::time::Duration;

use crate::Kind;
use crate::world::{Change, Electronics, Roughness};

use super::link::up_to;

/// The accepted keys of a device specification.
const KEYS: &str = "name=, serial=, bit-rate=, stroke-ms=, return-ms=, boot-ms=, answer-ms=, cycle-ms=, brown-out-mv=, noise=, \
     dead-band=, oil, blank";

/// The maximum length of a device name, in characters.
const NAME_MAX: usize = 32;

/// A device as requested by the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceSpec {
    /// The kind and the initial content of a new memory.
    pub setup: Setup,
    /// The requested name; `None` for a default name.
    pub name: Option<String>,
    /// The spool times of a valve.
    pub spool_times: SpoolTimes,
    /// True if a valve's spool times depend on the temperature.
    pub has_oil: bool,
    /// The delays and the undervoltage limit of the electronics.
    pub electronics: Electronics,
    /// The roughness of the spool or the shaft.
    pub roughness: Roughness,
}

impl DeviceSpec {
    /// Creates a specification of this kind in factory state.
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        Self {
            setup: kind.into(),
            name: None,
            spool_times: SpoolTimes::DEFAULT,
            has_oil: false,
            electronics: Electronics::default(),
            roughness: Roughness::default(),
        }
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
        let mut spec = Self::new(kind);
        if let Some(id) = id {
            spec.setup.node_id = Some(node_id(kind, id)?);
        }
        let mut seen = Vec::new();
        let (mut stroke_ms, mut return_ms) = (SpoolTimes::DEFAULT.stroke_ms(), SpoolTimes::DEFAULT.return_ms());
        for part in parts {
            let (key, value) = match part.split_once('=') {
                Some((key, value)) => (key, Some(value)),
                None => (part, None),
            };
            if seen.contains(&key) {
                return Err(format!("duplicate key '{key}'"));
            }
            seen.push(key);
            match (key, value) {
                ("name", Some(name)) => spec.name = Some(device_name(name)?),
                ("bit-rate", Some(rate)) => spec.setup.bit_rate = Some(bit_rate_of(kind, rate)?),
                ("serial", Some(serial)) => spec.setup.serial = Some(serial_number(serial)?),
                ("stroke-ms" | "return-ms", _) if matches!(kind, Kind::Hat(_)) => {
                    return Err(format!("'{key}' applies to a valve's spool; a {kind} has none"));
                }
                ("stroke-ms", Some(time)) => stroke_ms = spool_time(time)?,
                ("return-ms", Some(time)) => return_ms = spool_time(time)?,
                ("boot-ms", Some(time)) => spec.electronics.boot = millis(time, Change::BootMs(0))?,
                ("answer-ms", Some(times)) => spec.electronics.answer = answer_times(times)?,
                ("cycle-ms", Some(time)) => spec.electronics.cycle = millis(time, Change::CycleMs(0))?,
                ("brown-out-mv", _) if matches!(kind, Kind::Hat(_)) => {
                    return Err(format!(
                        "'{key}' applies to a valve's supply; the supply of a {kind} is not simulated"
                    ));
                }
                ("brown-out-mv", Some(supply)) => spec.electronics.brown_out_mv = Some(brown_out(supply)?),
                ("noise", Some(noise)) => spec.roughness.noise = roughness(kind, noise, "noise")?,
                ("dead-band", Some(band)) => spec.roughness.dead_band = roughness(kind, band, "dead-band")?,
                ("oil", None) if matches!(kind, Kind::Hat(_)) => {
                    return Err(format!("'oil' applies to a valve's spool; a {kind} has none"));
                }
                ("oil", None) => spec.has_oil = true,
                ("blank", None) if !kind.can_be_blank() => {
                    return Err(format!("a {kind} always has an address; give @ID, or omit 'blank' for the default"));
                }
                ("blank", None) if id.is_some() => {
                    return Err("a blank device has no node ID; use either @ID or blank".to_owned());
                }
                ("blank", None) => spec.setup.node_id = None,
                ("oil", Some(_)) => return Err("'oil' takes no value".to_owned()),
                ("blank", Some(_)) => return Err("'blank' takes no value".to_owned()),
                (
                    "name" | "serial" | "bit-rate" | "stroke-ms" | "return-ms" | "boot-ms" | "answer-ms" | "cycle-ms"
                    | "brown-out-mv" | "noise" | "dead-band",
                    None,
                ) => {
                    return Err(format!("'{key}' needs a value, as in {key}=…"));
                }
                _ => return Err(format!("unknown key '{key}'; accepted: {KEYS}")),
            }
        }
        Ok(Self { spool_times: SpoolTimes::new(stroke_ms, return_ms).unwrap_or_default(), ..spec })
    }
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
    let range = SpoolTimes::RANGE_MS;
    text.parse().ok().filter(|time| range.contains(time)).ok_or_else(|| {
        format!("'{text}' is not a valid spool time; accepted: {}–{}, in milliseconds", range.start(), range.end())
    })
}

/// Returns the range of a plant word.
fn range(word: Change) -> (i64, i64) {
    word.word().values.range().map_or((0, 0), |(min, max)| (min.into(), max.into()))
}

/// Parses a time in milliseconds, in the range of a plant word.
fn millis(text: &str, word: Change) -> Result<Duration, String> {
    let (min, max) = range(word);
    let ms = number(text).filter(|ms| (min..=max).contains(&i64::from(*ms)));
    ms.map(|ms| Duration::from_millis(ms.into()))
        .ok_or_else(|| format!("'{text}' is not a valid time; accepted: {min}–{max}, in milliseconds"))
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
    let (min, max) = range(Change::BrownOutMv(None));
    let limit = number(text).filter(|limit| (min..=max).contains(&i64::from(*limit)));
    limit.ok_or_else(|| format!("'{text}' is not a valid supply; accepted: {min}–{max}, in millivolts"))
}

/// Parses the noise or the dead-band of a spool or a shaft.
fn roughness(kind: Kind, text: &str, what: &str) -> Result<u16, String> {
    match kind {
        Kind::Pve(_) => up_to(text, Roughness::MAX_OF_SPOOL, what, ", 16384 is full stroke"),
        Kind::Hat(_) => up_to(text, Roughness::MAX_OF_SHAFT, what, ", in 1/100 degree"),
    }
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
