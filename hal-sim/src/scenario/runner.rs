//! Goes through a scenario in a world of its own, step by step, and gathers what was not as expected.

use std::cell::Cell;
use std::rc::Rc;

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::history::{Heard, History};
use super::report::{Failure, Outcome};
use super::script::{Act, Begin, Expect, Never, Scenario, Step, Wanted, What};
use crate::Kind;
use crate::devices::{self, NotHeard, RateWatch};
use crate::sender::{Receipt, Sender, Unsent};
use crate::state::{DeviceState, Invalid, Pattern, StateWatch};
use crate::world::{Event, NodeId, SUPPLY_JITTER, World};

/// Who sends the frames of a scenario, in traces. No device can have that name.
const OWN: &str = "the master";

/// A frame that is sent is on the bus or withdrawn by then.
const SENT: Duration = Duration::from_secs(2);

/// The way of an answer about a frame back to the step that sent it.
#[derive(Clone, Debug, Default)]
struct Sent(Rc<Cell<Option<Result<Instant, Unsent>>>>);

impl Receipt for Sent {
    fn tell(self, sent: Result<Instant, Unsent>) {
        self.0.set(Some(sent));
    }

    fn is_given_up(&self) -> bool {
        false
    }
}

/// Runs a scenario; `traced`: with all of its trace.
pub(super) fn run(scenario: &Scenario, seed: u64, traced: bool) -> Outcome {
    let mut world = scenario.world(seed);
    world.record_events(true);
    let sender = Sender::new(OWN, &mut world);
    let kinds = scenario.devices.iter().map(|device| device.setup.kind);
    let devices = world.devices().zip(kinds).collect();
    world.power_all(SUPPLY_JITTER);
    let history = History::new(OWN, devices::explainer(&scenario.devices), traced, &world);
    let mut rates = RateWatch::new(scenario.heard(), &mut world);
    rates.look(&mut world);
    let mut runner = Runner {
        scenario,
        world,
        sender,
        devices,
        history,
        rates,
        step: None,
        events: Vec::new(),
        guards: Vec::new(),
        failures: Vec::new(),
        shown: 0,
    };
    for step in &scenario.steps {
        runner.step(step);
    }
    let end = runner.guards.iter().map(|guard| guard.until).filter(|until| *until != NEVER).max();
    if let Some(end) = end {
        runner.pass(end);
    }
    runner.end_guards();
    runner.rates.find_all();
    runner.fail_unheard();
    runner.outcome()
}

struct Runner<'a> {
    scenario: &'a Scenario,
    world: World,
    sender: Sender<Sent>,
    devices: Vec<(NodeId, Kind)>,
    history: History,
    rates: RateWatch,
    /// The step that goes on.
    step: Option<&'a Step>,
    /// Events on their way into the history; the allocation is used again.
    events: Vec<Event>,
    guards: Vec<Guard<'a>>,
    failures: Vec<Failure>,
    /// The first event that no failure has shown.
    shown: u64,
}

/// What must not come.
struct Guard<'a> {
    step: &'a Step,
    since: Instant,
    until: Instant,
    what: Guarded<'a>,
}

enum Guarded<'a> {
    /// Frames, in the events from that number on.
    Frames(&'a [Pattern], u64),
    State(&'a Wanted, StateWatch),
}

/// What the time that passes is for.
enum Goal<'a> {
    /// It passes.
    None,
    /// A frame was sent, or not.
    Sent(&'a Sent),
    Frames(Frames<'a>),
    State(StateWatch),
}

/// Frames that have to come.
struct Frames<'a> {
    /// Each with the frame that fulfils it; `None`: it has not come.
    wanted: Vec<(&'a Pattern, Option<Frame>)>,
    any_order: bool,
    /// The next event to be looked at.
    next: u64,
    /// The event after the last one that was expected.
    mark: u64,
}

impl<'a> Runner<'a> {
    fn step(&mut self, step: &'a Step) {
        self.begin(step);
        self.step = Some(step);
        // The first event that counts for the step: a frame from before it fulfils nothing.
        let mark = self.history.next();
        if let Some(note) = &step.note {
            self.history.note(note);
        }
        if let Some(act) = &step.act {
            self.act(step, act);
        }
        if let Some(Expect { what, any_order, within }) = &step.expect {
            let until = after(self.world.now(), *within);
            match what {
                What::Frames(patterns) => self.expect_frames(step, patterns, *any_order, mark, until),
                What::State(wanted) => self.expect_state(step, wanted, until),
            }
        }
        if let Some(Never { what, span }) = &step.never {
            let since = self.world.now();
            let until = span.map_or(NEVER, |span| after(since, span));
            let what = match what {
                What::Frames(patterns) => Guarded::Frames(patterns, self.history.next()),
                What::State(wanted) => Guarded::State(wanted, self.watch(wanted)),
            };
            self.guards.push(Guard { step, since, until, what });
            self.guard();
        }
    }

    /// Lets time pass until a step begins.
    fn begin(&mut self, step: &Step) {
        let now = self.world.now();
        let begin = match step.begin {
            Begin::Now => return,
            Begin::After(pause) => after(now, pause),
            Begin::At(distance) => after(Instant::from_ticks(0), distance),
        };
        if begin < now {
            self.fail(Failure::late(step, begin));
            return;
        }
        self.pass(begin);
    }

    fn act(&mut self, step: &Step, act: &Act) {
        match act {
            Act::Send(frame, period) => {
                let sent = Sent::default();
                self.sender.send(*frame, *period, sent.clone(), &mut self.world);
                self.pass_until(after(self.world.now(), SENT), &mut Goal::Sent(&sent));
                if let Some(Err(Unsent::TooMany(reason) | Unsent::Withdrawn(reason))) = sent.0.get() {
                    self.fail(Failure::undone(step, &format!("send {frame}"), reason));
                }
            }
            Act::Stop(id) => {
                self.sender.stop(*id, &mut self.world);
            }
            Act::Plant(device, change) => {
                let made = change.clone().make(self.devices[*device].0, &mut self.world);
                if let Err(Invalid(reason)) = made {
                    self.fail(Failure::undone(step, "plant", &reason));
                }
            }
            Act::Power(device, power) => {
                if let Err(reason) = power.switch(self.devices[*device].0, &mut self.world) {
                    self.fail(Failure::undone(step, "power", reason));
                }
            }
            Act::Bus(bit_rate) => self.world.set_bit_rate(*bit_rate),
            Act::Disturb(disturbance) => self.world.disturb(*disturbance),
        }
        self.attend();
    }

    fn expect_frames(&mut self, step: &Step, patterns: &[Pattern], any_order: bool, from: u64, until: Instant) {
        let wanted = patterns.iter().map(|pattern| (pattern, None)).collect();
        let mut goal = Goal::Frames(Frames { wanted, any_order, next: from, mark: from });
        let came = self.pass_until(until, &mut goal);
        let Goal::Frames(Frames { wanted, mark, .. }) = goal else { return };
        if !came {
            let missing = wanted.iter().filter(|(_, frame)| frame.is_none());
            let missing: Vec<&Pattern> = missing.map(|(pattern, _)| *pattern).collect();
            let failure = Failure::frames(step, patterns, &missing, (from, mark), &self.history);
            self.fail(failure);
        }
    }

    fn expect_state(&mut self, step: &Step, wanted: &Wanted, until: Instant) {
        let mut goal = Goal::State(self.watch(wanted));
        if !self.pass_until(until, &mut goal) {
            let state = self.state(wanted);
            self.fail(Failure::state(step, wanted, &state));
        }
    }

    fn state(&mut self, wanted: &Wanted) -> DeviceState {
        let (node, kind) = self.devices[wanted.device];
        DeviceState::of(node, kind, &mut self.world)
    }

    /// Watches a state.
    fn watch(&self, wanted: &Wanted) -> StateWatch {
        StateWatch::new(self.devices[wanted.device], Box::new(wanted.condition.clone()))
    }

    /// Lets time pass until an instant, with everything that is due by then.
    fn pass(&mut self, end: Instant) {
        self.pass_until(end, &mut Goal::None);
    }

    /// Lets time pass until an instant, with everything that is due by then, or until a goal is reached; returns
    /// whether it was.
    fn pass_until(&mut self, end: Instant, goal: &mut Goal<'_>) -> bool {
        loop {
            if self.is_reached(goal) {
                return true;
            }
            let (now, event) = (self.world.now(), self.world.next_event());
            if now >= end && event > end {
                return false;
            }
            let due = self.due(end, goal);
            if event <= due && event <= end && event != NEVER {
                self.world.step();
            } else {
                self.world.run_until(due.min(end));
            }
            self.attend();
        }
    }

    fn is_reached(&mut self, goal: &mut Goal<'_>) -> bool {
        match goal {
            Goal::None => false,
            Goal::Sent(sent) => sent.0.get().is_some(),
            Goal::Frames(frames) => {
                frames.look(&self.history);
                frames.are_all_there()
            }
            Goal::State(watch) => watch.look(&mut self.world).1,
        }
    }

    /// Returns when there is next something to do although nothing happens in the world, after now.
    fn due(&self, end: Instant, goal: &Goal<'_>) -> Instant {
        let now = self.world.now();
        let sought = match goal {
            Goal::State(watch) if end > now => watch.due(end, &self.world),
            _ => end,
        };
        let guarded = self.guards.iter().filter(|guard| guard.until > now).filter_map(|guard| match &guard.what {
            Guarded::State(_, watch) => Some(watch.due(guard.until.min(end), &self.world)),
            Guarded::Frames(..) => None,
        });
        guarded.fold(sought, Instant::min).min(self.sender.due(now)).min(self.rates.due(now))
    }

    /// Takes note of what happened, and does what is due.
    fn attend(&mut self) {
        let mut events = std::mem::take(&mut self.events);
        events.extend(self.world.take_events());
        for event in events.drain(..) {
            self.history.keep(&event, &self.world);
        }
        self.events = events;
        if !self.sender.is_idle() {
            self.sender.attend(&mut self.world);
        }
        self.look_at_rates();
        self.guard();
    }

    /// Looks for devices that are not heard. What must not come and is over is looked at first: it was claimed of the
    /// time before.
    fn look_at_rates(&mut self) {
        let now = self.world.now();
        for guard in self.guards.iter().filter(|guard| guard.until < now) {
            self.rates.find_at(guard.until);
        }
        self.rates.look(&mut self.world);
        if self.guards.iter().any(|guard| guard.until == now) {
            self.rates.find_at(now);
        }
        self.fail_unheard();
    }

    /// Adds a failure for each device that was found not to be heard: at the device when that was so from the start, else
    /// at the step that goes on.
    fn fail_unheard(&mut self) {
        for NotHeard { device, since, reason, .. } in self.rates.take_found() {
            let place = self.scenario.devices.iter().position(|known| known.name == device);
            let entry = place.and_then(|place| self.scenario.entries.get(place));
            let step = self.step.filter(|_| since > Instant::from_ticks(0));
            let line = step.map(|step| step.line).or(entry.map(|entry| entry.line)).unwrap_or(1);
            let failure = Failure::not_heard(line, reason).with(self.world.now(), Vec::new());
            self.failures.push(failure);
        }
    }

    /// Looks whether something came that must not.
    fn guard(&mut self) {
        if self.guards.is_empty() {
            return;
        }
        let mut guards = std::mem::take(&mut self.guards);
        guards.retain_mut(|guard| match self.violation(guard) {
            Some(failure) => {
                self.fail(failure);
                false
            }
            None if guard.until >= self.world.now() => true,
            None => {
                self.end_guard(guard);
                false
            }
        });
        self.guards = guards;
    }

    /// Ends what must not come, and has not, with the scenario.
    fn end_guards(&mut self) {
        for guard in std::mem::take(&mut self.guards) {
            self.end_guard(&guard);
        }
    }

    /// Fails a step whose condition could not have come: no time has passed since, or its instant was not in it.
    fn end_guard(&mut self, guard: &Guard<'_>) {
        let end = guard.until.min(self.world.now());
        let instant = match &guard.what {
            Guarded::State(wanted, _) => wanted.condition.t_us.map(Instant::from_micros),
            Guarded::Frames(..) => None,
        };
        let reason = match instant {
            _ if end <= guard.since => "no time has passed since: nothing could come",
            Some(instant) if instant < guard.since || instant > end => {
                "t_us was not in the time since: nothing could come"
            }
            _ => return,
        };
        self.fail(Failure::undone(guard.step, "never", reason));
    }

    fn violation(&mut self, guard: &mut Guard<'_>) -> Option<Failure> {
        match &mut guard.what {
            Guarded::Frames(patterns, next) => {
                let mut heard = self.history.heard_since(*next).filter(|heard| heard.at <= guard.until);
                let is_it = |heard: Heard| Some((heard, patterns.iter().find(|it| it.matches(&heard.frame))?));
                let found = heard.find_map(is_it);
                *next = self.history.next();
                found.map(|(heard, pattern)| Failure::came(guard.step, pattern, &heard, &self.history))
            }
            Guarded::State(wanted, watch) => {
                if self.world.now() > guard.until {
                    return None;
                }
                let (state, holds) = watch.look(&mut self.world);
                holds.then(|| Failure::held(guard.step, wanted, &state))
            }
        }
    }

    /// Adds a failure at this instant, with what was on the bus before it.
    fn fail(&mut self, failure: Failure) {
        let at = self.world.now();
        let until = failure.until().unwrap_or_else(|| self.history.next());
        self.failures.push(failure.with(at, self.history.excerpt(self.shown, until)));
        self.shown = self.shown.max(until);
    }

    fn outcome(mut self) -> Outcome {
        let errors = self.history.errors();
        self.failures.iter_mut().for_each(|failure| failure.show_errors(&errors));
        Outcome {
            title: self.scenario.title.clone(),
            steps: self.scenario.steps.len(),
            end: self.world.now(),
            failures: self.failures,
            trace: self.history.finish(),
        }
    }
}

impl Frames<'_> {
    /// Looks at what has come since the last look.
    fn look(&mut self, history: &History) {
        if self.next == history.next() {
            return;
        }
        for Heard { number, frame, .. } in history.heard_since(self.next) {
            if self.take(frame) {
                self.mark = number + 1;
                if self.are_all_there() {
                    break;
                }
            }
        }
        self.next = history.next();
    }

    fn are_all_there(&self) -> bool {
        self.wanted.iter().all(|(_, frame)| frame.is_some())
    }

    /// Lets a frame fulfil one of those that have not come; returns whether it does.
    fn take(&mut self, frame: Frame) -> bool {
        if self.any_order {
            let mut tried = vec![false; self.wanted.len()];
            return self.place(frame, &mut tried);
        }
        let first = self.wanted.iter_mut().find(|(_, frame)| frame.is_none());
        let fulfilled = first.filter(|(pattern, _)| pattern.matches(&frame));
        fulfilled.is_some_and(|(_, place)| place.replace(frame).is_none())
    }

    /// Finds a place for a frame that may come at any. One in its place makes room when there is another place for
    /// that: a pattern for many frames takes none away from one for few.
    fn place(&mut self, frame: Frame, tried: &mut [bool]) -> bool {
        for place in 0..self.wanted.len() {
            let (pattern, holder) = self.wanted[place];
            if tried[place] || !pattern.matches(&frame) {
                continue;
            }
            tried[place] = true;
            if holder.is_none_or(|holder| self.place(holder, tried)) {
                self.wanted[place].1 = Some(frame);
                return true;
            }
        }
        false
    }
}
