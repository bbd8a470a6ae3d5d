//! Rough mechanics: a spool with noise and a dead-band, and a shaft with play and a noisy angle measurement.
//!
//! The noise is a function of the seed and the time and changes every [`NOISE_STEP`]; a read never changes the noise.

use protocol_core::actuator::{self, Position};
use protocol_core::device::Inputs;
use protocol_core::encoder::{Shaft, TURN_CDEG};
use protocol_core::time::{Duration, Instant, NEVER, since};

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
    /// The play of a shaft at the time `updated`.
    pub(super) play: Play,
    updated: Instant,
}

impl Default for State {
    fn default() -> Self {
        Self { settings: Roughness::default(), seed: 0, next: NEVER, play: Play::default(), updated: Instant::MIN }
    }
}

/// The play between a shaft and its sensor, in 1/100 degree. The play depends only on the motion of the shaft, not on
/// the samples of the sensor.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Play {
    /// The largest offset in each direction; 0 until the first start of the device.
    limit: i64,
    /// The angle behind the play, on the side of the sensor, minus the angle of the shaft.
    offset: i64,
}

impl Play {
    pub(super) const fn is_none(self) -> bool {
        self.limit == 0
    }

    /// Turns the shaft in one direction.
    pub(super) fn turn(&mut self, by: i64) {
        self.offset = (self.offset - by).clamp(-self.limit, self.limit);
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

    /// Returns the inputs that the device senses: the angle of a rough shaft includes play and noise.
    pub(super) fn sensed(&self, inputs: &Inputs, now: Instant) -> Inputs {
        let mut sensed = *inputs;
        if let Some(shaft) = sensed.shaft_mut() {
            *shaft = self.measured(shaft, now);
        }
        sensed
    }

    /// Returns a shaft as its sensor measures it at `now`, with play and noise.
    pub(super) fn measured(&self, shaft: &Shaft, now: Instant) -> Shaft {
        if self.settings == Roughness::default() {
            return *shaft;
        }
        let noise = i64::from(noise(self.seed, self.settings.noise, now));
        let angle = i64::from(shaft.angle_at(now)) + self.play_at(shaft, now).offset + noise;
        Shaft { measuring_error: shaft.measuring_error, ..Shaft::at(angle.rem_euclid(TURN) as u32) }
    }

    /// Begins the play of a shaft, in its middle (A), at the first start of the device.
    pub(super) fn start(&mut self, now: Instant) {
        if self.play.is_none() {
            (self.play.limit, self.updated) = (self.settings.dead_band.into(), now);
        }
    }

    /// Updates the play for a change of the shaft's motion. If the angle jumps, the shaft turns the shorter way round.
    pub(super) fn change_motion(&mut self, from: &Shaft, to: &Shaft, now: Instant) {
        self.play = self.play_at(from, now);
        let jump = i64::from(to.angle_at(now)) - i64::from(from.angle_at(now));
        self.play.turn((jump + TURN / 2).rem_euclid(TURN) - TURN / 2);
        self.updated = now;
    }

    /// Returns the play at `now` of a shaft whose motion has not changed since the last update.
    fn play_at(&self, shaft: &Shaft, now: Instant) -> Play {
        let mut play = self.play;
        play.turn(rotation(shaft, self.updated, now));
        play
    }
}

const TURN: i64 = TURN_CDEG as i64;

/// Returns the rotation of a shaft between two instants, in 1/100 degree. From three quarters of a turn, more than any
/// play, the result is a whole turn.
fn rotation(shaft: &Shaft, from: Instant, to: Instant) -> i64 {
    /// The time for three quarters of a turn, at one turn per minute.
    const THREE_QUARTERS: Duration = Duration::from_secs(45);
    let direction = i64::from(shaft.speed_rpm.signum());
    let micros = since(to, from.max(shaft.since)).as_micros();
    if micros.saturating_mul(shaft.speed_rpm.unsigned_abs().into()) >= THREE_QUARTERS.as_micros() {
        return direction * TURN;
    }
    // The difference of rounded angles: a rotation in several parts has the same result.
    let turned = i64::from(shaft.angle_at(to)) - i64::from(shaft.angle_at(from));
    direction * (direction * turned).rem_euclid(TURN)
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
        let is_powered = self.is_powered(node);
        let state = &mut self.nodes[node.0];
        state.rough = State { settings, seed, next, ..State::default() };
        if is_powered {
            state.rough.start(self.now);
        }
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
