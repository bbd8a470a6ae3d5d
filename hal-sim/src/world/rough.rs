//! Rough mechanics: a spool with noise and a dead-band, and a shaft with play and a noisy angle measurement.
//!
//! The noise is a function of the seed and the time and changes every [`NOISE_STEP`]; a read never changes the noise.

use protocol_core::actuator::{self, Position};
use protocol_core::device::Inputs;
use protocol_core::encoder::{Shaft, TURN_CDEG};
use protocol_core::time::{Duration, Instant, NEVER};

use super::{NodeId, World};

/// The interval between two noise values (A).
pub const NOISE_STEP: Duration = Duration::from_millis(10);

/// The roughness of a valve's spool in position units, or of a sensor's shaft in 1/100 degree (A). The default is no
/// roughness.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Roughness {
    /// The largest deviation, in both directions, from the set-point of a spool or from the angle of a shaft.
    pub noise: u16,
    /// The largest set-point change that the spool ignores, or the play between shaft and sensor in each direction.
    pub dead_band: u16,
}

impl Roughness {
    /// The maximum noise and the maximum dead-band of a spool: its full stroke (A).
    pub const MAX_OF_SPOOL: u16 = Position::FULL.unsigned_abs();
    /// The maximum noise and the maximum play of a shaft: a quarter of a turn (A).
    pub const MAX_OF_SHAFT: u16 = (TURN_CDEG / 4) as u16;
}

/// The state of rough mechanics.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    settings: Roughness,
    seed: u64,
    /// The time of the next deviation of a spool; [`NEVER`] without noise.
    pub(super) next: Instant,
    /// The angle behind the play, on the side of the sensor; `None` before the first sample.
    seen: Option<u32>,
}

impl Default for State {
    fn default() -> Self {
        Self { settings: Roughness::default(), seed: 0, next: NEVER, seen: None }
    }
}

/// Returns the noise at an instant: a number from −`limit` to `limit`.
pub(super) fn noise(seed: u64, limit: u16, at: Instant) -> i32 {
    /// The factor by which neighbouring steps get seeds that differ in many bits.
    const SPREAD: u64 = 0x9E37_79B9_7F4A_7C15;
    let limit = i32::from(limit);
    let step = at.as_ticks() / NOISE_STEP.as_ticks();
    fastrand::Rng::with_seed(seed ^ step.wrapping_mul(SPREAD)).i32(-limit..=limit)
}

/// Returns the next time after `at` at which the noise changes.
pub(super) fn next_step(at: Instant) -> Instant {
    let step = at.as_ticks() / NOISE_STEP.as_ticks() + 1;
    step.checked_mul(NOISE_STEP.as_ticks()).map_or(NEVER, Instant::from_ticks)
}

impl State {
    /// Returns whether the angle that a sensor measures can differ from the angle of its shaft.
    pub(super) fn is_rough_shaft(&self, inputs: &Inputs) -> bool {
        self.settings != Roughness::default() && inputs.shaft().is_some()
    }

    /// Returns the inputs that the device senses: the angle of a rough shaft includes play and noise. Updates the play.
    pub(super) fn sensed(&mut self, inputs: &Inputs, now: Instant) -> Inputs {
        let mut sensed = *inputs;
        if self.is_rough_shaft(inputs)
            && let Some(shaft) = sensed.shaft_mut()
        {
            let truth = shaft.angle_at(now);
            self.seen = Some(self.played(truth));
            let measuring_error = shaft.measuring_error;
            *shaft = Shaft { measuring_error, ..Shaft::at(self.angle_of(truth, now)) };
        }
        sensed
    }

    /// Returns the angle that the sensor measures at the instant `at` for the shaft angle `truth`. The shaft must have
    /// turned in only one direction since the last sample.
    pub(super) fn angle_of(&self, truth: u32, at: Instant) -> u32 {
        let noise = i64::from(noise(self.seed, self.settings.noise, at));
        turned(self.played(truth), noise)
    }

    /// Returns the angle behind the play for an angle of the shaft.
    fn played(&self, truth: u32) -> u32 {
        let (half, turn) = (i64::from(TURN_CDEG / 2), i64::from(TURN_CDEG));
        let seen = self.seen.unwrap_or(truth);
        // The shorter way round from the angle behind the play to the angle of the shaft.
        let ahead = (i64::from(truth) - i64::from(seen) + half).rem_euclid(turn) - half;
        let play = i64::from(self.settings.dead_band);
        turned(seen, ahead - ahead.clamp(-play, play))
    }
}

fn turned(angle_cdeg: u32, by: i64) -> u32 {
    (i64::from(angle_cdeg) + by).rem_euclid(i64::from(TURN_CDEG)) as u32
}

impl World {
    /// Sets the roughness of a valve's spool or a sensor's shaft. Values above the limits are reduced to the limits.
    pub fn set_roughness(&mut self, node: NodeId, Roughness { noise, dead_band }: Roughness) {
        let is_shaft = self.inputs(node).shaft().is_some();
        let max = if is_shaft { Roughness::MAX_OF_SHAFT } else { Roughness::MAX_OF_SPOOL };
        let settings = Roughness { noise: noise.min(max), dead_band: dead_band.min(max) };
        let seed = if settings.noise > 0 { self.random.u64(..) } else { 0 };
        let trembles = !is_shaft && settings.noise > 0;
        let next = if trembles { next_step(self.now) } else { NEVER };
        let state = &mut self.nodes[node.0];
        state.rough = State { settings, seed, next, seen: None };
        if let Some(valve) = state.inputs.valve_mut() {
            valve.spool.roughness = actuator::Roughness { dead_band: settings.dead_band, ..Default::default() };
        }
        self.set_inputs(node, *self.inputs(node));
    }

    /// Applies the current noise to a spool, and schedules the next change.
    pub(super) fn tremble(&mut self, node: NodeId) {
        let (now, state) = (self.now, &mut self.nodes[node.0]);
        state.rough.next = next_step(now);
        if let Some(valve) = state.inputs.valve_mut() {
            valve.spool.roughness.offset = Position::clamped(noise(state.rough.seed, state.rough.settings.noise, now));
            state.electronics.has_new_inputs = true;
        }
    }
}

#[cfg(test)]
#[path = "rough_tests.rs"]
mod tests;
