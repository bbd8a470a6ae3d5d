//! The control server, which executes the messages of the control interface.

use std::collections::VecDeque;

use super::events::Events;
use super::{Answer, Judged, JudgedCell, LAST, Message, Speed, Time};
use hal_sim::campaign::Judge;
use hal_sim::devices::CONTROL;
use hal_sim::simulation::{Command, Executed, Happened, Refusal, Reply, Simulation, Ticket};
use protocol_core::time::{Duration, Instant, NEVER, after};

/// The time within which a frame is sent or withdrawn: its time limit, and the last attempt to send it.
const SENDING: Duration = Duration::from_secs(2);

/// The control server: passes commands to the simulation and replies to the callers.
#[derive(Debug)]
pub(crate) struct ControlServer {
    speed: Speed,
    /// The event stream.
    pub(crate) events: Events,
    /// The pending commands.
    pending: Vec<(Ticket, Answer<Reply>)>,
    /// The queued commands of stepped time, which are executed one after the other.
    queue: VecDeque<(Command, Answer<Reply>)>,
    /// The judge of a campaign's cell, if there is one.
    judge: Option<Judge>,
}

impl ControlServer {
    /// Adds the control interface to a simulation. The judge is that of a campaign's cell, if there is one.
    pub(crate) fn new(speed: Speed, judge: Option<Judge>, simulation: &mut Simulation) -> Self {
        simulation.send_as(CONTROL);
        Self { speed, events: Events::new(speed.factor()), pending: Vec::new(), queue: VecDeque::new(), judge }
    }

    /// Returns whether a cell of a campaign is judged.
    pub(crate) const fn is_judged(&self) -> bool {
        self.judge.is_some()
    }

    /// Executes a message at the current instant of the world. The answer to a disconnected client is dropped.
    pub(crate) fn execute(&mut self, message: Message, simulation: &mut Simulation) {
        match message {
            Message::Execute(Command::Advance(_), answer) if self.speed != Speed::STEP => {
                let reason = "time advances automatically; this call needs --speed step".to_owned();
                drop(answer.send(Err(Refusal::Conflict(reason))));
            }
            Message::Execute(command, answer) if self.speed == Speed::STEP && command.takes_time() => {
                if let Some(result) = self.judge.as_ref().and_then(Judge::result) {
                    let reason = format!("the cell is decided: {}; time has stopped", result.verdict);
                    return drop(answer.send(Err(Refusal::Conflict(reason))));
                }
                // The queue is bounded by the limit on waiting calls.
                self.queue.retain(|(_, answer)| !answer.is_closed());
                self.queue.push_back((command, answer));
            }
            Message::Execute(command, answer) => self.begin(command, answer, simulation),
            Message::Devices(answer) => drop(answer.send(Ok(simulation.states()))),
            Message::Device(name, answer) => drop(answer.send(simulation.state(&name))),
            Message::Bus(answer) => drop(answer.send(Ok(simulation.bus()))),
            Message::Faults(answer) => drop(answer.send(Ok(simulation.faults().collect()))),
            Message::Time(answer) => {
                let now_us = simulation.now().as_micros();
                drop(answer.send(Ok(Time { now_us, speed: self.speed })));
            }
            Message::Cell(answer) => drop(answer.send(self.cell())),
            Message::Trace(limit, answer) => drop(answer.send(Ok(simulation.history().last(limit)))),
            Message::Subscribe(answer) => drop(answer.send(self.events.subscribe(simulation))),
        }
        self.poll(simulation);
    }

    fn begin(&mut self, command: Command, answer: Answer<Reply>, simulation: &mut Simulation) {
        let span = match &command {
            Command::Advance(span) | Command::Wait(_, span) => Some(*span),
            Command::Send(..) => Some(SENDING),
            _ => None,
        };
        if span.is_some_and(|span| after(simulation.now(), span) > LAST) {
            let reason = "virtual time reached its limit of 584 years".to_owned();
            return drop(answer.send(Err(Refusal::Conflict(reason))));
        }
        match simulation.execute(command) {
            Ok(Executed::Done(reply)) => drop(answer.send(Ok(reply))),
            Ok(Executed::Pending(ticket)) => self.pending.push((ticket, answer)),
            Err(refusal) => drop(answer.send(Err(refusal))),
        }
    }

    fn cell(&self) -> Result<JudgedCell, Refusal> {
        let Some(judge) = &self.judge else {
            return Err(Refusal::Conflict("no cell of a campaign is judged; start with --plan and --cell".to_owned()));
        };
        let result = judge.result().map(|result| Judged {
            verdict: result.verdict,
            detected_us: result.detected_us,
            safe_us: result.safe_us,
            struck: result.struck,
            reason: judge.reason().map(str::to_owned),
        });
        Ok(JudgedCell { decided: result.is_some(), until_us: judge.end().as_micros(), result })
    }

    /// Sends an event to the followers. Call this for each event in order, before [`poll`](Self::poll).
    pub(crate) fn show(&mut self, happened: &Happened, simulation: &Simulation) {
        if let Some(judge) = &mut self.judge {
            judge.event(happened);
        }
        self.events.show(happened, simulation.history().explainer());
    }

    /// Replies to the callers of completed commands, drops the commands of disconnected callers, and sends changed
    /// device states to the followers. Call this after every step of the simulation.
    pub(crate) fn poll(&mut self, simulation: &mut Simulation) {
        if let Some(judge) = &mut self.judge {
            judge.poll(simulation);
        }
        for (gone, _) in self.pending.extract_if(.., |(_, answer)| answer.is_closed()) {
            simulation.forget(gone);
        }
        for (ticket, end) in simulation.take_completed() {
            if let Some(place) = self.pending.iter().position(|(known, _)| *known == ticket) {
                drop(self.pending.swap_remove(place).1.send(end));
            }
        }
        self.events.poll(simulation);
    }

    /// Returns the time of the next position sample or of the judge's next check, whichever is earlier.
    pub(crate) fn due(&self) -> Instant {
        self.judge.as_ref().map_or(NEVER, Judge::due).min(self.events.due())
    }

    /// Returns the limit to which the current command lets stepped time advance. Starts the next queued command if no
    /// command is pending; returns `None` if there is none.
    pub(crate) fn advance_limit(&mut self, simulation: &mut Simulation) -> Option<Instant> {
        loop {
            self.poll(simulation);
            if !self.pending.is_empty() {
                return simulation.advance_limit();
            }
            let (command, answer) = self.queue.pop_front()?;
            // The command of a disconnected client is skipped.
            if !answer.is_closed() {
                self.begin(command, answer, simulation);
            }
        }
    }
}
