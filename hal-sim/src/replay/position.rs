//! The position tolerance: a frame may hold any position that the simulated device passes within the time tolerance. A
//! cyclic frame may also hold any state that the device has within this time.
//!
//! The mapping or the message of a frame defines its position fields. A log frame matches the frame of the simulated
//! device if all other bits are equal, and if the logged values of all position fields belong to one passed position. A
//! device at rest has a single position, so its frames must be equal.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use protocol_core::encoder::STEPS;
use protocol_core::time::{Duration, Instant, after, since};
use protocol_core::wire::nmt;

use super::fields::{bits, state_bits};
use super::item::{Item, PATIENCE};
use crate::Kind;
use crate::world::{NodeId, World};

/// The maximum time between two samples of a changing position.
pub(super) const GRID: Duration = Duration::from_millis(1);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    at: Instant,
    position: i32,
    /// True if the spool floats. The position objects of CANopen then contain the value for float.
    floats: bool,
    /// True if the position moved continuously since the previous sample; false after a jump.
    moved: bool,
    /// The state that the cyclic frames show; `None` before the boot-up message.
    state: Option<u8>,
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

    /// Returns the distance from one sampled position to the next, for a shaft the shorter way round the circle.
    const fn step(&self, from: i32, to: i32) -> i32 {
        let turn = STEPS as i32;
        match self.kind {
            Kind::Hat(_) => (to - from + turn / 2).rem_euclid(turn) - turn / 2,
            _ => to - from,
        }
    }

    /// Returns whether a continuous movement reaches any of `positions`. A movement that reverses may also go further
    /// on either side, by the distance that it covers twice: the command may have come later or earlier.
    fn reaches(&self, movement: &[&Sample], positions: &RangeInclusive<i32>) -> bool {
        let Some(first) = movement.first() else { return false };
        let mut at = first.position;
        let (mut low, mut high, mut up, mut down) = (at, at, 0, 0);
        for (one, other) in movement.iter().zip(movement.iter().skip(1)) {
            let step = self.step(one.position, other.position);
            at += step;
            (low, high) = (low.min(at), high.max(at));
            (up, down) = (up + step.max(0), down - step.min(0));
        }
        let twice = up.min(down).min(high - low);
        let turn = if matches!(self.kind, Kind::Hat(_)) { STEPS as i32 } else { 0 };
        [-turn, 0, turn]
            .into_iter()
            .any(|shift| *positions.start() <= high + twice + shift && low - twice + shift <= *positions.end())
    }

    /// Returns whether the device reaches any of `positions` between two times. `hides_float` is true for fields that
    /// contain the value for float instead of a position.
    fn passes(&self, positions: &RangeInclusive<i32>, hides_float: bool, from: Instant, until: Instant) -> bool {
        let is_hidden = |sample: &&Sample| hides_float && sample.floats;
        let samples: Vec<&Sample> = self.between(from, until).collect();
        let mut movements = samples.chunk_by(|one, other| other.moved && !(is_hidden(one) && is_hidden(other)));
        movements.any(|movement| !movement.iter().all(is_hidden) && self.reaches(movement, positions))
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
            let nmt = view.nmt.filter(|state| *state != nmt::State::Initialising).map(nmt::State::code);
            let state = nmt.or(view.valve.and_then(|valve| valve.command).map(|state| state as u8));
            let last = track.samples.back();
            let moved = moved || last.is_some_and(|last| last.position == position);
            if last.is_none_or(|last| (last.position, last.floats, last.state) != (position, floats, state)) {
                track.samples.push_back(Sample { at, position, floats, moved, state });
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

    /// Returns whether two frames match: they must be equal except for a position and a state that the simulated device
    /// has within the time tolerance.
    pub(super) fn alike(&self, logged: &Item, sent: &Item) -> bool {
        logged.frame == sent.frame || self.differ_in_time(logged, sent).unwrap_or(false)
    }

    fn differ_in_time(&self, logged: &Item, sent: &Item) -> Option<bool> {
        let track = self.tracks.get(sent.device?)?;
        let (frame, fields) = (&logged.frame, &sent.fields);
        let unlike = bits(frame) ^ bits(&sent.frame);
        let position = fields.iter().fold(0, |mask, field| mask | field.mask());
        let state = state_bits(&sent.frame, track.kind);
        let is_like = frame.len() == sent.frame.len() && !frame.is_remote();
        if !is_like || unlike & !(position | state) != 0 {
            return Some(false);
        }
        // Near both frames: the position may not be off by the tolerance in addition to the time.
        let (first, last) = (logged.at.min(sent.at), logged.at.max(sent.at));
        let margin = self.tolerance.max(since(last, first)) + GRID;
        let from = Instant::from_ticks(last.as_ticks().saturating_sub(margin.as_ticks()));
        let until = after(first, margin);
        if unlike & state != 0 {
            let logged = (bits(frame) & state) >> state.trailing_zeros();
            let has_state = |sample: &Sample| sample.state.map(u64::from) == Some(logged);
            if !track.between(from, until).any(has_state) {
                return Some(false);
            }
        }
        if unlike & position == 0 {
            return Some(true);
        }
        let positions = fields.iter().map(|field| field.encoding.decode(field.read(frame)));
        let positions = positions.reduce(|one, two| *one.start().max(two.start())..=*one.end().min(two.end()))?;
        let hides_float = fields.iter().any(|field| field.encoding.encode_float().is_some());
        let is_float = fields.iter().all(|field| field.encoding.encode_float() == Some(field.read(frame)));
        Some(
            !positions.is_empty() && track.passes(&positions, hides_float, from, until)
                || is_float && track.between(from, until).any(|sample| sample.floats),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_a_circle() {
        let reaches = |name, from, to, positions| {
            let track = Track { kind: Kind::from_name(name).unwrap(), samples: VecDeque::new(), looked: Instant::MIN };
            let sample = |position| Sample { at: Instant::MIN, position, floats: false, moved: true, state: None };
            track.reaches(&[&sample(from), &sample(to)], &positions)
        };
        let hat = |from, to, positions| reaches("hat1000", from, to, positions);
        assert!(hat(16_380, 3, 0..=0) && hat(3, 16_380, 16_383..=16_383));
        assert!(!hat(16_380, 3, 8000..=8000) && !hat(16_380, 3, 4..=4));
        let valve = |from, to, positions| reaches("pvea-canopen", from, to, positions);
        assert!(valve(-20, 300, 0..=0) && !valve(-20, 300, 301..=16_384));
    }
}
