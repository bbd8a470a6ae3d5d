//! The thread of the world: keeps its time, takes what clients want, and shows what was on the bus.
//!
//! A message of a client takes effect at the virtual time of its arrival: until then the world has caught up completely.
//! How long it works before it looks at the clock again is bounded by a number of events, so a world that is behind
//! neither skips anything nor keeps anybody waiting for long.
//!
//! Time can be lost in two ways, and then goes on from where the world is. A **process that stood still**, at a speed up
//! to 1: masters are on the wall clock, and no valve is to take the pause for one of theirs. A **speed that cannot be
//! reached**: the world would fall behind for ever.

use std::collections::VecDeque;
use std::time::{Duration as WallDuration, Instant as WallInstant};

use protocol_core::controller::BitRate;
use protocol_core::time::{Instant, after};

use super::clients::Clients;
use super::errors::Errors;
use super::outside::Outside;
use super::pace::Pace;
use super::trace::Trace;
use crate::gateway::{Arrival, ToWorld};
use crate::trace::Timestamp;
use crate::world::{Event, SUPPLY_JITTER, World};

/// How many events may happen before the clock is looked at: some milliseconds of work.
const GO: usize = 1000;

/// A process that did not look at the clock for so long stood still. A master may be late by as much as its valves allow:
/// at most 250 ms between set-points of which it takes 200.
const STALL: WallDuration = WallDuration::from_millis(50);

/// How long the thread sleeps at most, to notice that it stood still: what is left of [`STALL`] is room for a system that
/// wakes it up late.
const NAP: WallDuration = WallDuration::from_millis(20);

/// How long the world may be behind before its speed is out of reach.
const BEHIND: WallDuration = WallDuration::from_secs(1);

/// What is longer than this is time enough to hand the trace out.
const LULL: WallDuration = WallDuration::from_millis(1);

/// How often the user is told of lost time.
const REMINDER: WallDuration = WallDuration::from_secs(60);

/// A world with everything that is connected to it.
pub(super) struct Driver<O> {
    world: World,
    clients: Clients,
    outside: O,
    pace: Pace,
    /// The wall time of virtual instant 0, as traces and clients are told.
    start: Timestamp,
    errors: Errors,
    trace: Trace,
    /// What has arrived and has not taken effect, oldest first.
    arrivals: VecDeque<Arrival>,
    /// The events that are being shown, to be used again.
    events: Vec<Event>,
    /// From when on clients may send: all devices have started then.
    open: Instant,
    /// When the clock was last looked at.
    looked: WallInstant,
    /// When the trace was last handed out.
    handed_out: WallInstant,
    /// Since when the world is behind the pace.
    behind: Option<WallInstant>,
    /// Whether the user knows that the speed is out of reach.
    out_of_reach: bool,
    lost: Lost,
}

/// Time that was lost by a process that stood still, and is not told yet.
#[derive(Debug, Default)]
struct Lost {
    stalls: u32,
    time: WallDuration,
    told: Option<WallInstant>,
}

impl<O: Outside> Driver<O> {
    /// A world whose devices are not powered yet, at a speed that is finite and above 0.
    /// Its instant 0 is told as `start`.
    pub(super) fn new(
        mut world: World,
        clients: Clients,
        mut outside: O,
        speed: f64,
        start: Timestamp,
        trace: Trace,
    ) -> Self {
        world.record_events(true);
        let looked = outside.now();
        Self {
            world,
            clients,
            pace: Pace::start(speed, looked),
            outside,
            start,
            errors: Errors::default(),
            trace,
            arrivals: VecDeque::new(),
            events: Vec::new(),
            open: Instant::MAX,
            looked,
            handed_out: looked,
            behind: None,
            out_of_reach: false,
            lost: Lost::default(),
        }
    }

    /// Powers the devices and runs until it is told to end; then lets them store what they have to.
    ///
    /// Without a bit rate the bus gets that of the first device.
    pub(super) fn run(mut self, bit_rate: Option<BitRate>) {
        self.power_on(bit_rate);
        while !self.outside.is_ending() {
            self.turn();
        }
        self.world.flush_all();
        self.show();
        self.warn_of_memories();
        self.trace.finish();
    }

    fn power_on(&mut self, bit_rate: Option<BitRate>) {
        if bit_rate.is_none()
            && let Some(first) = self.world.devices().next()
        {
            self.world.power(first, true);
            if let Some(device) = self.world.device(first) {
                let rate = device.bit_rate();
                self.world.set_bit_rate(rate);
            }
        }
        self.world.power_all(SUPPLY_JITTER);
        self.open = after(self.world.now(), SUPPLY_JITTER);
        self.trace.learn(&self.world);
    }

    /// Lets happen what is due, up to the next message; then that one takes effect, or the thread waits for another.
    fn turn(&mut self) {
        let now = self.look_at_clock();
        if self.arrivals.is_empty() {
            self.arrivals.extend(self.outside.take());
        }
        let due = self.arrivals.front().map_or(Instant::MAX, |next| self.due(next));
        if !self.catch_up(self.pace.at(now).min(due)) {
            self.fall_behind(now);
            self.hand_out();
            return;
        }
        self.behind = None;
        if self.world.now() >= due {
            self.take_effect();
        } else {
            self.wait(due);
        }
    }

    /// When a message takes effect.
    fn due(&self, arrival: &Arrival) -> Instant {
        let arrived = self.pace.at(arrival.at);
        match arrival.message {
            ToWorld::Send(..) => arrived.max(self.open),
            _ => arrived,
        }
    }

    /// Waits for a message, or until something is due; readers of traces get what they wait for before that, unless
    /// a client would have to wait instead.
    fn wait(&mut self, due: Instant) {
        let now = self.looked;
        let next = self.pace.when(self.world.next_event().min(due));
        if next.is_none_or(|next| next > now + LULL) || now.saturating_duration_since(self.handed_out) >= NAP {
            self.hand_out();
            self.handed_out = now;
        }
        let nap = (self.pace.speed() <= 1.0).then(|| now + NAP);
        let arrival = match (next, nap) {
            (Some(next), nap) if nap.is_none_or(|nap| next <= nap) && self.clients.is_heard() => {
                self.outside.wait_punctually(next)
            }
            (next, nap) => self.outside.wait(nap.into_iter().chain(next).min()),
        };
        self.arrivals.extend(arrival);
    }

    /// The wall time now. At a speed up to 1 the world's time does not go on for a process that stood still.
    fn look_at_clock(&mut self) -> WallInstant {
        let now = self.outside.now();
        let passed = now.saturating_duration_since(std::mem::replace(&mut self.looked, now));
        if passed > STALL && self.pace.speed() <= 1.0 {
            self.pace.anchor(now, self.world.now());
            self.lost.stalls += 1;
            self.lost.time += passed;
            if self.lost.told.is_none_or(|told| now.saturating_duration_since(told) >= REMINDER) {
                let Lost { stalls, time, .. } =
                    std::mem::replace(&mut self.lost, Lost { told: Some(now), ..Lost::default() });
                let times = if stalls == 1 { String::new() } else { format!(" ({stalls} times)") };
                self.trace.warn(format!(
                    "stood still for {:.3} s{times}: that time did not happen on the bus",
                    time.as_secs_f64()
                ));
            }
        }
        now
    }

    /// Lets happen what is due until `end`, and goes there, unless there is too much to do in one go; whether it got there.
    fn catch_up(&mut self, end: Instant) -> bool {
        for _ in 0..GO {
            if self.world.next_event() > end {
                self.world.run_until(end);
                return true;
            }
            self.world.step();
            self.show();
            self.clients.send(&mut self.world);
        }
        false
    }

    /// The world has not caught up. When that lasts, its time goes on from where it is, as fast as it can.
    fn fall_behind(&mut self, now: WallInstant) {
        let since = *self.behind.get_or_insert(now);
        if self.out_of_reach || now.saturating_duration_since(since) >= BEHIND {
            self.pace.anchor(now, self.world.now());
            if !std::mem::replace(&mut self.out_of_reach, true) {
                let speed = self.pace.speed();
                self.trace.warn(format!("--speed {speed} is out of reach: time runs as fast as this machine can"));
            }
        }
    }

    fn take_effect(&mut self) {
        let Some(Arrival { message, .. }) = self.arrivals.pop_front() else { return };
        if self.clients.apply(message, &mut self.world).is_err() {
            self.report_overrun();
        }
    }

    /// Shows what was on the bus to the clients, on stdout and in the log.
    fn show(&mut self) {
        let mut events = std::mem::take(&mut self.events);
        events.extend(self.world.take_events());
        for event in events.drain(..) {
            let at = self.start.at(event.at);
            let told = self.errors.note(&event, at);
            // Clients first: they may answer.
            for _ in 0..self.clients.show(&event, at, told.as_ref().map(|(class, _)| *class)) {
                self.report_overrun();
            }
            self.trace.tell(&event, at, told, &self.world);
            self.clients.give_up(&event, &mut self.world);
        }
        self.events = events;
    }

    /// Before the thread sleeps: what readers wait for.
    fn hand_out(&mut self) {
        self.trace.hand_out();
        self.warn_of_memories();
        let dropped = self.clients.take_dropped();
        if dropped > 0 {
            self.trace
                .warn(format!("clients left more frames behind than the bus takes: {dropped} of them were dropped"));
        }
    }

    fn warn_of_memories(&mut self) {
        for node in self.world.devices() {
            for warning in self.world.memory_mut(node).take_warnings() {
                self.trace.warn(warning);
            }
        }
    }

    fn report_overrun(&self) {
        self.trace.warn("a client that did not read was disconnected".to_owned());
    }
}

#[cfg(test)]
#[path = "driver_tests.rs"]
mod tests;
