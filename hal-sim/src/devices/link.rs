//! The text form of a link: `VALVE=SENSOR[,key=value…]`.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

use protocol_core::encoder::TURN_CDEG;

use super::{DevicesError, NamedDevice, NamedLink};
use crate::Kind;
use crate::world::Link;

/// The maximum speed of a shaft at full stroke, in 1/100 degree per second: 6,000 revolutions per minute (A).
const RATE_MAX: i32 = 3_600_000;

const ANGLES: RangeInclusive<u32> = 0..=TURN_CDEG - 1;

/// Parses a link, without validation of its names.
impl FromStr for NamedLink {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',');
        let head = parts.next().unwrap_or_default();
        let (valve, sensor) =
            head.split_once('=').ok_or_else(|| format!("'{head}' is not a link; accepted: VALVE=SENSOR"))?;
        let mut link = Link::default();
        let mut seen = Vec::new();
        for part in parts {
            let (key, value) = part.split_once('=').unwrap_or((part, ""));
            if seen.contains(&key) {
                return Err(format!("duplicate key '{key}'"));
            }
            seen.push(key);
            match key {
                "rate" => link.rate = rate(value)?,
                "min" => link.min = angle(value)?,
                "max" => link.max = angle(value)?,
                "noise" => link.noise = up_to(value, Link::NOISE_MAX, "noise", ", in percent")?,
                "dead-band" => {
                    link.dead_band = up_to(value, Link::DEAD_BAND_MAX, "dead-band", ", 16384 is full stroke")?
                }
                _ => return Err(format!("unknown key '{key}'; accepted: rate=, min=, max=, noise=, dead-band=")),
            }
        }
        if link.min >= link.max {
            return Err(format!("min={} must be below max={}", link.min, link.max));
        }
        Ok(Self { valve: valve.to_owned(), sensor: sensor.to_owned(), link })
    }
}

fn rate(text: &str) -> Result<i32, String> {
    let rate = text.parse().ok().filter(|rate: &i32| rate.unsigned_abs() <= RATE_MAX.unsigned_abs());
    rate.ok_or_else(|| {
        format!("'{text}' is not a valid rate; accepted: -{RATE_MAX}–{RATE_MAX}, in 1/100 degree per second")
    })
}

/// Parses a number up to a limit.
pub(super) fn up_to<T: FromStr + PartialOrd + Display>(
    text: &str,
    max: T,
    what: &str,
    unit: &str,
) -> Result<T, String> {
    let number = text.parse().ok().filter(|number| *number <= max);
    number.ok_or_else(|| format!("'{text}' is not a valid {what}; accepted: 0–{max}{unit}"))
}

fn angle(text: &str) -> Result<u32, String> {
    text.parse().ok().filter(|angle| ANGLES.contains(angle)).ok_or_else(|| {
        format!("'{text}' is not a valid end stop; accepted: {}–{}, in 1/100 degree", ANGLES.start(), ANGLES.end())
    })
}

/// Rejects a link unless it names a valve and an angle sensor on the bus, and no earlier link has the same sensor.
///
/// # Errors
/// [`DevicesError::UnknownDevice`] or [`DevicesError::LinkedTwice`].
pub fn refuse_bad_links(devices: &[NamedDevice], links: &[NamedLink]) -> Result<(), DevicesError> {
    let check = |name: &str, wanted: fn(Kind) -> bool, product| {
        let fitting = || devices.iter().filter(|device| wanted(device.setup.kind)).map(|device| &device.name);
        if fitting().any(|known| known == name) {
            return Ok(());
        }
        Err(DevicesError::UnknownDevice { product, name: name.to_owned(), known: fitting().cloned().collect() })
    };
    for (place, NamedLink { valve, sensor, .. }) in links.iter().enumerate() {
        check(valve, |kind| matches!(kind, Kind::Pve(_)), "valve")?;
        check(sensor, |kind| matches!(kind, Kind::Hat(_)), "angle sensor")?;
        if links[..place].iter().any(|other| other.sensor == *sensor) {
            return Err(DevicesError::LinkedTwice(sensor.clone()));
        }
    }
    Ok(())
}
