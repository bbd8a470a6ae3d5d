//! The control server, which executes the messages of the control interface.

use std::collections::VecDeque;

use super::events::Events;
use super::{Answer, Message, Speed, Time};
use hal_sim::devices::CONTROL;
use hal_sim::simulation::{Command, Executed, Refusal, Reply, Simulation, Ticket};
use protocol_core::time::Instant;

/// The control server: passes commands to the simulation and replies to the callers.
#[derive(Debug)]
pub(crate) struct ControlServer {
    speed: Speed,
    /// The event stream. Show each event in order, before [`poll`](Self::poll).
    pub(crate) events: Events,
    /// The pending commands.
    pending: Vec<(Ticket, Answer<Reply>)>,
    /// The queue of commands that take time; stepped time executes them one after the other.
    queue: VecDeque<(Command, Answer<Reply>)>,
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

    /// Executes a message at the current instant of the world. The answer to a disconnected client is dropped.
    pub(crate) fn execute(&mut self, message: Message, simulation: &mut Simulation) {
        match message {
            Message::Execute(Command::Advance(_), answer) if self.speed != Speed::Step => {
                let reason = "time advances automatically; this call needs --speed step".to_owned();
                drop(answer.send(Err(Refusal::Conflict(reason))));
            }
            Message::Execute(command, answer) if self.speed == Speed::Step && command.takes_time() => {
                // The limit on waiting calls bounds the remaining queue.
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
                drop(answer.send(Ok(Time { now_us, speed: self.speed.into() })));
            }
            Message::Trace(limit, answer) => drop(answer.send(Ok(simulation.history().last(limit)))),
            Message::Subscribe(answer) => drop(answer.send(self.events.subscribe(simulation))),
        }
        self.poll(simulation);
    }

    fn begin(&mut self, command: Command, answer: Answer<Reply>, simulation: &mut Simulation) {
        match simulation.execute(command) {
            Ok(Executed::Done(reply)) => drop(answer.send(Ok(reply))),
            Ok(Executed::Pending(ticket)) => self.pending.push((ticket, answer)),
            Err(refusal) => drop(answer.send(Err(refusal))),
        }
    }

    /// Replies to the callers of completed commands, drops the commands of disconnected callers, and sends changed
    /// device states to the followers. Call this after every step of the simulation.
    pub(crate) fn poll(&mut self, simulation: &mut Simulation) {
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
