//! The view of a device at the current virtual time, and predictions of its position.

use std::ops::RangeInclusive;

use protocol_core::device::View;
use protocol_core::encoder::{POSITION_MAX, STEPS, Shaft, TURN_CDEG};
use protocol_core::time::{Duration, Instant, NEVER, after, since};
use protocol_core::wire::pdo_mapping::MappingEntry;

use super::node::Node;
use super::{NodeId, World, rough};

/// The maximum step in the search for a position change of a linked shaft. A spool that passes neutral reverses the
/// shaft; within one step, the shaft cannot leave a position and return.
const LINKED_STEP: Duration = Duration::from_micros(64);

const SECOND: Duration = Duration::from_secs(1);

const MINUTE: Duration = Duration::from_secs(60);

impl World {
    /// Returns the current view of a device; `None` without power. The view changes nothing: a copy of the device samples
    /// a linked or rough shaft.
    #[must_use]
    pub fn view(&self, node: NodeId) -> Option<View> {
        let device = self.on(node)?;
        let view = device.view(self.now);
        if !self.is_linked(node) && !self.is_rough_shaft(node) {
            return Some(view);
        }
        let (mut copy, mut inputs) = (device.boxed(), *self.inputs(node));
        if let (Some(shaft), Some(measured)) = (inputs.shaft_mut(), self.measured(node, self.now)) {
            *shaft = measured;
        }
        copy.sense(&inputs, self.now);
        // Between the cycles of a slow device, the copy may have sensed a fault that the device has not sensed yet.
        Some(View { position: copy.view(self.now).position, ..view })
    }

    /// Returns the first time at which the position of a device can enter a range, if no event occurs until then;
    /// `limit` at the latest. The position must be outside the range now, and may still be outside at the returned
    /// time.
    #[must_use]
    pub fn next_inside(&self, node: NodeId, range: &RangeInclusive<i16>, limit: Instant) -> Instant {
        let Some(valve) = self.valve(node) else {
            if self.inputs(node).shaft().is_none() {
                return limit;
            }
            return match self.is_linked(node) || self.is_rough_shaft(node) {
                true => self.next_position(node, limit),
                false => self.outside_until(node, range).max(after(self.now, Duration::from_ticks(1))).min(limit),
            };
        };
        // The spool moves in one direction between two bends of its path.
        let end = valve.bends(self.now).min(limit);
        let side = |at| {
            let position = self.position_at(node, at);
            (position > i64::from(*range.end())) as i8 - (position < i64::from(*range.start())) as i8
        };
        let here = side(self.now);
        if end <= self.now || side(end) == here {
            return end;
        }
        self.first(|at| side(at) != here, self.now, end)
    }

    /// Returns the [key](protocol_core::frame::Frame::key) and the mapped objects of TPDO 1 of a device; `None` while
    /// the device is unpowered or the TPDO is disabled.
    #[must_use]
    pub fn tpdo(&self, node: NodeId) -> Option<(u32, &[MappingEntry])> {
        self.on(node)?.tpdo()
    }

    /// Returns the position of the spool of a valve, with or without power; `None` for another device.
    #[must_use]
    pub fn spool_position(&self, node: NodeId) -> Option<i16> {
        Some(self.valve(node)?.position(self.now).raw())
    }

    /// Returns whether the spool of a valve floats. The position objects then contain the value for float (SPEC 2).
    #[must_use]
    pub fn floats(&self, node: NodeId) -> bool {
        self.valve(node).is_some_and(|valve| valve.float_reached(self.now))
    }

    /// Returns the next time at which the position of a device can change without further events; `limit` at the
    /// latest.
    #[must_use]
    pub fn next_position(&self, node: NodeId, limit: Instant) -> Instant {
        let now = self.now;
        let longest = if self.coupling_of(node).is_some() { LINKED_STEP } else { Duration::MAX };
        // The spool moves in one direction between two bends of its path, and passes each position once.
        let limit = self.valve(node).map_or(limit, |valve| valve.bends(now).min(limit));
        let is_rough = self.is_rough_shaft(node);
        let limit = if is_rough { limit.min(rough::next_step(now)) } else { limit };
        let here = self.position_at(node, now);
        let (mut same, mut step) = (now, Duration::from_ticks(1));
        while same < limit {
            let next = after(same, step).min(limit);
            if self.position_at(node, next) != here {
                return self.first(|at| self.position_at(node, at) != here, same, next);
            }
            same = next;
            step = Duration::from_ticks(step.as_ticks().saturating_mul(2)).min(longest);
        }
        limit
    }

    /// Returns a time until which the position of a device stays outside a range, unless an event occurs. The position
    /// must be outside the range now. For a rotating shaft without a link, the result is close to the latest such time.
    /// For a linked shaft, the result is calculated with the maximum speed. For a spool or a rough shaft, the result is
    /// the current time.
    #[must_use]
    pub fn outside_until(&self, node: NodeId, range: &RangeInclusive<i16>) -> Instant {
        let Some(shaft) = self.inputs(node).shaft().filter(|_| !self.is_rough_shaft(node)) else { return self.now };
        let Some(view) = self.view(node) else { return NEVER };
        let position = i64::from(view.position);
        let (min, max) = (i64::from(*range.start()).max(0), i64::from(*range.end()).min(POSITION_MAX.into()));
        if min > max {
            return NEVER;
        }
        // The shorter way round the circle, less one step, because the shaft may already be at the edge of its current
        // step.
        let turn = i64::from(STEPS);
        let steps = (min - position).rem_euclid(turn).min((position - max).rem_euclid(turn));
        let whole_steps = u64::try_from(steps - 1).unwrap_or(0);
        let micros = match self.coupling_of(node) {
            Some(coupling) => {
                let steps_a_second = u64::from(STEPS) * coupling.max_speed();
                (whole_steps * SECOND.as_micros() * u64::from(TURN_CDEG)).checked_div(steps_a_second)
            }
            None => {
                let steps_a_minute = u64::from(STEPS) * u64::from(shaft.speed_rpm.unsigned_abs());
                (whole_steps * MINUTE.as_micros()).checked_div(steps_a_minute)
            }
        };
        micros.map_or(NEVER, |micros| after(self.now, Duration::from_micros(micros)))
    }

    fn is_rough_shaft(&self, node: NodeId) -> bool {
        let Node { rough, inputs, .. } = &self.nodes[node.0];
        rough.is_rough_shaft(inputs)
    }

    /// Finds by bisection the first time at which `holds` is true. `holds` must be false at `before` and true at
    /// `then`.
    fn first(&self, holds: impl Fn(Instant) -> bool, mut before: Instant, mut then: Instant) -> Instant {
        while since(then, before) > Duration::from_ticks(1) {
            let middle = after(before, Duration::from_ticks(since(then, before).as_ticks() / 2));
            if holds(middle) {
                then = middle;
            } else {
                before = middle;
            }
        }
        then
    }

    /// Returns the position of a spool, or the raw position of a shaft, at the instant `at` if no event occurs until
    /// then. `at` must not be in the past.
    fn position_at(&self, node: NodeId, at: Instant) -> i64 {
        match (self.measured(node, at), self.valve(node)) {
            (Some(shaft), _) => shaft.position_at(at).into(),
            (None, Some(valve)) => valve.position(at).raw().into(),
            (None, None) => 0,
        }
    }

    /// Returns a shaft as its sensor measures it at the instant `at` if no event occurs until then. `at` must not be in
    /// the past.
    fn measured(&self, node: NodeId, at: Instant) -> Option<Shaft> {
        let Node { inputs, rough, .. } = &self.nodes[node.0];
        let (mut shaft, mut rough) = (*inputs.shaft()?, *rough);
        if let Some(coupling) = self.coupling_of(node) {
            (shaft.angle_cdeg, rough.play) = coupling.at(self, at);
        }
        Some(rough.measured(&shaft, at))
    }
}
