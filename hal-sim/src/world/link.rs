//! A valve moves what a sensor measures: the shaft follows the integral of the valve's spool.
//!
//! The flow is linear in the spool's position, and the spool moves along straight lines in time, so the integral is a
//! sum of trapezoids in whole numbers. It is reckoned when somebody looks at the shaft or something happens to the
//! valve, and comes out the same however often that is.

use protocol_core::actuator::Valve;
use protocol_core::device::Inputs;
use protocol_core::encoder::{Shaft, TURN_CDEG};
use protocol_core::time::{Duration, Instant, after, since};

use super::node::Power;
use super::{NodeId, World};

/// How a sensor's shaft follows a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// The speed at full stroke towards the B-port, in 1/100 degree a second; negative: the angle falls.
    pub rate: i32,
    /// The lower end stop, in 1/100 degree: the angle can come to it.
    pub min: u32,
    /// The upper end stop, in 1/100 degree: the angle can come to it. At least the lower one, below a turn.
    pub max: u32,
}

impl Default for Link {
    /// Returns 30 degrees a second, from 0 to 90 degrees (A, SPEC 9).
    fn default() -> Self {
        Self { rate: 3_000, min: 0, max: 9_000 }
    }
}

/// Two devices cannot be linked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// The first one is an encoder.
    #[error("not a valve")]
    NoValve,
    /// The second one has no shaft.
    #[error("not an angle sensor")]
    NoSensor,
    /// The shaft follows another valve.
    #[error("the sensor is linked already")]
    Linked,
    /// The end stops are not in order, or not below a turn.
    #[error("no end stops: 0 to 35999 1/100 degree, the lower first")]
    Stops,
}

/// 1/100 degree in the unit of the integral: twice the parts of the full stroke in a second, for the halves of
/// trapezoids.
const CDEG: i128 = 2 * Valve::STROKE as i128 * 1_000_000;

const MICROSECOND: Duration = Duration::from_micros(1);

/// A link at work.
#[derive(Clone, Debug)]
pub(super) struct Coupling {
    valve: NodeId,
    sensor: NodeId,
    link: Link,
    /// The angle at `reckoned`, in parts of [`CDEG`].
    angle: i128,
    reckoned: Instant,
}

impl World {
    /// Lets the shaft of a sensor follow a valve. A shaft that is beyond an end stop is put to it, one that turns
    /// stands.
    ///
    /// # Errors
    /// [`LinkError`] for what cannot be linked.
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
        let angle_cdeg = shaft.angle_at(self.now).clamp(link.min, link.max);
        let angle = i128::from(angle_cdeg) * CDEG;
        self.couplings.push(Coupling { valve, sensor, link, angle, reckoned: self.now });
        self.set_inputs(sensor, *self.inputs(sensor));
        Ok(())
    }

    /// Returns whether the shaft of a device follows a valve.
    #[must_use]
    pub fn is_linked(&self, sensor: NodeId) -> bool {
        self.coupling_of(sensor).is_some()
    }

    /// Returns the angle of a device's shaft now, in 1/100 degree; `None` for a device without one.
    #[must_use]
    pub fn angle_cdeg(&self, node: NodeId) -> Option<u32> {
        let shaft = self.nodes[node.0].inputs.shaft()?;
        let linked = self.coupling_of(node);
        Some(linked.map_or_else(|| shaft.angle_at(self.now), |coupling| coupling.angle_at(self, self.now)))
    }

    /// Returns the link that a sensor's shaft follows.
    pub(super) fn coupling_of(&self, sensor: NodeId) -> Option<&Coupling> {
        self.couplings.iter().find(|coupling| coupling.sensor == sensor)
    }

    /// Brings the links of a device up to now: before anything happens to a valve, and before a sensor looks at its
    /// shaft.
    #[inline]
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
            let angle = self.couplings[number].reckon(self.valve(valve), self.now);
            let coupling = &mut self.couplings[number];
            (coupling.angle, coupling.reckoned) = (angle, self.now);
            let angle_cdeg = coupling.angle_cdeg(angle);
            let node = &mut self.nodes[sensor.0];
            if let Some(shaft) = node.inputs.shaft_mut()
                && shaft.angle_cdeg != angle_cdeg
            {
                shaft.angle_cdeg = angle_cdeg;
                if let Power::On(device) = &mut node.power {
                    device.sense(&node.inputs, self.now);
                }
            }
        }
    }

    /// Takes note of an angle that was set from outside: the link goes on from there.
    pub(super) fn turn_link(&mut self, sensor: NodeId, angle_cdeg: u32) {
        if let Some(coupling) = self.couplings.iter_mut().find(|coupling| coupling.sensor == sensor) {
            coupling.angle = i128::from(angle_cdeg) * CDEG;
        }
    }

    /// Inputs with the angle of the link, which is up to date, in the place of their own.
    pub(super) fn as_linked(&self, sensor: NodeId, mut inputs: Inputs) -> Inputs {
        if let Some(coupling) = self.couplings.iter().find(|coupling| coupling.sensor == sensor)
            && let Some(shaft) = inputs.shaft_mut()
        {
            let measuring_error = shaft.measuring_error;
            *shaft = Shaft { measuring_error, ..Shaft::at(coupling.angle_cdeg(coupling.angle)) };
        }
        inputs
    }

    /// Returns the valve of a device that is powered. Without power its spool counts as in neutral (A), as at its next
    /// start.
    pub(super) fn valve(&self, node: NodeId) -> Option<&Valve> {
        match &self.nodes[node.0].power {
            Power::On(device) => device.valve(),
            _ => None,
        }
    }
}

impl Coupling {
    /// Returns the angle at an instant from the last one reckoned on, in 1/100 degree, if nothing else happens to the
    /// valve.
    pub(super) fn angle_at(&self, world: &World, at: Instant) -> u32 {
        self.angle_cdeg(self.reckon(world.valve(self.valve), at))
    }

    /// Returns the speed at full stroke, in 1/100 degree a second: the shaft turns no faster.
    pub(super) const fn rate(&self) -> i32 {
        self.link.rate
    }

    fn angle_cdeg(&self, angle: i128) -> u32 {
        u32::try_from(angle.div_euclid(CDEG)).unwrap_or(0)
    }

    /// Returns the angle at `now`, which is not before the last one reckoned. Nothing has happened to the valve in
    /// between.
    fn reckon(&self, valve: Option<&Valve>, now: Instant) -> i128 {
        let Some(valve) = valve else { return self.angle };
        let (mut angle, mut at) = (self.angle, self.reckoned);
        while at < now {
            let end = valve.bends(at).min(now);
            let (from, to) = (i128::from(valve.opening(at)), i128::from(valve.opening(end)));
            if from == 0 && to == 0 {
                at = end;
                continue;
            }
            // A spool that passes neutral turns the flow: up to the microsecond in which it does, that one, and the
            // rest.
            let micros = i128::from(since(end, at).as_micros());
            let end = if from * to < 0 {
                let passes = Duration::from_micros(u64::try_from(from * micros / (from - to)).unwrap_or(0));
                after(at, passes.max(MICROSECOND)).min(end)
            } else {
                end
            };
            let to = i128::from(valve.opening(end));
            angle = self.moved(angle, (from + to) * i128::from(since(end, at).as_micros()));
            at = end;
        }
        angle
    }

    /// Returns the angle after so much flow. A stop holds the shaft, and one that is beyond it already goes no further.
    fn moved(&self, angle: i128, flow: i128) -> i128 {
        let (min, max) = (i128::from(self.link.min) * CDEG, i128::from(self.link.max) * CDEG);
        let turned = flow * i128::from(self.link.rate);
        if turned > 0 { (angle + turned).min(max).max(angle) } else { (angle + turned).max(min).min(angle) }
    }
}
