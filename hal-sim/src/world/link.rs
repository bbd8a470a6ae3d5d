//! Links: the shaft angle of a sensor follows the integral of a valve's spool position.
//!
//! The flow is proportional to the spool position, and the spool position is piecewise linear in time. The integral is
//! therefore a sum of trapezoids, computed in integers. The integral is updated when the shaft is read or the valve
//! changes; the number of updates does not affect the result.

use protocol_core::actuator::{Position, Valve};
use protocol_core::device::Inputs;
use protocol_core::encoder::{Shaft, TURN_CDEG};
use protocol_core::time::{Duration, Instant, after, since};

use super::node::{Node, Power};
use super::rough::{self, Play};
use super::{NodeId, World};

/// The parameters of a link between a valve and a sensor's shaft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// The speed at full stroke towards the B-port, in 1/100 degree per second. Negative values decrease the angle.
    pub rate: i32,
    /// The lower end stop, inclusive, in 1/100 degree.
    pub min: u32,
    /// The upper end stop, inclusive, in 1/100 degree: at least `min`, and less than one turn.
    pub max: u32,
    /// The largest deviation of the speed, in percent, up to 100. The deviation changes every
    /// [`NOISE_STEP`](super::NOISE_STEP).
    pub noise: u8,
    /// The overlap of the spool: the largest deflection without flow, from 0 to 16384. Beyond this deflection, the
    /// speed rises from 0 to `rate` at full stroke.
    pub dead_band: u16,
}

impl Link {
    /// The largest noise, in percent (A).
    pub const NOISE_MAX: u8 = 100;
    /// The largest dead-band: the full stroke (A).
    pub const DEAD_BAND_MAX: u16 = Position::FULL.unsigned_abs();
}

impl Default for Link {
    /// Returns a link with 30 degrees per second between 0 and 90 degrees, without noise and dead-band (A, SPEC 9).
    fn default() -> Self {
        Self { rate: 3_000, min: 0, max: 9_000, noise: 0, dead_band: 0 }
    }
}

/// The reason why two devices cannot be linked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The first device is not a valve.
    #[error("the first device is not a valve")]
    NoValve,
    /// The second device is not an angle sensor.
    #[error("the second device is not an angle sensor")]
    NoSensor,
    /// The sensor's shaft already follows a valve.
    #[error("the sensor is already linked")]
    Linked,
    /// The lower end stop is above the upper end stop, or the upper end stop is not less than one turn.
    #[error("end stops must be 0 to 35999 in 1/100 degree, and min must not exceed max")]
    Stops,
    /// The noise or the dead-band is above its limit.
    #[error("the noise must be 0 to 100 percent, and the dead-band 0 to 16384")]
    Roughness,
}

const PERCENT: i128 = 100;

/// The opening of a valve per unit of the spool position.
const UNIT: i128 = Valve::STROKE as i128 / Position::FULL as i128;

const MICROSECOND: Duration = Duration::from_micros(1);

/// An active link.
#[derive(Clone, Debug)]
pub(super) struct Coupling {
    valve: NodeId,
    sensor: NodeId,
    link: Link,
    /// The angle at the time `reckoned`, in internal units: [`cdeg`] units are 1/100 degree.
    angle: i128,
    reckoned: Instant,
    /// The seed of the noise.
    seed: u64,
}

/// Returns the number of internal angle units in 1/100 degree: the stroke beyond the dead-band in units of
/// [`Valve::opening`], times the microseconds of a second, times 2, times 100. The factor 2 avoids the fraction 1/2 of
/// the trapezoid formula, the factor 100 the fractions of the noise in percent.
fn cdeg(link: &Link) -> i128 {
    // With the largest dead-band, nothing flows, and any unit is right.
    let stroke = i128::from((Link::DEAD_BAND_MAX - link.dead_band).max(1)) * UNIT;
    2 * stroke * 1_000_000 * PERCENT
}

impl World {
    /// Links a sensor's shaft to a valve. A shaft outside the end stops moves to the nearest end stop; a rotating shaft
    /// stops.
    ///
    /// # Errors
    /// [`LinkError`] if the devices cannot be linked or a parameter is invalid.
    pub fn link(&mut self, valve: NodeId, sensor: NodeId, link: Link) -> Result<(), LinkError> {
        if self.inputs(valve).valve().is_none() {
            return Err(LinkError::NoValve);
        }
        let shaft = *self.inputs(sensor).shaft().ok_or(LinkError::NoSensor)?;
        if self.is_linked(sensor) {
            return Err(LinkError::Linked);
        }
        if link.min > link.max || link.max >= TURN_CDEG {
            return Err(LinkError::Stops);
        }
        if link.noise > Link::NOISE_MAX || link.dead_band > Link::DEAD_BAND_MAX {
            return Err(LinkError::Roughness);
        }
        let seed = if link.noise > 0 { self.random.u64(..) } else { 0 };
        let angle_cdeg = shaft.angle_at(self.now).clamp(link.min, link.max);
        let angle = i128::from(angle_cdeg) * cdeg(&link);
        let mut inputs = *self.inputs(sensor);
        if let Some(shaft) = inputs.shaft_mut() {
            *shaft = Shaft { measuring_error: shaft.measuring_error, ..Shaft::at(angle_cdeg) };
        }
        self.set_inputs(sensor, inputs);
        self.couplings.push(Coupling { valve, sensor, link, angle, reckoned: self.now, seed });
        Ok(())
    }

    /// Returns whether the shaft of a device follows a valve.
    #[must_use]
    pub fn is_linked(&self, sensor: NodeId) -> bool {
        self.coupling_of(sensor).is_some()
    }

    /// Returns the current shaft angle of a device, in 1/100 degree; `None` for a device without a shaft.
    #[must_use]
    pub fn angle_cdeg(&self, node: NodeId) -> Option<u32> {
        let shaft = self.nodes[node.0].inputs.shaft()?;
        let linked = self.coupling_of(node);
        Some(linked.map_or_else(|| shaft.angle_at(self.now), |coupling| coupling.at(self, self.now).0))
    }

    /// Returns whether a device is a valve that no shaft follows.
    pub(crate) fn has_free_spool(&self, node: NodeId) -> bool {
        self.inputs(node).valve().is_some() && self.couplings.iter().all(|coupling| coupling.valve != node)
    }

    /// Returns the link that a sensor's shaft follows.
    pub(super) fn coupling_of(&self, sensor: NodeId) -> Option<&Coupling> {
        self.couplings.iter().find(|coupling| coupling.sensor == sensor)
    }

    /// Updates the links of a device to the current time, before a valve changes or a sensor is served. A sensor with a
    /// slow cycle senses its shaft in the next cycle.
    pub(super) fn follow_links(&mut self, node: NodeId) {
        if !self.couplings.is_empty() {
            self.follow_links_of(node);
        }
    }

    #[inline(never)]
    fn follow_links_of(&mut self, node: NodeId) {
        for number in 0..self.couplings.len() {
            let Coupling { valve, sensor, .. } = self.couplings[number];
            if valve != node && sensor != node {
                continue;
            }
            let play = self.nodes[sensor.0].rough.play;
            let (angle, play) = self.couplings[number].reckon(self.valve(valve), play, self.now);
            let coupling = &mut self.couplings[number];
            (coupling.angle, coupling.reckoned) = (angle, self.now);
            let angle_cdeg = coupling.angle_cdeg(angle);
            let node = &mut self.nodes[sensor.0];
            node.rough.play = play;
            if let Some(shaft) = node.inputs.shaft_mut()
                && shaft.angle_cdeg != angle_cdeg
            {
                shaft.angle_cdeg = angle_cdeg;
                if node.electronics.is_slow() {
                    node.electronics.has_new_inputs = true;
                } else {
                    node.sense(self.now);
                }
            }
        }
    }

    /// Sets the angle of a linked shaft. The link continues from this angle.
    pub(super) fn turn_link(&mut self, sensor: NodeId, angle_cdeg: u32) {
        if let Some(coupling) = self.couplings.iter_mut().find(|coupling| coupling.sensor == sensor) {
            coupling.angle = i128::from(angle_cdeg) * cdeg(&coupling.link);
        }
    }

    /// Returns a sensor's inputs with the angle from its link, which must be up to date. Without a link, returns the
    /// inputs unchanged.
    pub(super) fn as_linked(&self, sensor: NodeId, mut inputs: Inputs) -> Inputs {
        if let Some(coupling) = self.coupling_of(sensor)
            && let Some(shaft) = inputs.shaft_mut()
        {
            let measuring_error = shaft.measuring_error;
            *shaft = Shaft { measuring_error, ..Shaft::at(coupling.angle_cdeg(coupling.angle)) };
        }
        inputs
    }

    /// Returns the valve of a device, which only its springs move while the program does not run; `None` for a sensor.
    pub(super) fn valve(&self, node: NodeId) -> Option<&Valve> {
        let Node { power, released, .. } = &self.nodes[node.0];
        match power {
            Power::On(device) => device.valve(),
            Power::Off | Power::Coming(..) => released.as_ref(),
        }
    }
}

impl Coupling {
    /// Returns the angle in 1/100 degree and the play at an instant that is not before the last update. The valve must
    /// not change before this instant.
    pub(super) fn at(&self, world: &World, at: Instant) -> (u32, Play) {
        let play = world.nodes[self.sensor.0].rough.play;
        let (angle, play) = self.reckon(world.valve(self.valve), play, at);
        (self.angle_cdeg(angle), play)
    }

    /// Returns the maximum speed of the shaft, in 1/100 degree per second.
    pub(super) const fn max_speed(&self) -> u64 {
        (self.link.rate.unsigned_abs() as u64 * (100 + self.link.noise as u64)).div_ceil(100)
    }

    fn angle_cdeg(&self, angle: i128) -> u32 {
        u32::try_from(angle.div_euclid(cdeg(&self.link))).unwrap_or(0)
    }

    /// Returns the angle at `now`, in internal units, and the play, which was `play` at the last update. `now` must not
    /// be before the last update, and the valve must not have changed since the last update.
    fn reckon(&self, valve: Option<&Valve>, mut play: Play, now: Instant) -> (i128, Play) {
        let Some(valve) = valve else { return (self.angle, play) };
        let (mut angle, mut at) = (self.angle, self.reckoned);
        while at < now {
            let end = valve.bends(at).min(now);
            let (from, to) = (i128::from(valve.opening(at)), i128::from(valve.opening(end)));
            let band = i128::from(self.link.dead_band) * UNIT;
            let flow = |opening: i128| opening - opening.clamp(-band, band);
            // The flow bends where the spool enters or leaves the dead-band; without a dead-band, at neutral. The
            // interval is split into three parts: the time up to the microsecond of the crossing, this microsecond, and
            // the rest.
            let micros = i128::from(since(end, at).as_micros());
            let crossings = [band, -band].into_iter().filter(|level| (from - level) * (to - level) < 0);
            let passes = crossings.map(|level| (from - level) * micros / (from - to)).min();
            let end = match passes {
                Some(passes) => {
                    let passes = Duration::from_micros(u64::try_from(passes).unwrap_or(0));
                    after(at, passes.max(MICROSECOND)).min(end)
                }
                None if flow(from) == 0 && flow(to) == 0 => {
                    at = end;
                    continue;
                }
                None => end,
            };
            let (end, speed) = match self.link.noise {
                0 => (end, PERCENT),
                noise => {
                    let noise = rough::noise(self.seed, noise.into(), at);
                    (end.min(rough::next_step(at)), PERCENT + i128::from(noise))
                }
            };
            let to = i128::from(valve.opening(end));
            let before = angle;
            angle = self.moved(angle, (flow(from) + flow(to)) * i128::from(since(end, at).as_micros()) * speed);
            // Within an interval, the shaft turns in one direction.
            if !play.is_none() {
                play.turn(i64::from(self.angle_cdeg(angle)) - i64::from(self.angle_cdeg(before)));
            }
            at = end;
        }
        (angle, play)
    }

    /// Adds the rotation caused by a flow to an angle, limited by the end stops. A shaft beyond a stop can only move
    /// inwards.
    fn moved(&self, angle: i128, flow: i128) -> i128 {
        let [min, max] = [self.link.min, self.link.max].map(|stop| i128::from(stop) * cdeg(&self.link));
        let turned = flow * i128::from(self.link.rate);
        if turned > 0 { (angle + turned).min(max).max(angle) } else { (angle + turned).max(min).min(angle) }
    }
}
