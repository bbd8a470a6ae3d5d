//! The thread of the world: advances time, executes messages of clients, and shows bus events.
//!
//! A message takes effect at the virtual time of its arrival, after the world has caught up completely. A late world
//! skips no event; the number of events between two clock readings is limited, so that messages never wait long.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use protocol_core::time::{Instant, NEVER, after};
use tokio_util::sync::CancellationToken;

use super::clients::Clients;
use super::console;
use super::platform::{Platform, SPIN};
use super::printer::Printer;
use super::timekeeper::{MAX_SLEEP, Timekeeper};
use super::trace::Trace;
use crate::control::{ControlServer, Message, Speed};
use crate::inbox::{Arrival, ToWorld};
use hal_sim::log::Timestamp;
use hal_sim::simulation::Simulation;
use hal_sim::world::SUPPLY_JITTER;

/// The maximum number of events between two clock readings: a few milliseconds of work.
const EVENT_BATCH: usize = 1000;

/// A simulation with its connections.
pub struct Driver<O> {
    simulation: Simulation,
    clients: Clients,
    control: Option<ControlServer>,
    platform: O,
    time: Timekeeper,
    /// Whether only the control interface advances time.
    is_stepped: bool,
    /// The wall time of virtual instant 0, for traces and clients.
    start: Timestamp,
    trace: Trace,
    /// The messages that have not taken effect yet, oldest first.
    arrivals: VecDeque<Arrival>,
    /// The wall time of the last flush, except those of a world that is behind.
    last_flush: WallInstant,
}

impl<O: Platform> Driver<O> {
    /// Creates a driver of an unpowered simulation. `start` is the wall time of virtual instant 0.
    pub(super) fn new(
        simulation: Simulation,
        clients: Clients,
        control: Option<ControlServer>,
        mut platform: O,
        speed: Speed,
        start: Timestamp,
        trace: Trace,
    ) -> Self {
        let now = platform.now();
        Self {
            simulation,
            clients,
            control,
            platform,
            time: Timekeeper::start(speed.factor(), now),
            is_stepped: speed == Speed::STEP,
            start,
            trace,
            arrivals: VecDeque::new(),
            last_flush: now,
        }
    }

    /// Creates a driver for a program with its own wall clock and clients, at a finite speed above zero. Powers the
    /// devices, and keeps no log. Call [`turn`](Self::turn) repeatedly.
    ///
    /// # Errors
    /// When the thread that writes to `stdout` and `stderr` cannot be started.
    pub fn embedded(
        mut simulation: Simulation,
        platform: O,
        speed: f64,
        stdout: impl Write + Send + 'static,
        stderr: impl Write + Send + 'static,
    ) -> io::Result<Self> {
        let clients = Clients::new(simulation.world_mut(), false);
        let printer = Printer::start(stdout, stderr, CancellationToken::new())?;
        let trace = Trace::new("pve0", printer, None, None);
        let start = Timestamp::from_micros(0);
        let mut driver = Self::new(simulation, clients, None, platform, Speed::Factor(speed), start, trace);
        driver.power_on();
        Ok(driver)
    }

    /// Adds a control interface. `speed` must be the driver's speed, or [`Speed::STEP`], with which only calls advance
    /// time.
    #[must_use]
    pub fn controlled(mut self, speed: Speed) -> Self {
        self.is_stepped = speed == Speed::STEP;
        self.control = Some(ControlServer::new(speed, None, &mut self.simulation));
        self
    }

    /// Powers the devices and runs until the end; then lets the devices store their pending records.
    ///
    /// Returns whether everything was stored, and the log and stdout are complete.
    pub(super) fn run(mut self) -> bool {
        self.wait_for_controller();
        self.power_on();
        while !self.platform.is_ending() {
            self.turn();
        }
        self.finish()
    }

    /// Lets the devices store their pending records, and ends the output. Nothing more is shown, because slow devices do
    /// not wait for their next cycle.
    fn finish(mut self) -> bool {
        self.warn_of_memories();
        self.simulation.world_mut().flush_all();
        let is_stored = !self.warn_of_memories();
        self.trace.finish() && is_stored
    }

    /// In a cell of a campaign, waits until a client listens to the bus or sends a command: the start of a controller
    /// takes no virtual time. Stepped time waits for its calls anyway.
    fn wait_for_controller(&mut self) {
        let is_judged = self.control.as_ref().is_some_and(ControlServer::is_judged);
        let mut waits = is_judged && !self.is_stepped;
        while waits && !self.platform.is_ending() {
            self.flush();
            let Some(arrival) = self.platform.wait(None, WallDuration::ZERO) else { continue };
            waits = !matches!(arrival.message, ToWorld::Listen(..) | ToWorld::Control(Message::Execute(..)));
            self.arrivals.push_back(arrival);
            if waits {
                self.execute_next();
            }
        }
        let now = self.platform.now();
        self.time.restart(now, self.simulation.now());
    }

    /// Lets the gateways join, then powers the first device immediately, and the others at random moments within
    /// [`SUPPLY_JITTER`]. In a cell of a campaign, all devices are powered at random moments.
    fn power_on(&mut self) {
        self.accept_joins();
        let world = self.simulation.world_mut();
        // In a cell, all devices get power at random moments, as in its scenario.
        let is_judged = self.control.as_ref().is_some_and(ControlServer::is_judged);
        if let Some(first) = world.devices().next().filter(|_| !is_judged) {
            world.power(first, true);
        }
        self.simulation.power_up(SUPPLY_JITTER);
        let start_up_end = after(self.simulation.now(), SUPPLY_JITTER);
        self.trace.fit(&self.simulation);
        // Runs immediately, so that clients do not wait at a slow speed; the pace starts afterwards. Stepped time stays
        // at 0.
        while !self.is_stepped && !self.advance_to(start_up_end) {}
    }

    /// Executes the joins of gateways that have already arrived. Must be called before the first device is powered, so
    /// that the gateways receive its boot-up.
    fn accept_joins(&mut self) {
        while let Some(arrival) = self.platform.take() {
            self.arrivals.push_back(arrival);
        }
        let joins = |arrival: &Arrival| matches!(arrival.message, ToWorld::Join(..) | ToWorld::Listen(..));
        while self.arrivals.front().is_some_and(joins) {
            self.execute_next();
        }
    }

    /// Advances the world towards the present, or to the arrival of the next message, which is then executed. Waits if
    /// the world has caught up and no message is due. Stepped time advances only to the limit of the current call.
    pub fn turn(&mut self) {
        if self.is_stepped {
            return self.turn_stepped();
        }
        let now = self.platform.now();
        let warning = self.time.read(now, self.simulation.now());
        self.warn(warning);
        if self.arrivals.is_empty() {
            self.arrivals.extend(self.platform.take());
        }
        let due = self.arrivals.front().map_or(Instant::MAX, |next| self.time.at(next.at));
        if !self.catch_up(self.time.at(now).min(due)) {
            let warning = self.time.fell_behind(self.simulation.now());
            self.warn(warning);
            self.flush();
            return;
        }
        let warning = self.time.caught_up(self.simulation.now());
        self.warn(warning);
        if self.simulation.now() >= due {
            self.execute_next();
            // While clients always have a message due, the driver never waits. Otherwise the next wait flushes.
            if now >= self.last_flush + 2 * MAX_SLEEP {
                self.flush();
                self.last_flush = now;
            }
        } else {
            self.wait(due);
        }
    }

    /// Executes the received messages, then advances time towards the limit of the current call; waits for a message if
    /// there is no call.
    fn turn_stepped(&mut self) {
        while self.arrivals.len() < EVENT_BATCH
            && let Some(arrival) = self.platform.take()
        {
            self.arrivals.push_back(arrival);
        }
        while !self.arrivals.is_empty() {
            self.execute_next();
        }
        for _ in 0..EVENT_BATCH {
            let Some(end) = self.control.as_mut().and_then(|control| control.advance_limit(&mut self.simulation))
            else {
                self.flush();
                let arrival = self.platform.wait(None, WallDuration::ZERO);
                self.arrivals.extend(arrival);
                return;
            };
            self.advance_to(end);
        }
        self.flush();
    }

    /// Waits for a message or the next event. First flushes the output if the last flush was [`MAX_SLEEP`] ago, or if
    /// the wait can be that long.
    ///
    /// At a speed up to 1 without listeners, the thread wakes up only for messages and clock readings. Each event still
    /// takes effect at its own virtual instant.
    fn wait(&mut self, due: Instant) {
        let now = self.time.last_reading();
        let holds = self.time.holds_in_stalls();
        let is_followed = self.control.as_ref().is_some_and(|control| control.events.is_followed());
        let is_watched = self.clients.is_heard() || self.simulation.is_busy() || is_followed;
        let event = if holds && !is_watched { NEVER } else { self.next() };
        let next = self.time.when(event.min(due));
        let until = holds.then(|| now + MAX_SLEEP).into_iter().chain(next).min();
        if now >= self.last_flush + MAX_SLEEP || until.is_none_or(|until| until >= now + MAX_SLEEP) {
            self.flush();
            self.last_flush = now;
        }
        // For listeners, the thread wakes up early enough for the event.
        let spin = if is_watched && until == next { SPIN } else { WallDuration::ZERO };
        let arrival = self.platform.wait(until, spin);
        self.arrivals.extend(arrival);
    }

    /// Advances to `end`, or through [`EVENT_BATCH`] events; returns whether it reached `end`.
    fn catch_up(&mut self, end: Instant) -> bool {
        (0..EVENT_BATCH).any(|_| self.advance_to(end))
    }

    /// Advances to the next event or position sample, or to `end` if `end` comes first; returns whether it reached
    /// `end`.
    fn advance_to(&mut self, end: Instant) -> bool {
        let followers = self.control.as_ref().map_or(NEVER, ControlServer::due);
        let has_arrived = if followers <= end && followers < self.simulation.next() {
            self.simulation.go(followers);
            false
        } else {
            self.simulation.go(end)
        };
        self.show();
        self.clients.send(self.simulation.world_mut());
        self.poll();
        has_arrived
    }

    /// Returns the instant of the next event or position sample.
    fn next(&self) -> Instant {
        self.control.as_ref().map_or(NEVER, ControlServer::due).min(self.simulation.next())
    }

    /// Processes due power-ups, messages and samples, and sends the replies.
    fn poll(&mut self) {
        self.simulation.poll();
        self.warn_of_bit_rates();
        if let Some(control) = &mut self.control {
            control.poll(&mut self.simulation);
        }
    }

    fn execute_next(&mut self) {
        let Some(Arrival { message, .. }) = self.arrivals.pop_front() else { return };
        match message {
            ToWorld::Warn(line) => self.trace.printer.warn(line),
            ToWorld::Control(message) => {
                if let Some(control) = &mut self.control {
                    control.execute(message, &mut self.simulation);
                }
                self.show();
            }
            ToWorld::Typed(line, _done) => {
                match console::execute(&line, &mut self.simulation) {
                    Ok(answer) => answer.into_iter().for_each(|answer| self.trace.printer.note(answer)),
                    Err(refusal) => self.trace.printer.warn(refusal),
                }
                self.show();
                if let Some(control) = &mut self.control {
                    control.poll(&mut self.simulation);
                }
            }
            message => {
                if self.clients.apply(message, self.simulation.world_mut()).is_err() {
                    self.report_overrun();
                }
            }
        }
    }

    /// Shows new events to the clients, on stdout and in the log.
    fn show(&mut self) {
        while let Some(happened) = self.simulation.take_event() {
            let at = self.start.at(happened.event.at);
            // Clients come first, because they may answer.
            for _ in 0..self.clients.show(&happened.event, at, happened.error.as_ref().and_then(|(class, _)| *class)) {
                self.report_overrun();
            }
            if let Some(control) = &mut self.control {
                control.show(&happened, &self.simulation);
            }
            self.trace.tell(&happened, at, self.simulation.history().explainer());
            self.clients.withdraw(&happened.event, self.simulation.world_mut());
        }
    }

    /// Flushes stdout, stderr and the log.
    fn flush(&mut self) {
        self.trace.flush();
        self.warn_of_memories();
        let dropped = self.clients.take_dropped();
        if dropped > 0 {
            self.trace.printer.warn(format!(
                "dropped {dropped} pending frames of disconnected clients: the backlog limit was exceeded"
            ));
        }
    }

    fn warn_of_bit_rates(&mut self) {
        for found in self.simulation.rates_mut().take_found() {
            self.trace.printer.warn(found.reason);
        }
    }

    /// Prints the pending warnings of all memories; returns whether there were any.
    fn warn_of_memories(&mut self) -> bool {
        let mut warned = false;
        let world = self.simulation.world_mut();
        for node in world.devices() {
            for warning in world.memory_mut(node).take_warnings() {
                self.trace.printer.warn(warning);
                warned = true;
            }
        }
        warned
    }

    fn warn(&self, warning: Option<String>) {
        if let Some(line) = warning {
            self.trace.printer.warn(line);
        }
    }

    fn report_overrun(&self) {
        self.trace.printer.warn("disconnected a client that did not read its data".to_owned());
    }
}

#[cfg(test)]
#[path = "driver_tests.rs"]
mod tests;
