//! The golden run: a run of the scenario without a fault, as the reference for cells.

use std::collections::BTreeMap;

use protocol_core::device::View;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::master::{Master, Subject};
use super::oracles::{SAMPLE, next_sample};
use super::plan::Plan;
use super::rig::Rig;
use crate::scenario::Target as _;
use crate::scenario::runner::Watch;
use crate::simulation::{Happened, Simulation};
use crate::state::digits;
use crate::world::NodeId;

/// The largest difference between positions that count as equal: 2 % of a valve's stroke or of a shaft's turn.
const TOLERANCE: i32 = 328;

/// The reason why a campaign cannot run: the run without a fault fails, proves a detection, or lacks frames that the plan
/// needs; or the plan has too many cells.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct CampaignError(pub(super) String);

#[derive(Debug)]
pub(super) struct Golden {
    pub(super) seed: u64,
    devices: Vec<NodeId>,
    /// The states of all devices at each sample instant, from 0.
    samples: Vec<Sample>,
    /// The instants of the faults.
    pub(super) instants: Vec<Instant>,
    /// The last frame with each identifier that is sent within the observation time after every fault instant, by
    /// [`Frame::key`].
    pub(super) identifiers: BTreeMap<u32, Frame>,
}

/// The part of a device's state that is compared with the golden run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sample {
    position: i16,
    /// NMT state, device state machine, command, solenoids, power and active faults, as bits.
    state: u32,
}

/// The bits of a state that are independent of the set-point: all but command and solenoids.
const LASTING: u32 = !0xF2;

impl Sample {
    fn of(view: Option<&View>) -> Self {
        let Some(view) = view else { return Self::default() };
        let faults = view.faults.iter().fold(0, |bits, fault| bits << 1 | u32::from(fault.active));
        let valve = view.valve;
        let code = |code: Option<u32>| code.map_or(0, |code| code + 1) & 0xF;
        let nmt = code(view.nmt.map(|state| state as u32));
        let dsm = code(valve.and_then(|valve| valve.dsm).map(|state| state as u32));
        let command = code(valve.and_then(|valve| valve.command).map(|state| state as u32));
        let solenoids = u32::from(valve.is_some_and(|valve| valve.solenoids));
        let state = faults << 16 | nmt << 12 | dsm << 8 | command << 4 | solenoids << 1 | 1;
        Self { position: view.position, state }
    }
}

impl Golden {
    /// Runs the scenario without a fault.
    ///
    /// # Errors
    /// [`CampaignError`]
    pub(super) fn run<M: Master>(plan: &Plan, master: &M, seed: u64) -> Result<Self, CampaignError> {
        let mut rig = Rig::new(plan, master, seed, false);
        let devices: Vec<NodeId> = rig.target.simulation().devices().iter().map(|(node, _)| *node).collect();
        let from = after(Instant::from_ticks(0), Duration::from_millis(plan.instants.from_ms.into()));
        let to = after(Instant::from_ticks(0), Duration::from_millis(plan.instants.to_ms.into()));
        let end = after(to, plan.observe + SAMPLE);
        let mut frames = Frames { from, to, ends: Vec::new(), identifiers: BTreeMap::new() };
        let mut samples = Vec::new();
        let mut now = Instant::from_ticks(0);
        while now <= end {
            if now > from && !rig.oracles.have_begun() {
                rig.pass(from, &mut frames);
                rig.oracles.begin(None, rig.target.simulation());
            }
            rig.pass(now, &mut frames);
            rig.oracles.look(rig.target.simulation());
            let world = rig.target.simulation().world();
            samples.extend(devices.iter().map(|node| Sample::of(world.peek(*node).as_ref())));
            if let Some(detected) = rig.oracles.detected() {
                let at_ms = after(from, detected).as_millis();
                return Err(CampaignError(format!(
                    "detected: the proof holds without a fault, at {at_ms} ms (seed {seed}), and so proves nothing"
                )));
            }
            now = next_sample(now);
        }
        let (is_alive, unknown) = (rig.target.is_alive(), rig.oracles.unknown());
        rig.run.advance(&mut rig.target, NEVER, &mut ());
        let outcome = rig.run.outcome(rig.target.simulation());
        if !is_alive {
            return Err(CampaignError(format!("the controller ended early in the run without a fault (seed {seed})")));
        }
        if !outcome.is_success() {
            let failures = outcome.failures(&plan.path);
            let reason = format!("the scenario fails without a fault (seed {seed}):\n{}", failures.trim_end());
            return Err(CampaignError(reason));
        }
        if let Some(id) = unknown {
            let reason = format!("detected: no frame {} comes without a fault, so its end proves nothing", digits(id));
            return Err(CampaignError(reason));
        }
        let (instants, identifiers) = frames.finish(plan, end);
        if instants.is_empty() {
            return Err(CampaignError("instants: no frame ends between from_ms and to_ms".to_owned()));
        }
        Ok(Self { seed, devices, samples, instants, identifiers })
    }

    /// Returns power, NMT state, device state machine and active faults of each device, as bits.
    pub(super) fn states(&self, simulation: &Simulation) -> Vec<u32> {
        self.all_states(simulation).map(|state| state & LASTING).collect()
    }

    /// Returns the bits of [`states`](Self::states), with those of command and solenoids.
    pub(super) fn all_states(&self, simulation: &Simulation) -> impl Iterator<Item = u32> {
        self.devices.iter().map(|node| Sample::of(simulation.world().peek(*node).as_ref()).state)
    }

    /// Returns whether the bits of each device, as in [`states`](Self::states), are those in `before` or those of any
    /// sample of the golden run between two instants.
    pub(super) fn is_among(&self, before: &[u32], (from, to): (Instant, Instant), simulation: &Simulation) -> bool {
        let golden = self.between(number(from), number(to));
        self.states(simulation).iter().zip(before).enumerate().all(|(place, (state, before))| {
            state == before || golden.clone().any(|samples| samples[place].state & LASTING == *state)
        })
    }

    /// Returns whether each device matches the golden run at the current sample instant. A change may come up to one
    /// sample early or late, because an additional frame on the bus delays other frames.
    pub(super) fn is_as(&self, simulation: &Simulation) -> bool {
        let now = number(simulation.now());
        let golden = self.between(now.saturating_sub(1), now + 1);
        self.devices.iter().enumerate().all(|(place, node)| {
            let found = Sample::of(simulation.world().peek(*node).as_ref());
            let mut near = golden.clone().map(|samples| samples[place]);
            let positions = near.clone().map(|sample| i32::from(sample.position));
            let (min, max) = positions.fold((i32::MAX, i32::MIN), |(min, max), it| (min.min(it), max.max(it)));
            let is_near = (min - TOLERANCE..=max + TOLERANCE).contains(&i32::from(found.position));
            is_near && near.any(|sample| sample.state == found.state)
        })
    }

    /// Returns the states of all devices at the samples with the numbers from `first` to `last`.
    fn between(&self, first: usize, last: usize) -> impl Iterator<Item = &[Sample]> + Clone {
        let samples = self.samples.chunks(self.devices.len());
        samples.take(last + 1).skip(first)
    }
}

/// Returns the number of the last sample up to an instant.
fn number(at: Instant) -> usize {
    (at.as_ticks() / SAMPLE.as_ticks()) as usize
}

/// The frames of a golden run.
struct Frames {
    from: Instant,
    to: Instant,
    /// The ends of the frames from the first to the last fault instant.
    ends: Vec<Instant>,
    identifiers: BTreeMap<u32, Seen>,
}

/// The frames with one identifier.
struct Seen {
    frame: Frame,
    last: Instant,
    /// The longest time without such a frame, from the first fault instant on.
    gap: Duration,
}

impl Watch for Frames {
    fn event(&mut self, happened: &Happened) {
        let (Some(frame), at) = (happened.event.frame(), happened.event.at) else { return };
        if (self.from..=self.to).contains(&at) && self.ends.last() != Some(&at) {
            self.ends.push(at);
        }
        if at > self.from && !frame.is_remote() {
            let first = Seen { frame: *frame, last: self.from, gap: Duration::from_ticks(0) };
            let seen = self.identifiers.entry(frame.key()).or_insert(first);
            seen.gap = seen.gap.max(since(at, seen.last));
            (seen.frame, seen.last) = (*frame, at);
        }
    }
}

impl Frames {
    fn finish(self, plan: &Plan, end: Instant) -> (Vec<Instant>, BTreeMap<u32, Frame>) {
        let grid = plan.instants;
        let instants = match grid.step_ms {
            None => self.ends,
            Some(step) => {
                let ms = (grid.from_ms..=grid.to_ms).step_by(usize::try_from(step.get()).unwrap_or(usize::MAX));
                ms.map(|ms| Instant::from_millis(ms.into())).collect()
            }
        };
        let comes = |seen: &Seen| seen.gap.max(since(end, seen.last)) < plan.observe;
        let identifiers = self.identifiers.into_iter().filter(|(_, seen)| comes(seen));
        (instants, identifiers.map(|(key, seen)| (key, seen.frame)).collect())
    }
}
