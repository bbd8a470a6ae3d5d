//! Executes a scenario step by step and collects its failures.

use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::frames::Frames;
use super::report::{Failure, Outcome};
use super::script::Scenario;
use super::step::{Begin, Expect, Never, Step, Wanted, What};
use super::strict::Claims;
use super::target::Target;
use crate::devices::NotHeard;
use crate::simulation::{Command, Executed, Heard, Refusal, Reply, Simulation, Ticket};
use crate::state::{FaultRecord, Pattern};
use crate::trace::Layout;

/// Runs a scenario on a target with powered devices and, if `traced`, records a trace. Calls `watch` after every step
/// of the simulation.
pub(super) fn run(
    scenario: &Scenario,
    target: &mut impl Target,
    traced: bool,
    watch: &mut dyn FnMut(&mut Simulation),
) -> Outcome {
    let mut runner = Runner {
        scenario,
        target,
        watch,
        claims: scenario.strict.then(Claims::default),
        trace: traced.then(|| Trace { layout: Layout::new(false, false), text: String::new() }),
        step: None,
        ended: Vec::new(),
        guards: Vec::new(),
        failures: Vec::new(),
        faults: Vec::new(),
        shown: 0,
    };
    if runner.refuse_states() {
        return runner.outcome();
    }
    for step in &scenario.steps {
        runner.step(step);
        // After the first deviation from a strict scenario, further deviations are meaningless.
        if runner.claims.is_some() && !runner.failures.is_empty() {
            return runner.outcome();
        }
    }
    let end = runner.guards.iter().map(|guard| guard.until).filter(|until| *until != NEVER).max();
    if let Some(end) = end {
        runner.pass(end);
    }
    if let Some(last) = scenario.steps.last() {
        runner.settle(last);
    }
    runner.end_guards();
    let left: Vec<FaultRecord> = runner.target.simulation().faults().collect();
    runner.end_faults(&left);
    runner.target.simulation_mut().rates_mut().find_all();
    runner.fail_unheard();
    runner.outcome()
}

struct Runner<'a, B> {
    scenario: &'a Scenario,
    target: &'a mut B,
    watch: &'a mut dyn FnMut(&mut Simulation),
    /// The check that each device frame is expected by a step; `None` unless the scenario is strict.
    claims: Option<Claims<'a>>,
    /// The trace, written while the scenario runs.
    trace: Option<Trace>,
    /// The step being executed.
    step: Option<&'a Step>,
    /// The completed commands with their results.
    ended: Vec<(Ticket, Result<Reply, Refusal>)>,
    guards: Vec<Guard<'a>>,
    failures: Vec<Failure>,
    /// The active communication faults by name, each with the step that added it.
    faults: Vec<(String, &'a Step)>,
    /// The number of the first event that no failure has shown yet.
    shown: u64,
}

struct Trace {
    layout: Layout,
    text: String,
}

/// A running prohibition (`never`) of a state or of frames.
struct Guard<'a> {
    step: &'a Step,
    since: Instant,
    until: Instant,
    what: Guarded<'a>,
    /// The pending wait for the forbidden state, or for the end of the prohibition.
    ticket: Ticket,
}

#[derive(Clone, Copy)]
enum Guarded<'a> {
    /// Forbidden frames, checked in the events from this number onwards.
    Frames(&'a [Pattern], u64),
    State(&'a Wanted),
}

/// The condition that ends an advance of time.
enum Goal<'a> {
    /// No condition: time advances to the given end.
    None,
    /// The completion of a pending command.
    Command(Ticket),
    Frames(Frames<'a>),
}

impl<'a, B: Target> Runner<'a, B> {
    /// Fails the scenario before the first step if a step expects a state that the target cannot read. Returns whether
    /// the scenario failed.
    fn refuse_states(&mut self) -> bool {
        for step in &self.scenario.steps {
            let expected = step.expect.as_ref().map(|expect| &expect.what);
            for what in expected.into_iter().chain(step.never.as_ref().map(|never| &never.what)) {
                if let What::State(wanted) = what
                    && self.target.simulation().find(wanted.device()).is_err()
                {
                    let reason = "the target gives no access to the state; use frames";
                    self.fail(Failure::undone(step, &format!("a state of {}", wanted.device()), reason));
                }
            }
        }
        !self.failures.is_empty()
    }

    fn step(&mut self, step: &'a Step) {
        self.begin(step);
        self.settle(step);
        if self.claims.is_some() && !self.failures.is_empty() {
            return;
        }
        self.step = Some(step);
        // The first event of the step. Earlier frames cannot match the patterns of this step.
        let mark = self.target.simulation().history().next();
        if let (Some(note), Some(trace)) = (&step.note, &mut self.trace) {
            trace.note(note);
        }
        if let Some(act) = &step.act {
            self.act(step, act);
        }
        if let Some(expect) = &step.expect {
            match &expect.what {
                What::Frames(patterns) => self.expect_frames(step, expect, patterns, mark),
                What::State(wanted) => self.expect_state(step, wanted, expect.within),
            }
        }
        if let Some(never) = &step.never {
            self.never(step, never);
        }
        self.settle(step);
    }

    fn act(&mut self, step: &'a Step, act: &Command) {
        // Frames that devices send during the action may match the step's expectation, so they are not judged yet.
        let expects = matches!(&step.expect, Some(Expect { what: What::Frames(_), .. }));
        if let Command::Fault(_) = act {
            // A new fault may replace an expired one.
            let over: Vec<FaultRecord> = self.target.simulation().faults().filter(|record| record.is_over).collect();
            self.end_faults(&over);
        }
        let claims = self.claims.take_if(|_| expects);
        let done = self.run(act);
        self.claims = claims.or(self.claims.take());
        match (done, act, &mut self.claims) {
            (Err(_), _, Some(claims)) if claims.are_broken() => {}
            (Err(refusal), ..) => self.fail(Failure::undone(step, &name(act), &refusal.to_string())),
            (Ok(_), Command::Stop(which), Some(claims)) => claims.end(*which),
            (Ok(Reply::Fault(record)), ..) => self.faults.push((record.name, step)),
            (Ok(Reply::Faults(ended)), ..) => self.end_faults(&ended),
            _ => {}
        }
    }

    /// Fails each step whose fault ended without affecting a frame, because nothing was tested. Faults with probability
    /// 0 are exempt.
    fn end_faults(&mut self, ended: &[FaultRecord]) {
        for record in ended {
            let Some(place) = self.faults.iter().position(|(name, _)| *name == record.name) else { continue };
            let (_, step) = self.faults.swap_remove(place);
            let is_off = matches!(&step.act, Some(Command::Fault(fault)) if fault.probability == 0);
            if record.struck == 0 && !is_off {
                let reason = "it affected no frame: nothing was tested";
                self.fail(Failure::undone(step, &format!("fault {}", record.fault), reason));
            }
        }
    }

    /// Fails a step of a strict scenario if a deviation was found: an unclaimed frame, or a cyclic frame that is early
    /// or missing.
    fn settle(&mut self, step: &Step) {
        if let Some(deviation) = self.claims.as_mut().and_then(Claims::take_deviation) {
            let failure = Failure::deviation(step, &deviation, self.target.simulation().history());
            self.fail(failure);
        }
    }

    /// Returns whether a deviation from a strict scenario has been found.
    fn is_broken(&self) -> bool {
        self.claims.as_ref().is_some_and(Claims::are_broken)
    }

    /// Advances to the start of a step. Fails the step if its start time has passed.
    fn begin(&mut self, step: &Step) {
        let now = self.target.simulation().now();
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

    /// Executes a command and advances until it completes.
    fn run(&mut self, command: &Command) -> Result<Reply, Refusal> {
        let executed = self.target.execute(command.clone());
        self.look();
        match executed? {
            Executed::Done(reply) => Ok(reply),
            Executed::Pending(ticket) => {
                self.pass_until(NEVER, &mut Goal::Command(ticket));
                let place = self.ended.iter().position(|(known, _)| *known == ticket);
                place.map_or(
                    Err(Refusal::Conflict("virtual time reached its limit before the command completed".to_owned())),
                    |place| self.ended.swap_remove(place).1,
                )
            }
        }
    }

    fn expect_frames(&mut self, step: &Step, expect: &'a Expect, patterns: &'a [Pattern], from: u64) {
        let now = self.target.simulation().now();
        let wanted = patterns.iter().map(|pattern| (pattern, None)).collect();
        let Expect { any_order, within, every, .. } = *expect;
        let mut goal = Goal::Frames(Frames { wanted, any_order, next: from, mark: from, last: now });
        let came = self.pass_until(after(now, within), &mut goal);
        let Goal::Frames(Frames { wanted, mark, last, .. }) = goal else { return };
        if let (true, Some(period), [pattern], Some(claims)) = (came, every, patterns, &mut self.claims) {
            claims.begin(pattern, period, last);
        }
        if !came {
            let missing = wanted.iter().filter(|(_, frame)| frame.is_none());
            let missing: Vec<&Pattern> = missing.map(|(pattern, _)| *pattern).collect();
            let history = self.target.simulation().history();
            let deviation = self.claims.as_mut().and_then(Claims::take_deviation);
            let failure = Failure::frames(step, patterns, &missing, (from, mark), history);
            let failure = deviation.map_or(failure.clone(), |deviation| failure.because(&deviation, history));
            self.fail(failure);
        }
    }

    fn expect_state(&mut self, step: &Step, wanted: &Wanted, within: Duration) {
        if let Err(Refusal::TimedOut(timed_out)) = self.run(&Command::Wait(wanted.condition(), within))
            && let Some(state) = &timed_out.state
        {
            self.fail(Failure::state(step, wanted, state));
        }
    }

    /// Starts to check a prohibition.
    fn never(&mut self, step: &'a Step, Never { what, span }: &'a Never) {
        let since_now = self.target.simulation().now();
        let until = span.map_or(NEVER, |span| after(since_now, span));
        let within = since(until, since_now);
        let (what, command) = match what {
            What::Frames(patterns) => {
                (Guarded::Frames(patterns, self.target.simulation().history().next()), Command::Advance(within))
            }
            What::State(wanted) => (Guarded::State(wanted), Command::Wait(wanted.condition(), within)),
        };
        if let Ok(Executed::Pending(ticket)) = self.target.execute(command) {
            self.guards.push(Guard { step, since: since_now, until, what, ticket });
        }
        self.look();
    }

    /// Advances to `end` and processes everything due by then.
    fn pass(&mut self, end: Instant) {
        self.pass_until(end, &mut Goal::None);
    }

    /// Advances to `end`, or until the goal is reached or a deviation from a strict scenario is found. Processes all
    /// due events. Returns whether the goal is reached.
    fn pass_until(&mut self, end: Instant, goal: &mut Goal<'_>) -> bool {
        loop {
            if self.is_reached(goal) {
                return true;
            }
            if self.is_broken() {
                return false;
            }
            if self.target.go(end) {
                self.look();
                return self.is_reached(goal);
            }
            self.look();
            (self.watch)(self.target.simulation_mut());
        }
    }

    fn is_reached(&mut self, goal: &mut Goal<'_>) -> bool {
        let simulation = self.target.simulation();
        match (goal, &mut self.claims) {
            (Goal::Frames(frames), None) => {
                frames.look(simulation.history());
                frames.are_all_there()
            }
            (Goal::Frames(frames), Some(claims)) => {
                claims.look(simulation.now(), simulation.history(), Some(frames));
                frames.are_all_there()
            }
            (goal, claims) => {
                if let Some(claims) = claims {
                    claims.look(simulation.now(), simulation.history(), None);
                }
                matches!(goal, Goal::Command(ticket) if self.ended.iter().any(|(known, _)| known == ticket))
            }
        }
    }

    /// Processes new events and collects completed commands.
    fn look(&mut self) {
        while let Some(happened) = self.target.simulation_mut().take_event() {
            if let Some(Trace { layout, text }) = &mut self.trace {
                happened.lay_out(text, layout, self.target.simulation().history().explainer());
            }
        }
        self.target.simulation_mut().poll();
        self.ended.extend(self.target.simulation_mut().take_completed());
        // A prohibition proves nothing for a device at another bit rate, so such devices are detected at the end of
        // each prohibition.
        let now = self.target.simulation().now();
        if self.guards.iter().any(|guard| guard.until == now) {
            self.target.simulation_mut().rates_mut().find_at(now);
        }
        self.fail_unheard();
        self.guard();
    }

    /// Adds a failure for each device at a bit rate different from the bus. The failure refers to the line of the
    /// device if the rates differed from the start, otherwise to the current step.
    fn fail_unheard(&mut self) {
        for NotHeard { device, since, reason, .. } in self.target.simulation_mut().rates_mut().take_found() {
            let place = self.scenario.devices.iter().position(|known| known.name == device);
            let entry = place.and_then(|place| self.scenario.entries.get(place));
            let step = self.step.filter(|_| since > Instant::from_ticks(0));
            let line = step.map(|step| step.line).or(entry.map(|entry| entry.line)).unwrap_or(1);
            let failure = Failure::not_heard(line, reason).with(self.target.simulation().now(), Vec::new());
            self.failures.push(failure);
        }
    }

    /// Checks the active prohibitions.
    fn guard(&mut self) {
        for mut guard in std::mem::take(&mut self.guards) {
            let ended = self.ended.iter().position(|(known, _)| *known == guard.ticket);
            let ended = ended.map(|place| self.ended.swap_remove(place).1);
            match self.violation(&mut guard, ended.as_ref()) {
                Some(failure) => {
                    self.target.simulation_mut().forget(guard.ticket);
                    self.fail(failure);
                }
                None if ended.is_some() => self.end_guard(&guard),
                None => self.guards.push(guard),
            }
        }
    }

    /// Ends all prohibitions at the end of the scenario.
    fn end_guards(&mut self) {
        for guard in std::mem::take(&mut self.guards) {
            self.end_guard(&guard);
        }
    }

    /// Fails the step of a prohibition that was never checked, because no time has passed or because `t_us` was outside
    /// the checked time.
    fn end_guard(&mut self, guard: &Guard<'_>) {
        let end = guard.until.min(self.target.simulation().now());
        let instant = match &guard.what {
            Guarded::State(wanted) => wanted.condition.t_us.map(Instant::from_micros),
            Guarded::Frames(..) => None,
        };
        let reason = match instant {
            _ if end <= guard.since => "no time has passed: nothing was checked",
            Some(instant) if instant < guard.since || instant > end => {
                "t_us was outside the checked time: nothing was checked"
            }
            _ => return,
        };
        self.fail(Failure::undone(guard.step, "never", reason));
    }

    /// Returns the violation of a prohibition, if any. `ended` is the result of the prohibition's ticket, if the ticket
    /// has completed.
    fn violation(&mut self, guard: &mut Guard<'_>, ended: Option<&Result<Reply, Refusal>>) -> Option<Failure> {
        let history = self.target.simulation().history();
        match (&mut guard.what, ended) {
            (Guarded::Frames(patterns, next), _) => {
                let is_it = |heard: Heard| Some((heard, patterns.iter().find(|it| it.matches(&heard.frame))?));
                let found = history.heard_since(*next).find_map(is_it);
                *next = history.next();
                found.map(|(heard, pattern)| Failure::came(guard.step, pattern, &heard, history))
            }
            (Guarded::State(wanted), Some(Ok(Reply::Device(state)))) => Some(Failure::held(guard.step, wanted, state)),
            (Guarded::State(_), _) => None,
        }
    }

    /// Adds a failure at the current time, with the events before it.
    fn fail(&mut self, failure: Failure) {
        let (at, history) = (self.target.simulation().now(), self.target.simulation().history());
        let until = failure.until().unwrap_or_else(|| history.next());
        self.failures.push(failure.with(at, history.excerpt(self.shown, until)));
        self.shown = self.shown.max(until);
    }

    fn outcome(mut self) -> Outcome {
        let errors = self.target.simulation().history().errors();
        self.failures.iter_mut().for_each(|failure| failure.show_errors(&errors));
        Outcome {
            title: self.scenario.title.clone(),
            steps: self.scenario.steps.len(),
            end: self.target.simulation().now(),
            failures: self.failures,
            trace: self.trace.map_or_else(String::new, Trace::finish),
        }
    }
}

impl Trace {
    fn note(&mut self, note: &str) {
        self.layout.finish(&mut self.text);
        for line in note.lines() {
            self.text.push_str("-- ");
            self.text.push_str(line);
            self.text.push('\n');
        }
    }

    fn finish(mut self) -> String {
        self.layout.finish(&mut self.text);
        self.text
    }
}

/// Returns the text for a command in failure headlines: the scenario key, and the frame or fault.
fn name(command: &Command) -> String {
    match command {
        Command::Send(frame, _) => format!("send {frame}"),
        Command::Plant(..) => "plant".to_owned(),
        Command::Power(..) => "power".to_owned(),
        Command::BitRate(_) => "bus".to_owned(),
        Command::Disturb(_) => "disturb".to_owned(),
        Command::Fault(fault) => format!("fault {fault}"),
        Command::EndFaults(_) => "end".to_owned(),
        Command::Stop(_) => "stop".to_owned(),
        Command::Wait(..) | Command::Advance(_) => "wait".to_owned(),
    }
}
