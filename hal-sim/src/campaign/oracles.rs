//! The oracles of a plan during a run.

use std::sync::Arc;

use protocol_core::device::View;
use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::oracle::{Proof, SafeState};
use super::plan::Plan;
use crate::Kind;
use crate::bus::{EventKind, FaultEffect};
use crate::scenario::runner::Watch;
use crate::scenario::step::Wanted;
use crate::simulation::{Happened, Simulation};
use crate::state::{DeviceState, Pattern};
use crate::world::NodeId;

/// The oracles of a run. Before the first fault, the oracles track only the frame of [`Proof::Stops`].
#[derive(Clone, Debug)]
pub(super) struct Oracles<'a> {
    proof: Option<Seeker<'a>>,
    safe: Option<Safety<'a>>,
    fault: Option<Injected>,
    /// The instant at which the first effect of the fault on a device was found.
    effect: Option<Instant>,
    detected: Option<Instant>,
}

#[derive(Clone, Debug)]
struct Injected {
    /// The instant of the first fault.
    first: Instant,
    /// The instant of the last fault, from which the limits count.
    last: Instant,
    /// The names of the communication faults. Frames from these senders are no proof.
    names: Vec<Arc<str>>,
    /// The corrupted frames that are still to appear on the bus. They are no proof either.
    corrupted: Vec<Frame>,
}

impl Injected {
    /// Returns whether a communication fault inserted or corrupted a frame. Forgets a corrupted frame.
    fn is_made(&mut self, who: &Arc<str>, frame: &Frame) -> bool {
        let place = self.corrupted.iter().position(|corrupted| corrupted == frame);
        place.map(|place| self.corrupted.swap_remove(place)).is_some() || self.names.contains(who)
    }
}

#[derive(Clone, Debug)]
enum Seeker<'a> {
    /// The expected frames, and the number of matched frames.
    Frames(&'a [Pattern], usize),
    State(Box<StateEye<'a>>),
    /// The identifier of the frame, the required silence, and the end of the last such frame.
    Stops(Id, Duration, Option<Instant>),
}

#[derive(Clone, Debug)]
struct Safety<'a> {
    eye: StateEye<'a>,
    span: Option<Duration>,
    /// The instant since which the state has held without interruption.
    since: Option<Instant>,
    /// The value of `since` once the state has held for `span`.
    proved: Option<Instant>,
}

/// A device-state check that does not affect the run.
#[derive(Clone, Debug)]
struct StateEye<'a> {
    wanted: &'a Wanted,
    device: (NodeId, Kind),
    /// The last state that was checked, and the result of the check.
    last: Option<(Seen, bool)>,
}

/// The view of a device, and the position of its spool.
type Seen = (Option<View>, Option<i16>);

impl<'a> StateEye<'a> {
    fn new(wanted: &'a Wanted, simulation: &Simulation) -> Option<Self> {
        simulation.find(&wanted.device).ok().map(|device| Self { wanted, device, last: None })
    }

    fn holds(&mut self, simulation: &Simulation) -> bool {
        let (node, kind) = self.device;
        let world = simulation.world();
        let mut seen = (world.view(node), world.spool_position(node));
        if self.wanted.condition.position.is_none() {
            seen.1 = None;
            if let Some(view) = &mut seen.0 {
                view.position = 0;
            }
        }
        if let Some((_, holds)) = self.last.as_ref().filter(|(last, _)| *last == seen) {
            return *holds;
        }
        let holds = self.wanted.condition.holds(&DeviceState::of(node, kind, world));
        self.last = Some((seen, holds));
        holds
    }

    /// Returns the next instant at which movement alone can fulfil the condition, or the next event, which can begin a
    /// movement; `limit` at the latest.
    fn due(&self, simulation: &Simulation, limit: Instant) -> Instant {
        let (node, world) = (self.device.0, simulation.world());
        if self.wanted.condition.position.is_none() {
            return limit;
        }
        let position = world.spool_position(node).or_else(|| world.view(node).map(|view| view.position));
        let Some(range) = self.wanted.condition.wanted_positions(position) else { return limit };
        let tick = after(simulation.now(), Duration::from_ticks(1));
        world.next_inside(node, &range, simulation.next().max(tick).min(limit)).max(tick).min(limit)
    }
}

impl Safety<'_> {
    /// Returns the instant at which the state will have held for `span`. Time before the effect of the fault does not
    /// count.
    fn end(&self, effect: Option<Instant>) -> Option<Instant> {
        Some(after(self.since?.max(effect?), self.span?))
    }
}

impl<'a> Oracles<'a> {
    pub(super) fn new(plan: &'a Plan, simulation: &Simulation) -> Self {
        let proof = plan.detected.as_ref().and_then(|proof| match proof {
            Proof::Frames(patterns) => Some(Seeker::Frames(patterns, 0)),
            Proof::State(wanted) => StateEye::new(wanted, simulation).map(Box::new).map(Seeker::State),
            Proof::Stops(id, span) => Some(Seeker::Stops(*id, *span, None)),
        });
        let safe = plan.safe.as_ref().and_then(|SafeState { state, span }| {
            let eye = StateEye::new(state, simulation)?;
            Some(Safety { eye, span: *span, since: None, proved: None })
        });
        Self { proof, safe, fault: None, effect: None, detected: None }
    }

    /// Creates oracles that look only for the proof.
    pub(super) fn of_proof(plan: &'a Plan, simulation: &Simulation) -> Self {
        Self { safe: None, ..Self::new(plan, simulation) }
    }

    /// Returns whether the oracles look for the proof and the safe state.
    pub(super) const fn have_begun(&self) -> bool {
        self.fault.is_some()
    }

    /// Starts the search for the proof and the safe state at the instant of a fault. A later fault restarts the limits.
    /// `name` is the name of a communication fault.
    pub(super) fn begin(&mut self, name: Option<Arc<str>>, simulation: &Simulation) {
        let now = simulation.now();
        let fault = self.fault.get_or_insert_with(|| Injected {
            first: now,
            last: now,
            names: Vec::new(),
            corrupted: Vec::new(),
        });
        fault.last = now;
        fault.names.extend(name);
        self.look(simulation);
    }

    /// Records an effect of the fault on a device. The time in the safe state counts from the first effect, because the
    /// fault may not have acted before.
    pub(super) fn note_effect(&mut self, now: Instant) {
        self.effect.get_or_insert(now);
    }

    /// Returns whether an effect of the fault has been recorded.
    pub(super) const fn has_effect(&self) -> bool {
        self.effect.is_some()
    }

    /// Checks the expected states, and the silence of a stopped frame, at the current instant.
    pub(super) fn look(&mut self, simulation: &Simulation) {
        let Some(fault) = &self.fault else { return };
        let now = simulation.now();
        if self.detected.is_none() {
            self.detected = match &mut self.proof {
                Some(Seeker::State(eye)) => eye.holds(simulation).then_some(now),
                Some(Seeker::Stops(_, span, Some(last))) => {
                    (now >= after(*last, *span)).then(|| after(*last, *span).max(fault.first))
                }
                _ => None,
            };
        }
        if let Some(safety) = &mut self.safe
            && safety.proved.is_none()
        {
            safety.since = safety.eye.holds(simulation).then(|| safety.since.unwrap_or(now));
            if safety.end(self.effect).is_some_and(|end| now >= end) {
                safety.proved = safety.since;
            }
        }
    }

    /// Returns the identifier of [`Proof::Stops`] if no frame with it has been sent yet.
    pub(super) const fn unknown(&self) -> Option<Id> {
        match &self.proof {
            Some(Seeker::Stops(id, _, None)) => Some(*id),
            _ => None,
        }
    }

    /// Returns whether each oracle of the plan is fulfilled already. False if a safe state must hold until the end.
    pub(super) fn are_decided(&self) -> bool {
        (self.proof.is_none() || self.detected.is_some())
            && self.safe.as_ref().is_none_or(|safety| safety.proved.is_some())
    }

    /// Returns the time from the last fault to the detection, if any; 0 for an earlier detection.
    pub(super) fn detected(&self) -> Option<Duration> {
        let fault = self.fault.as_ref()?;
        self.detected.map(|at| since(at, fault.last))
    }

    /// Returns the time from the last fault to the safe state, if any; 0 for an earlier state. `end` is the end of the
    /// observation. A state that has held for its span by `end` counts even without an effect of the fault.
    pub(super) fn safe(&self, end: Instant) -> Option<Duration> {
        let (fault, safety) = (self.fault.as_ref()?, self.safe.as_ref()?);
        let begin = match safety.span {
            None => safety.since,
            Some(span) => safety.proved.or(safety.since.filter(|since| end >= after(*since, span))),
        };
        begin.map(|begin| since(begin, fault.last))
    }
}

impl Oracles<'_> {
    /// Observes a frame that its sender has sent, even if a fault keeps the frame off the bus.
    fn sent(&mut self, frame: &Frame, at: Instant) {
        match (&mut self.proof, &self.fault) {
            (Some(Seeker::Stops(id, span, last)), fault) if frame.id() == *id => {
                if let (Some(fault), Some(last), None) = (fault, *last, self.detected)
                    && at > after(last, *span)
                {
                    self.detected = Some(after(last, *span).max(fault.first));
                }
                *last = Some(at);
            }
            (Some(Seeker::Frames(patterns, came)), Some(fault))
                if self.detected.is_none()
                    && at > fault.first
                    && patterns.get(*came).is_some_and(|wanted| wanted.matches(frame)) =>
            {
                *came += 1;
                self.detected = (*came == patterns.len()).then_some(at);
            }
            _ => {}
        }
    }
}

impl Watch for Oracles<'_> {
    fn event(&mut self, happened: &Happened) {
        let (at, who) = (happened.event.at, &happened.event.who);
        match &happened.event.what {
            EventKind::Frame { frame, .. } => {
                let is_made = self.fault.as_mut().is_some_and(|fault| fault.is_made(who, frame));
                if !is_made {
                    self.sent(frame, at);
                }
            }
            // The sender has sent this frame, even if the fault keeps it from the bus.
            EventKind::Fault { fault: name, frame, effect } => {
                let Some(fault) = self.fault.as_mut().filter(|fault| fault.names.contains(name)) else { return };
                if let FaultEffect::Corrupted(corrupted) = effect {
                    fault.corrupted.push(*corrupted);
                }
                if *effect != FaultEffect::Inserted
                    && let Some(Seeker::Stops(id, ..)) = &self.proof
                    && frame.id() == *id
                {
                    self.sent(frame, at);
                }
            }
            _ => {}
        }
    }

    fn step(&mut self, simulation: &mut Simulation) {
        self.look(simulation);
    }

    /// Returns the next instant at which a state must be checked.
    fn due(&self, simulation: &Simulation, limit: Instant) -> Instant {
        if self.fault.is_none() {
            return limit;
        }
        let mut due = limit;
        if self.detected.is_none()
            && let Some(Seeker::State(eye)) = &self.proof
        {
            due = eye.due(simulation, due);
        }
        match &self.safe {
            Some(Safety { eye, since: None, proved: None, .. }) => eye.due(simulation, due),
            Some(safety @ Safety { proved: None, .. }) => {
                let tick = after(simulation.now(), Duration::from_ticks(1));
                safety.end(self.effect).map_or(due, |end| end.max(tick).min(due))
            }
            _ => due,
        }
    }
}

/// The sampling interval of a run.
pub(super) const SAMPLE: Duration = Duration::from_millis(10);

/// Returns the first sample instant after `now`.
pub(super) fn next_sample(now: Instant) -> Instant {
    let number = now.as_ticks() / SAMPLE.as_ticks() + 1;
    number.checked_mul(SAMPLE.as_ticks()).map_or(NEVER, Instant::from_ticks)
}
