//! A simulation: a world with named devices, commands to it, and the history of its bus.
//!
//! ```text
//! command    the commands and their replies
//! sender     frames sent on command, once or cyclically
//! waits      commands that wait for a state, a frame or a time
//! profiles   plant changes over time
//! history    the history of the bus
//! bus        the state of the bus
//! heard      a check for devices whose bit rate differs from that of the bus
//! ```
//!
//! Calls of the control interface, scenario steps and console lines are all parsed into a [`Command`], which
//! [`Simulation::execute`] executes.

mod bus;
mod command;
mod heard;
mod history;
mod profiles;
mod sender;
mod waits;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::iter;

use protocol_core::controller::BitRate;
use protocol_core::time::{Duration, Instant, NEVER, after};

pub use bus::{BusState, DisturbState};
pub use command::{Advanced, Command, Executed, Refusal, Reply, Sent, Stopped, Ticket, TimedOut};
pub use heard::{GRACE, NotHeard, RateWatch};
pub use history::{BusTrouble, Excerpt, FrameRecord, Happened, Heard, History, KEPT, TraceRecord};
pub use profiles::RAMP_STEP;

use crate::Kind;
use crate::bus::{Fault, FaultKind, FaultState};
use crate::devices::{self, NamedDevice, NamedLink};
use crate::memory::Memory;
use crate::state::{Condition, DeviceState, FaultRecord, StateWatch};
use crate::world::{Event, NodeId, World};
use profiles::Profiles;
use sender::{Completed, Sender};
use waits::{Awaited, Waits};

/// A world with named devices that executes commands.
///
/// Every advance of time takes three steps: [`go`](Self::go), then [`take_event`](Self::take_event) until all events
/// are taken, then [`poll`](Self::poll). [`run`](Self::run) and [`run_until`](Self::run_until) combine these steps.
///
/// A clone continues exactly as the original would, with the same pending commands.
#[derive(Clone)]
pub struct Simulation {
    world: World,
    devices: Vec<(NodeId, Kind)>,
    sender: Option<Sender>,
    waits: Waits,
    /// The number of the first event after the last frame of [`Condition::Received`].
    received: u64,
    profiles: Profiles,
    rates: RateWatch,
    history: History,
    /// The events that have not been taken. The queue is reused to keep its capacity.
    events: VecDeque<Event>,
    completed: Completed,
    /// The number of tickets issued so far.
    tickets: u64,
    /// The command-line option that would permit all communication faults on a bus with real devices; `None` if all
    /// faults are permitted.
    protected: Option<&'static str>,
}

impl Simulation {
    /// Creates an empty simulation at instant 0.
    #[must_use]
    pub fn new(bit_rate: BitRate, seed: u64) -> Self {
        let mut world = World::new(bit_rate, seed);
        world.record_events(true);
        Self {
            world,
            devices: Vec::new(),
            sender: None,
            waits: Waits::default(),
            received: 0,
            profiles: Profiles::default(),
            rates: RateWatch::default(),
            history: History::default(),
            events: VecDeque::new(),
            completed: Completed::new(),
            tickets: 0,
            protected: None,
        }
    }

    /// Adds a healthy, unpowered device with this memory.
    pub fn add(&mut self, device: &NamedDevice, memory: Memory) -> NodeId {
        let node = device.add_to(&mut self.world, memory);
        self.devices.push((node, device.setup.kind));
        self.rates.watch(node, device, &self.world);
        self.history.add_device(&device.name, device.setup.kind, node);
        node
    }

    /// Links sensor shafts to valves.
    pub fn link(&mut self, links: &[NamedLink]) {
        devices::link_in(&mut self.world, links);
    }

    /// Adds the command sender: the controller that sends the frames of commands. `name` identifies the sender in
    /// traces.
    pub fn send_as(&mut self, name: &str) {
        self.sender = Some(Sender::new(name, &mut self.world));
        self.history.set_own(name);
    }

    /// Protects a bus with real devices: refuses communication faults that affect more than the simulated devices.
    /// `option` is the command-line option that would permit all faults.
    pub const fn protect_bus(&mut self, option: &'static str) {
        self.protected = Some(option);
    }

    /// Powers on all devices that are off, each after a random delay up to `jitter`.
    pub fn power_up(&mut self, jitter: Duration) {
        self.world.power_all(jitter);
        self.history.learn(&self.world);
        self.rates.look(&mut self.world);
    }

    /// Returns the world.
    #[must_use]
    pub const fn world(&self) -> &World {
        &self.world
    }

    /// Returns the world, mutably. Only [`go`](Self::go) may advance time.
    pub const fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// Returns the virtual time.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.world.now()
    }

    /// Returns the devices with their kinds, in the order in which they were added.
    #[must_use]
    pub fn devices(&self) -> &[(NodeId, Kind)] {
        &self.devices
    }

    /// Returns the history of the bus.
    #[must_use]
    pub const fn history(&self) -> &History {
        &self.history
    }

    /// Returns the device bit-rate monitor, mutably.
    pub const fn rates_mut(&mut self) -> &mut RateWatch {
        &mut self.rates
    }

    /// Returns the states of all devices.
    pub fn states(&self) -> Vec<DeviceState> {
        self.devices.iter().map(|(node, kind)| DeviceState::of(*node, *kind, &self.world)).collect()
    }

    /// Returns the state of the named device.
    ///
    /// # Errors
    /// [`Refusal::Unknown`]
    pub fn state(&self, name: &str) -> Result<DeviceState, Refusal> {
        let (node, kind) = self.find(name)?;
        Ok(DeviceState::of(node, kind, &self.world))
    }

    /// Returns the state of the bus.
    pub fn bus(&mut self) -> BusState {
        self.rates.look(&mut self.world);
        BusState::of(&self.world, &self.rates)
    }

    /// Returns the named device and its kind.
    ///
    /// # Errors
    /// [`Refusal::Unknown`]
    pub fn find(&self, name: &str) -> Result<(NodeId, Kind), Refusal> {
        let found = self.devices.iter().find(|(node, _)| self.world.name(*node) == name);
        found.copied().ok_or_else(|| {
            let known: Vec<&str> = self.devices.iter().map(|(node, _)| self.world.name(*node)).collect();
            Refusal::Unknown(format!("no device '{name}'; accepted: {}", known.join(", ")))
        })
    }

    /// Executes a command at the current instant.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed.
    pub fn execute(&mut self, command: Command) -> Result<Executed, Refusal> {
        let reply = match command {
            Command::Plant(name, change) => {
                let (node, _) = self.find(&name)?;
                self.profiles.begin(node, &change, &mut self.world)?;
                Reply::Device(Box::new(self.state(&name)?))
            }
            Command::Power(name, power) => {
                let (node, _) = self.find(&name)?;
                power.switch(node, &mut self.world).map_err(|reason| Refusal::Conflict(reason.to_owned()))?;
                Reply::Device(Box::new(self.state(&name)?))
            }
            Command::BitRate(bit_rate) => {
                self.world.set_bit_rate(bit_rate);
                Reply::Bus(self.bus())
            }
            Command::Disturb(disturbance) => {
                self.world.disturb(disturbance);
                Reply::Bus(self.bus())
            }
            Command::Fault(fault) => Reply::Fault(self.fault(fault)?),
            Command::EndFaults(name) => Reply::Faults(self.end_faults(name)?),
            Command::Stop(id) => {
                let Self { sender, world, completed, .. } = self;
                Reply::Stopped(Stopped {
                    stopped: sender.as_mut().map_or(0, |sender| sender.stop(id, world, completed)),
                })
            }
            Command::Send(frame, period) => {
                let ticket = self.ticket();
                let Self { sender, world, completed, .. } = self;
                let sender = sender
                    .as_mut()
                    .ok_or_else(|| Refusal::Conflict("this simulation cannot send frames".to_owned()))?;
                sender.send(frame, period, ticket, world, completed)?;
                self.poll();
                return Ok(Executed::Pending(ticket));
            }
            Command::Wait(condition, within) => {
                let awaited = self.awaited(condition)?;
                return Ok(Executed::Pending(self.wait(awaited, within)));
            }
            Command::Advance(span) => return Ok(Executed::Pending(self.wait(Awaited::Time, span))),
        };
        self.poll();
        Ok(Executed::Done(reply))
    }

    /// Adds a communication fault, with a default name if it has none.
    fn fault(&mut self, mut fault: Fault) -> Result<FaultRecord, Refusal> {
        if fault.name.is_empty() {
            let name = fault.default_name();
            let is_taken = |name: &str| {
                self.world.find(name).is_some() || self.world.faults().any(|state| *state.fault.name == *name)
            };
            let numbered = (2..).map(|number| format!("{name}-{number}"));
            fault.name = iter::once(name.clone()).chain(numbered).find(|name| !is_taken(name)).unwrap_or(name).into();
        }
        if let Some(option) = self.protected
            && !self.spares_others(&fault)
        {
            return Err(Refusal::Conflict(format!(
                "the bus may have real devices; only 'lose' with simulated devices as receivers is accepted without {option}"
            )));
        }
        let record = FaultRecord::from(FaultState { fault: fault.clone(), struck: 0, is_over: false });
        self.world.fault(fault)?;
        Ok(record)
    }

    /// Returns whether a fault affects simulated devices only.
    fn spares_others(&self, fault: &Fault) -> bool {
        let FaultKind::Lose { receivers } = &fault.kind else { return false };
        !receivers.is_empty() && receivers.iter().all(|name| self.find(name).is_ok())
    }

    /// Ends the named communication fault, or all faults. Returns the ended faults.
    fn end_faults(&mut self, name: Option<String>) -> Result<Vec<FaultRecord>, Refusal> {
        let is_meant = |record: &FaultRecord| name.as_ref().is_none_or(|name| record.name == *name);
        let ended = self.faults().filter(is_meant).collect();
        match name {
            None => self.world.end_faults(),
            Some(name) if !self.world.end_fault(&name) => {
                let known: Vec<String> = self.faults().map(|record| record.name).collect();
                let known = match known.as_slice() {
                    [] => "there are no faults".to_owned(),
                    known => format!("known: {}", known.join(", ")),
                };
                return Err(Refusal::Unknown(format!("no fault '{name}'; {known}")));
            }
            Some(_) => {}
        }
        Ok(ended)
    }

    /// Ends the plant changes in progress; the plants keep their current values.
    pub fn end_profiles(&mut self) {
        self.profiles.clear();
    }

    /// Returns the communication faults in the order in which they were added, including expired faults.
    pub fn faults(&self) -> impl Iterator<Item = FaultRecord> {
        self.world.faults().map(FaultRecord::from)
    }

    fn ticket(&mut self) -> Ticket {
        self.tickets += 1;
        Ticket(self.tickets)
    }

    fn wait(&mut self, awaited: Awaited, within: Duration) -> Ticket {
        let ticket = self.ticket();
        self.waits.begin(awaited, after(self.world.now(), within), ticket);
        self.receive();
        self.poll();
        ticket
    }

    /// Completes the oldest wait for a received frame, if there is such a frame.
    fn receive(&mut self) {
        if let Some(ticket) = self.waits.receiver()
            && let Some((record, next)) = self.history.received_since(self.received)
        {
            self.received = next;
            self.waits.forget(ticket);
            self.completed.push((ticket, Ok(Reply::Frame(record))));
        }
    }

    fn awaited(&self, condition: Condition) -> Result<Awaited, Refusal> {
        match condition {
            Condition::Frame(pattern) => Ok(Awaited::Frame(pattern, None)),
            Condition::Received => Ok(Awaited::Received),
            Condition::State(name, condition) => {
                let device = self.find(&name)?;
                condition.check(&name, device.1, "null").map_err(|invalid| Refusal::Invalid(invalid.0))?;
                Ok(Awaited::State(StateWatch::new(device, condition)))
            }
        }
    }

    /// Drops the result of a pending command. A queued frame is still sent.
    pub fn forget(&mut self, ticket: Ticket) {
        self.waits.forget(ticket);
        if let Some(sender) = &mut self.sender {
            sender.forget(ticket);
        }
        self.completed.retain(|(known, _)| *known != ticket);
    }

    /// Takes the commands completed since the last call.
    pub fn take_completed(&mut self) -> Vec<(Ticket, Result<Reply, Refusal>)> {
        std::mem::take(&mut self.completed)
    }

    /// Takes the result of a pending command; `None` if the command has not completed.
    pub fn take_result(&mut self, ticket: Ticket) -> Option<Result<Reply, Refusal>> {
        let place = self.completed.iter().position(|(known, _)| *known == ticket)?;
        Some(self.completed.remove(place).1)
    }

    /// Returns whether a pending command has completed and its result has not been taken.
    #[must_use]
    pub fn has_completed(&self, ticket: Ticket) -> bool {
        self.completed.iter().any(|(known, _)| *known == ticket)
    }

    /// Advances to the next event or due time, but no further than `end`. Returns whether `end` is reached. The events
    /// must be [taken](Self::take_event) before the next [`poll`](Self::poll).
    pub fn go(&mut self, end: Instant) -> bool {
        let (event, due) = (self.world.next_event(), self.due());
        if event.min(due) > end || event.min(due) == NEVER {
            self.world.run_until(end);
            return true;
        }
        if event <= due {
            self.world.step();
        } else {
            self.world.run_until(due);
        }
        false
    }

    /// Takes the next bus event. [`History::explainer`] explains this event until the next event is taken.
    pub fn take_event(&mut self) -> Option<Happened> {
        if self.events.is_empty() {
            self.events.extend(self.world.take_events());
        }
        let happened = self.history.keep(self.events.pop_front()?, &self.world);
        if !self.waits.is_empty() && happened.event.frame().is_some() {
            self.waits.show(&happened, self.history.explainer(), &mut self.completed);
            self.receive();
        }
        Some(happened)
    }

    /// Processes due commands and waits. Must be called after each [`go`](Self::go), once all events are taken.
    pub fn poll(&mut self) {
        if let Some(sender) = &mut self.sender {
            sender.poll(&mut self.world, &mut self.completed);
        }
        self.profiles.poll(&mut self.world);
        self.waits.poll(&mut self.world, &mut self.completed);
        self.rates.look(&mut self.world);
    }

    /// Returns the time of the next world event or due command.
    #[must_use]
    pub fn next(&self) -> Instant {
        self.world.next_event().min(self.due())
    }

    fn due(&self) -> Instant {
        let rates = self.rates.due(self.world.now()).min(self.profiles.due());
        let sender = self.sender.as_ref().map_or(rates, |sender| rates.min(sender.due(self.world.now())));
        if self.waits.is_empty() { sender } else { sender.min(self.waits.due(&self.world)) }
    }

    /// Returns the latest time limit of the pending commands; `None` if no command is pending.
    #[must_use]
    pub fn advance_limit(&self) -> Option<Instant> {
        let sender = self.sender.as_ref().and_then(|sender| sender.advance_limit(self.world.now()));
        self.waits.advance_limit().max(sender)
    }

    /// Returns whether a command or a frame is pending, or a cyclic frame is active.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        !self.waits.is_empty() || self.sender.as_ref().is_some_and(|sender| !sender.is_idle())
    }

    /// Executes a command and advances until it completes.
    ///
    /// # Errors
    /// [`Refusal`]; [`Refusal::Conflict`] if virtual time reaches its limit before the command completes.
    pub fn run(&mut self, command: Command) -> Result<Reply, Refusal> {
        let ticket = match self.execute(command)? {
            Executed::Done(reply) => return Ok(reply),
            Executed::Pending(ticket) => ticket,
        };
        loop {
            if let Some(result) = self.take_result(ticket) {
                return result;
            }
            if self.now() == NEVER {
                return Err(Refusal::Conflict(
                    "virtual time reached its limit before the command completed".to_owned(),
                ));
            }
            self.pass(NEVER);
        }
    }

    /// Advances to `end` and processes all events up to and including `end`.
    pub fn run_until(&mut self, end: Instant) {
        while !self.pass(end) {}
    }

    /// Advances to the next event or due time, but no further than `end`, and processes the events. Returns whether
    /// `end` is reached.
    fn pass(&mut self, end: Instant) -> bool {
        let has_arrived = self.go(end);
        while self.take_event().is_some() {}
        self.poll();
        has_arrived
    }
}
