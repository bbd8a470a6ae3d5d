//! A bus without devices for tests, with ports `a`, `b`, `c` … and a record of all frames.

use std::sync::Arc;

use embedded_can::nb::Can;
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::{Frame, standard};
use protocol_core::time::{Duration, Instant, NEVER};

use super::clock::bit_times;
use super::{Bus, BusError, Event, EventKind, FaultEffect, PortId};

pub(super) const RATE: BitRate = BitRate::Kbit250;
pub(super) const EMPTY: u16 = 0x123;

pub(super) fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

pub(super) fn micros(us: u64) -> Instant {
    Instant::from_micros(us)
}

pub(super) fn bits(count: u32) -> Duration {
    Duration::from_nanos(bit_times(count, RATE))
}

/// A frame or error frame that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Ended {
    /// The sender; the first sender if several sent the same frame.
    pub(super) from: Arc<str>,
    pub(super) frame: Frame,
    /// The error of an error frame.
    pub(super) error: Option<BusError>,
}

/// A bus with connected device ports `a`, `b`, `c` …; the time is 10 ms, after bus integration.
pub(super) struct Rig {
    pub(super) bus: Bus,
    pub(super) now: Instant,
    pub(super) ended: Vec<(Instant, Ended)>,
    /// The recorded effects of faults.
    pub(super) effects: Vec<FaultEffect>,
}

impl Rig {
    pub(super) fn of(count: u8) -> Self {
        Self::at(RATE, count)
    }

    pub(super) fn at(rate: BitRate, count: u8) -> Self {
        let mut bus = Bus::default();
        bus.journal.record(true);
        for name in (b'a'..).take(usize::from(count)) {
            let id = bus.add_device(char::from(name).to_string().into(), rate);
            bus.connect(id, micros(0));
        }
        Self { bus, now: micros(10_000), ended: Vec::new(), effects: Vec::new() }
    }

    pub(super) fn send(&mut self, port: usize, frame: Frame) {
        assert_eq!(self.bus.hand_over(PortId(port), &frame, self.now), Ok(None));
        self.bus.refresh(PortId(port), self.now);
    }

    pub(super) fn run(&mut self, until: Instant) {
        self.bus.begin(self.now);
        while self.bus.next_event() <= until {
            self.now = self.now.max(self.bus.next_event());
            self.bus.finish(self.now);
            if self.bus.is_fault_due(self.now) {
                self.bus.serve_faults(self.now, &[]);
            }
            for Event { at, who: from, what } in self.bus.journal.take() {
                let (frame, error) = match what {
                    EventKind::Frame { frame, .. } => (frame, None),
                    EventKind::ErrorFrame { frame, error, .. } => (frame, Some(error)),
                    EventKind::Fault { effect, .. } => {
                        self.effects.push(effect);
                        continue;
                    }
                    _ => continue,
                };
                self.ended.push((at, Ended { from, frame, error }));
            }
            self.bus.begin(self.now);
        }
        self.now = until;
    }

    pub(super) fn run_for(&mut self, time: Duration) {
        self.run(self.now + time);
    }

    /// Runs until a frame or error frame ends.
    pub(super) fn next(&mut self) -> (Instant, Ended) {
        let known = self.ended.len();
        self.bus.begin(self.now);
        while self.ended.len() == known {
            let next = self.bus.next_event();
            assert_ne!(next, NEVER, "no further event is due");
            self.run(next);
        }
        self.ended.last().unwrap().clone()
    }

    pub(super) fn receive(&mut self, port: usize) -> Option<Frame> {
        self.bus.port_mut(PortId(port)).receive().ok()
    }

    pub(super) fn counters(&self, port: usize) -> (u16, u16) {
        let confinement = self.bus.port(PortId(port)).confinement();
        (confinement.transmit_errors(), confinement.receive_errors())
    }

    pub(super) fn mode(&self, port: usize) -> BusErrorMode {
        self.bus.port(PortId(port)).mode()
    }

    pub(super) fn frames(&self) -> Vec<Frame> {
        self.ended.iter().filter(|(_, ended)| ended.error.is_none()).map(|(_, ended)| ended.frame).collect()
    }
}
