//! The thread of the world: lets time pass, takes what clients want, and shows what was on the bus.

use std::sync::mpsc::{Receiver, RecvTimeoutError};

use protocol_core::controller::BitRate;
use protocol_core::device::Device;
use protocol_core::time::{Duration, Instant, after};

use super::clients::{Clients, class};
use super::log::Log;
use super::pace::Pace;
use super::printer::Printer;
use crate::explain::Explainer;
use crate::gateway::ToWorld;
use crate::trace::{Timestamp, write_error, write_frame};
use crate::world::{Event, EventKind, SUPPLY_JITTER, World};

/// How much virtual time passes at the most before clients are looked at again, when the world cannot keep up with the
/// pace.
const SLICE: Duration = Duration::from_millis(100);

/// A world with everything that is connected to it.
pub struct Driver {
    world: World,
    /// The events that are being shown, to be used again.
    events: Vec<Event>,
    clients: Clients,
    pace: Pace,
    /// The wall time of virtual instant 0.
    start: Timestamp,
    explainer: Explainer,
    /// The name of the bus in traces.
    bus: String,
    printer: Printer,
    log: Option<Log>,
    /// The line that is being written, to be used again.
    line: String,
}

impl Driver {
    /// A world whose devices are those that the explainer knows, in the same order.
    pub(super) fn new(
        mut world: World,
        explainer: Explainer,
        bus: &str,
        pace: Pace,
        start: Timestamp,
        printer: Printer,
        log: Option<Log>,
    ) -> Self {
        world.record_events(true);
        let clients = Clients::new(&mut world);
        let (bus, events, line) = (bus.to_owned(), Vec::new(), String::new());
        Self { world, events, clients, pace, start, explainer, bus, printer, log, line }
    }

    /// Powers the devices and runs until it is told to stop; then lets them store what they have to.
    ///
    /// Without a bit rate the bus gets that of the first device.
    pub(super) fn run(mut self, bit_rate: Option<BitRate>, inbox: &Receiver<ToWorld>) {
        self.power_on(bit_rate);
        self.start_up();
        loop {
            let behind = self.catch_up();
            match self.next_message(inbox, behind) {
                Ok(ToWorld::Stop) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(message) => {
                    self.catch_up();
                    self.apply(message);
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        self.world.flush_all();
        self.show();
        self.hand_out();
        self.printer.finish();
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
    }

    /// Lets all devices start before anything of a client reaches the bus: whoever has read the ready line may send.
    fn start_up(&mut self) {
        let end = after(self.world.now(), SUPPLY_JITTER);
        loop {
            let behind = self.catch_up();
            if self.world.now() >= end {
                return;
            }
            if !behind && let Some(wait) = self.pace.until(self.world.next_event().min(end)) {
                self.hand_out();
                std::thread::sleep(wait);
            }
        }
    }

    /// Lets happen what is due by now, but no more than a slice; whether more is due.
    fn catch_up(&mut self) -> bool {
        let now = self.pace.now();
        let end = now.min(after(self.world.now(), SLICE));
        self.run_until(end);
        end < now
    }

    fn run_until(&mut self, end: Instant) {
        while self.world.next_event() <= end {
            self.world.step();
            self.show();
            self.clients.send(&mut self.world);
        }
        self.world.run_until(end);
    }

    /// Waits for a message, or until something is due.
    fn next_message(&mut self, inbox: &Receiver<ToWorld>, behind: bool) -> Result<ToWorld, RecvTimeoutError> {
        if let Ok(message) = inbox.try_recv() {
            return Ok(message);
        }
        if behind {
            return Err(RecvTimeoutError::Timeout);
        }
        self.hand_out();
        match self.pace.until(self.world.next_event()) {
            Some(wait) => inbox.recv_timeout(wait),
            None => inbox.recv().map_err(|_| RecvTimeoutError::Disconnected),
        }
    }

    fn apply(&mut self, message: ToWorld) {
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
            for _ in 0..self.clients.show(&event, at) {
                self.report_overrun();
            }
            self.line.clear();
            match &event.what {
                EventKind::Frame { frame, .. } => write_frame(&mut self.line, at, &self.bus, frame),
                EventKind::ErrorFrame { error, .. } => write_error(&mut self.line, at, &self.bus, class(*error)),
                EventKind::ErrorMode { .. } | EventKind::FramesDropped { .. } => continue,
            }
            self.log(|log, line| log.write(line));
            self.line.push_str("  ");
            self.explain(&event);
            self.line.push('\n');
            self.printer.trace(self.line.clone());
        }
        self.events = events;
    }

    /// By the node IDs before the event: it may be what changes them.
    fn explain(&mut self, event: &Event) {
        self.line.push_str(&match &event.what {
            EventKind::Frame { frame, .. } => self.explainer.explain(frame, Some(&event.who)),
            EventKind::ErrorFrame { frame, error, .. } => self.explainer.explain_error(*error, frame, &event.who),
            EventKind::ErrorMode { .. } | EventKind::FramesDropped { .. } => return,
        });
        for (node, device) in self.explainer.nodes_mut().iter_mut().zip(self.world.devices()) {
            node.node_id = self.world.device(device).and_then(Device::node_id);
        }
    }

    /// Before the thread sleeps: what readers wait for.
    fn hand_out(&mut self) {
        self.log(|log, _| log.flush());
        for node in self.world.devices() {
            for warning in self.world.memory_mut(node).take_warnings() {
                self.printer.warn(warning);
            }
        }
    }

    fn log(&mut self, act: impl FnOnce(&mut Log, &str) -> Result<(), String>) {
        if let Some(log) = &mut self.log
            && let Err(complaint) = act(log, &self.line)
        {
            self.printer.warn(complaint);
            self.log = None;
        }
    }

    fn report_overrun(&self) {
        self.printer.warn("a client that did not read was disconnected".to_owned());
    }
}
