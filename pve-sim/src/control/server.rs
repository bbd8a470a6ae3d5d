//! The control server, which executes the messages of the control interface.

use std::collections::VecDeque;

use super::events::Events;
use super::message::{Answer, Message, SpeedValue, StepWord, Time};
use crate::speed::Speed;
use hal_sim::devices::CONTROL;
use hal_sim::simulation::{Command, Executed, Happened, Refusal, Reply, Simulation, Ticket};
use protocol_core::time::Instant;

/// The control server: passes commands to the simulation and replies to the callers.
#[derive(Debug)]
pub(crate) struct ControlServer {
    speed: Speed,
    events: Events,
    /// The pending commands.
    pending: Vec<(Ticket, Caller)>,
    /// The queue of commands that take time; stepped time executes them one after the other.
    queue: VecDeque<(Command, Caller)>,
}

/// The caller of a command.
#[derive(Debug)]
enum Caller {
    Reply(Answer<Reply>),
    Time(Answer<Time>),
}

impl ControlServer {
    /// Adds the control interface to a simulation.
    pub(crate) fn new(speed: Speed, simulation: &mut Simulation) -> Self {
        simulation.send_as(CONTROL);
        let factor = match speed {
            Speed::Factor(factor) => factor,
            Speed::Step => 1.0,
        };
        let events = Events::new(factor, simulation);
        Self { speed, events, pending: Vec::new(), queue: VecDeque::new() }
    }

    /// Executes a message at the current instant of the world.
    pub(crate) fn execute(&mut self, message: Message, simulation: &mut Simulation) {
        match message {
            Message::Execute(command, answer) => self.take(command, Caller::Reply(answer), simulation),
            Message::Advance(_, answer) if self.speed != Speed::Step => answer
                .send(Err(Refusal::Conflict("time advances automatically; this call needs --speed step".to_owned()))),
            Message::Advance(span, answer) => self.take(Command::Advance(span), Caller::Time(answer), simulation),
            Message::Devices(answer) => answer.send(Ok(simulation.states())),
            Message::Device(name, answer) => answer.send(simulation.state(&name)),
            Message::Bus(answer) => answer.send(Ok(simulation.bus())),
            Message::Faults(answer) => answer.send(Ok(simulation.faults().collect())),
            Message::Time(answer) => answer.send(Ok(self.time(simulation))),
            Message::Trace(limit, answer) => answer.send(Ok(simulation.history().last(limit))),
            Message::Subscribe(answer) => answer.send(self.events.subscribe(simulation)),
        }
        self.poll(simulation);
    }

    /// Executes a command immediately; with stepped time, queues a command that takes time.
    fn take(&mut self, command: Command, caller: Caller, simulation: &mut Simulation) {
        if self.speed == Speed::Step && command.takes_time() {
            // The limit on waiting calls bounds the remaining queue.
            self.queue.retain(|(_, caller)| !caller.is_gone());
            self.queue.push_back((command, caller));
        } else {
            self.begin(command, caller, simulation);
        }
    }

    fn begin(&mut self, command: Command, caller: Caller, simulation: &mut Simulation) {
        match simulation.execute(command) {
            Ok(Executed::Done(reply)) => self.answer(caller, Ok(reply), simulation),
            Ok(Executed::Pending(ticket)) => self.pending.push((ticket, caller)),
            Err(refusal) => self.answer(caller, Err(refusal), simulation),
        }
        self.poll(simulation);
    }

    /// Sends an event to the followers. Call this for each event in order, before [`poll`](Self::poll).
    pub(crate) fn show(&self, happened: &Happened, simulation: &Simulation) {
        self.events.show(happened, simulation.history().explainer());
    }

    /// Replies to the callers of completed commands, drops the commands of disconnected callers, and sends changed
    /// device states to the followers. Call this after every step of the simulation.
    pub(crate) fn poll(&mut self, simulation: &mut Simulation) {
        for (gone, _) in self.pending.extract_if(.., |(_, caller)| caller.is_gone()) {
            simulation.forget(gone);
        }
        for (ticket, end) in simulation.take_completed() {
            if let Some(place) = self.pending.iter().position(|(known, _)| *known == ticket) {
                let (_, caller) = self.pending.swap_remove(place);
                self.answer(caller, end, simulation);
            }
        }
        self.events.poll(simulation);
    }

    fn answer(&self, caller: Caller, end: Result<Reply, Refusal>, simulation: &Simulation) {
        match caller {
            Caller::Reply(answer) => answer.send(end),
            Caller::Time(answer) => answer.send(end.map(|_| self.time(simulation))),
        }
    }

    /// Returns the time of the next position sample of the event stream.
    pub(crate) fn due(&self) -> Instant {
        self.events.due()
    }

    /// Returns whether there is a follower.
    pub(crate) fn is_followed(&self) -> bool {
        self.events.is_followed()
    }

    /// Returns the limit to which the current command lets stepped time advance. Starts the next queued command if no
    /// command is pending; returns `None` if there is none.
    pub(crate) fn advance_limit(&mut self, simulation: &mut Simulation) -> Option<Instant> {
        loop {
            self.poll(simulation);
            if !self.pending.is_empty() {
                return simulation.advance_limit();
            }
            let (command, caller) = self.queue.pop_front()?;
            // The command of a disconnected client is skipped.
            if !caller.is_gone() {
                self.begin(command, caller, simulation);
            }
        }
    }

    fn time(&self, simulation: &Simulation) -> Time {
        let speed = match self.speed {
            Speed::Factor(factor) => SpeedValue::Factor(factor),
            Speed::Step => SpeedValue::Step(StepWord::Step),
        };
        Time { now_us: simulation.now().as_micros(), speed }
    }
}

impl Caller {
    fn is_gone(&self) -> bool {
        match self {
            Self::Reply(answer) => answer.is_given_up(),
            Self::Time(answer) => answer.is_given_up(),
        }
    }
}
