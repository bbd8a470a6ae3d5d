//! The position tolerance: a frame may hold any position that the simulated device passes within the time tolerance.
//!
//! The mapping or the message of a frame defines its position fields. A log frame matches the frame of the simulated
//! device if all other bits are equal, and if the logged values of all position fields belong to one passed position. A
//! device at rest has a single position, so its frames must be equal.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use protocol_core::encoder::STEPS;
use protocol_core::time::{Duration, Instant, after};

use super::fields::bits;
use super::item::{Item, PATIENCE};
use crate::Kind;
use crate::world::{NodeId, World};

/// The maximum time between two samples of a changing position.
pub(super) const GRID: Duration = Duration::from_millis(1);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    at: Instant,
    position: i32,
    /// True if the spool floats. The position objects then contain the value for float.
    floats: bool,
    /// True if the position moved continuously since the previous sample; false after a jump.
    moved: bool,
}

/// The positions of a device over time.
#[derive(Debug)]
struct Track {
    kind: Kind,
    samples: VecDeque<Sample>,
    /// The time at which the position was last sampled.
    looked: Instant,
}

impl Track {
    /// Returns the samples up to `until`, beginning with the last sample at or before `from`.
    fn between(&self, from: Instant, until: Instant) -> impl Iterator<Item = &Sample> + Clone {
        let first = self.samples.partition_point(|sample| sample.at <= from).saturating_sub(1);
        self.samples.iter().skip(first).take_while(move |sample| sample.at <= until)
    }

    /// Returns whether the movement from one sampled position to the next passes any of `positions`.
    fn is_between(&self, from: i32, to: i32, positions: &RangeInclusive<i32>) -> bool {
        let turn = STEPS as i32;
        let passed = |by: i32| from.min(from + by)..=from.max(from + by);
        let overlaps = |passed: &RangeInclusive<i32>, shift: i32| {
            *positions.start() <= passed.end() + shift && passed.start() + shift <= *positions.end()
        };
        if matches!(self.kind, Kind::Hat(_)) {
            // The shorter way round the circle.
            let passed = passed((to - from + turn / 2).rem_euclid(turn) - turn / 2);
            [-turn, 0, turn].into_iter().any(|shift| overlaps(&passed, shift))
        } else {
            overlaps(&passed(to - from), 0)
        }
    }

    /// Returns whether the device reaches any of `positions` between two times.
    fn passes(&self, positions: &RangeInclusive<i32>, from: Instant, until: Instant) -> bool {
        let samples = self.between(from, until);
        let is_at = |sample: &Sample| !sample.floats && positions.contains(&sample.position);
        let passes = |(one, other): (&Sample, &Sample)| {
            other.moved && !(one.floats && other.floats) && self.is_between(one.position, other.position, positions)
        };
        samples.clone().any(is_at) || samples.clone().zip(samples.skip(1)).any(passes)
    }
}

/// The positions of all simulated devices over time, and the resulting tolerance of frames.
#[derive(Debug)]
pub(super) struct PositionTolerance {
    tracks: Vec<Track>,
    tolerance: Duration,
}

impl PositionTolerance {
    pub(super) fn new(kinds: impl Iterator<Item = Kind>, tolerance: Duration) -> Self {
        let track = |kind| Track { kind, samples: VecDeque::new(), looked: Instant::MIN };
        Self { tracks: kinds.map(track).collect(), tolerance }
    }

    /// Samples the positions of the devices and records the changes.
    pub(super) fn sample(&mut self, world: &mut World, nodes: &[NodeId]) {
        let at = world.now();
        for (track, node) in self.tracks.iter_mut().zip(nodes) {
            let moved = std::mem::replace(&mut track.looked, at) < at;
            let Some(view) = world.view(*node) else { continue };
            let (position, floats) = (i32::from(view.position), world.floats(*node));
            if track.samples.back().is_none_or(|last| (last.position, last.floats) != (position, floats)) {
                track.samples.push_back(Sample { at, position, floats, moved });
            }
        }
    }

    /// Drops the samples too old to match any frame after `known`, the time up to which all frames are known.
    pub(super) fn forget(&mut self, known: Instant) {
        let needed = (PATIENCE + self.tolerance + GRID) * 4;
        let from = Instant::from_ticks(known.as_ticks().saturating_sub(needed.as_ticks()));
        for Track { samples, .. } in &mut self.tracks {
            while samples.get(1).is_some_and(|sample| sample.at < from) {
                samples.pop_front();
            }
        }
    }

    /// Returns whether two frames match: they must be equal except for a position that the simulated device reaches
    /// within the time tolerance.
    pub(super) fn alike(&self, logged: &Item, sent: &Item) -> bool {
        logged.frame == sent.frame || self.differ_in_position(logged, sent).unwrap_or(false)
    }

    fn differ_in_position(&self, logged: &Item, sent: &Item) -> Option<bool> {
        let (frame, fields) = (&logged.frame, &sent.fields);
        let mask = fields.iter().fold(0, |mask, field| mask | field.mask());
        let is_like = frame.len() == sent.frame.len() && !frame.is_remote();
        if mask == 0 || !is_like || (bits(frame) ^ bits(&sent.frame)) & !mask != 0 {
            return Some(false);
        }
        let track = self.tracks.get(sent.device?)?;
        let margin = self.tolerance + GRID;
        let (first, last) = (logged.at.min(sent.at), logged.at.max(sent.at));
        let from = Instant::from_ticks(first.as_ticks().saturating_sub(margin.as_ticks()));
        let until = after(last, margin);
        let positions = fields.iter().map(|field| field.encoding.decode(field.read(frame)));
        let positions = positions.reduce(|one, two| *one.start().max(two.start())..=*one.end().min(two.end()))?;
        let is_float = fields.iter().all(|field| field.encoding.encode_float() == Some(field.read(frame)));
        Some(
            !positions.is_empty() && track.passes(&positions, from, until)
                || is_float && track.between(from, until).any(|sample| sample.floats),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_a_circle() {
        let track = |kind| Track { kind, samples: VecDeque::new(), looked: Instant::MIN };
        let hat = track(Kind::from_name("hat1000").unwrap());
        assert!(hat.is_between(16_380, 3, &(0..=0)) && hat.is_between(3, 16_380, &(16_383..=16_383)));
        assert!(!hat.is_between(16_380, 3, &(8000..=8000)) && !hat.is_between(16_380, 3, &(4..=4)));
        let valve = track(Kind::from_name("pvea-canopen").unwrap());
        assert!(valve.is_between(-20, 300, &(0..=0)) && !valve.is_between(-20, 300, &(301..=16_384)));
    }
}
