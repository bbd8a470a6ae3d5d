//! The text form of a link: `VALVE=SENSOR[,key=value…]`.

use std::str::FromStr;

use protocol_core::encoder::TURN_CDEG;

use super::spec::{in_range, keys, up_to};
use super::{NamedDevice, NamedLink};
use crate::Kind;
use crate::world::Link;

/// The maximum speed of a shaft at full stroke, in 1/100 degree per second: 6,000 revolutions per minute (A).
const RATE_MAX: i32 = 3_600_000;

/// Parses a link, without validation of its names.
impl FromStr for NamedLink {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',');
        let head = parts.next().unwrap_or_default();
        let (valve, sensor) =
            head.split_once('=').ok_or_else(|| format!("'{head}' is not a link; accepted: VALVE=SENSOR"))?;
        let mut link = Link::default();
        for pair in keys(parts) {
            let (key, value) = pair?;
            let value = value.unwrap_or_default();
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
    in_range(text, text.parse().ok(), -RATE_MAX..=RATE_MAX, "rate", ", in 1/100 degree per second")
}

fn angle(text: &str) -> Result<u32, String> {
    in_range(text, text.parse().ok(), 0..=TURN_CDEG - 1, "end stop", ", in 1/100 degree")
}

/// Rejects a link unless it names a valve and an angle sensor on the bus, and no earlier link has the same sensor.
///
/// # Errors
/// A message with the reason and the remedy.
pub fn refuse_bad_links(devices: &[NamedDevice], links: &[NamedLink]) -> Result<(), String> {
    let check = |name: &str, wanted: fn(Kind) -> bool, product| {
        let fitting = devices.iter().filter(|device| wanted(device.setup.kind)).map(|device| device.name.as_str());
        let known: Vec<&str> = fitting.collect();
        match known.as_slice() {
            known if known.contains(&name) => Ok(()),
            [] => Err(format!("no {product} '{name}' on the bus; add one")),
            known => Err(format!("no {product} '{name}' on the bus; accepted: {}", known.join(", "))),
        }
    };
    for (place, NamedLink { valve, sensor, .. }) in links.iter().enumerate() {
        check(valve, |kind| matches!(kind, Kind::Pve(_)), "valve")?;
        check(sensor, |kind| matches!(kind, Kind::Hat(_)), "angle sensor")?;
        if links[..place].iter().any(|other| other.sensor == *sensor) {
            return Err(format!("{sensor} is linked twice; a sensor follows one valve only"));
        }
    }
    Ok(())
}
