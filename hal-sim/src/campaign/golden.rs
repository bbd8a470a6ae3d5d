//! The golden run: a run of the scenario without a fault, as the reference for cells.

use std::collections::BTreeMap;

use protocol_core::device::View;
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::master::{Master, Subject};
use super::oracles::{Oracles, SAMPLE, next_sample};
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

impl CampaignError {
    /// The refusal of a proof of detection that holds at an instant without a fault.
    pub(super) fn proof_without_fault(at: Instant, seed: u64) -> Self {
        let at_ms = since(at, Instant::from_ticks(0)).as_millis();
        Self(format!("detected: the proof holds without a fault, at {at_ms} ms (seed {seed}), and so proves nothing"))
    }
}

#[derive(Debug)]
pub(super) struct Golden {
    pub(super) seed: u64,
    devices: Vec<NodeId>,
    /// The states of all devices in each sampling interval, from 0.
    intervals: Vec<Interval>,
    /// The instants of the faults.
    pub(super) instants: Vec<Instant>,
    /// The last frame with each identifier that is sent within the observation time after every fault instant, by
    /// [`Frame::key`].
    pub(super) identifiers: BTreeMap<u32, Frame>,
}

/// The states of a device in a sampling interval of the golden run, both ends included.
#[derive(Clone, Debug)]
struct Interval {
    min: i16,
    max: i16,
    states: Vec<u32>,
}

impl Interval {
    const EMPTY: Self = Self { min: i16::MAX, max: i16::MIN, states: Vec::new() };

    fn add(&mut self, Sample { position, state }: Sample) {
        (self.min, self.max) = (self.min.min(position), self.max.max(position));
        if !self.states.contains(&state) {
            self.states.push(state);
        }
    }
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
        let from = plan.instants.begin();
        let to = after(Instant::from_ticks(0), Duration::from_millis(plan.instants.to_ms.into()));
        let end = after(to, plan.observe + SAMPLE);
        let states = States { devices, intervals: Vec::new() };
        let mut record = Record { from, to, ends: Vec::new(), identifiers: BTreeMap::new(), states };
        let mut now = Instant::from_ticks(0);
        while now <= end {
            if now > from && !rig.oracles.have_begun() {
                rig.pass(from, &mut record);
                rig.oracles.begin(None, rig.target.simulation());
            }
            rig.pass(now, &mut record);
            rig.oracles.look(rig.target.simulation());
            record.states.add(rig.target.simulation());
            if let Some(detected) = rig.oracles.detected() {
                return Err(CampaignError::proof_without_fault(after(from, detected), seed));
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
        let (instants, identifiers, States { devices, intervals }) = record.finish(plan, end);
        if instants.is_empty() {
            return Err(CampaignError("instants: no frame ends between from_ms and to_ms".to_owned()));
        }
        Ok(Self { seed, devices, intervals, instants, identifiers })
    }

    /// Returns power, NMT state, device state machine and active faults of each device, as bits.
    pub(super) fn states(&self, simulation: &Simulation) -> Vec<u32> {
        self.all_states(simulation).map(|state| state & LASTING).collect()
    }

    /// Returns the bits of [`states`](Self::states), with those of command and solenoids.
    pub(super) fn all_states(&self, simulation: &Simulation) -> impl Iterator<Item = u32> {
        self.devices.iter().map(|node| Sample::of(simulation.world().view(*node).as_ref()).state)
    }

    /// Returns whether the bits of each device, as in [`states`](Self::states), are those in `before` or those at any
    /// time of the golden run between two instants.
    pub(super) fn is_among(&self, before: &[u32], (from, to): (Instant, Instant), simulation: &Simulation) -> bool {
        let golden = self.between(from, to);
        self.states(simulation).iter().zip(before).enumerate().all(|(place, (state, before))| {
            let mut states = golden.clone().flat_map(|intervals| &intervals[place].states);
            state == before || states.any(|golden| golden & LASTING == *state)
        })
    }

    /// Returns whether each device matches the golden run now. A change may come up to one sampling interval early or
    /// late, because an additional frame on the bus delays other frames.
    fn is_as(&self, simulation: &Simulation) -> bool {
        let now = simulation.now();
        let golden = self.between(earlier(now, SAMPLE), earlier(after(now, SAMPLE), Duration::from_ticks(1)));
        self.devices.iter().enumerate().all(|(place, node)| {
            let found = Sample::of(simulation.world().view(*node).as_ref());
            let mut near = golden.clone().map(|intervals| &intervals[place]);
            let (min, max) =
                near.clone().fold((i16::MAX, i16::MIN), |(min, max), it| (min.min(it.min), max.max(it.max)));
            let range = i32::from(min) - TOLERANCE..=i32::from(max) + TOLERANCE;
            range.contains(&found.position.into()) && near.any(|it| it.states.contains(&found.state))
        })
    }

    /// Compares the devices with the golden run, as [`is_as`](Self::is_as) does, until the oracles have an effect of the
    /// fault.
    pub(super) fn compare(&self, oracles: &mut Oracles<'_>, simulation: &Simulation) {
        if !oracles.has_effect() && !self.is_as(simulation) {
            oracles.note_effect(simulation.now());
        }
    }

    /// Returns the states of all devices in the sampling intervals of two instants and in those between.
    fn between(&self, first: Instant, last: Instant) -> impl Iterator<Item = &[Interval]> + Clone {
        self.intervals.chunks(self.devices.len()).take(number(last) + 1).skip(number(first))
    }
}

/// Returns an instant minus a time, at least 0.
fn earlier(instant: Instant, span: Duration) -> Instant {
    Instant::from_ticks(instant.as_ticks().saturating_sub(span.as_ticks()))
}

/// Returns the number of the sampling interval that contains an instant or begins with it.
fn number(at: Instant) -> usize {
    (at.as_ticks() / SAMPLE.as_ticks()) as usize
}

/// The states of the devices in a golden run.
struct States {
    devices: Vec<NodeId>,
    intervals: Vec<Interval>,
}

impl States {
    /// Adds the states of all devices now. An instant between two intervals belongs to both.
    fn add(&mut self, simulation: &Simulation) {
        let (now, devices) = (simulation.now(), self.devices.len());
        let (first, last) = (number(earlier(now, Duration::from_ticks(1))), number(now));
        self.intervals.resize(self.intervals.len().max((last + 1) * devices), Interval::EMPTY);
        for (place, node) in self.devices.iter().enumerate() {
            let sample = Sample::of(simulation.world().view(*node).as_ref());
            (first..=last).for_each(|number| self.intervals[number * devices + place].add(sample));
        }
    }
}

/// The frames and states of a golden run.
struct Record {
    from: Instant,
    to: Instant,
    /// The ends of the frames from the first to the last fault instant.
    ends: Vec<Instant>,
    identifiers: BTreeMap<u32, Seen>,
    states: States,
}

/// The frames with one identifier.
struct Seen {
    frame: Frame,
    last: Instant,
    /// The longest time without such a frame, from the first fault instant on.
    gap: Duration,
}

impl Watch for Record {
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

    fn step(&mut self, simulation: &mut Simulation) {
        self.states.add(simulation);
    }
}

impl Record {
    fn finish(self, plan: &Plan, end: Instant) -> (Vec<Instant>, BTreeMap<u32, Frame>, States) {
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
        (instants, identifiers.map(|(key, seen)| (key, seen.frame)).collect(), self.states)
    }
}
