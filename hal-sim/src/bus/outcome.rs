//! The end of a frame or an error frame: deliveries, error counters, bus-off and the way back.

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Instant;

use super::bits::{BUS_IDLE, INTERMISSION, SUSPEND};
use super::clock::{Nanos, bit_times, instant, nanos};
use super::external::WireEvent;
use super::port::Port;
use super::transmission::Transmission;
use super::{Bus, BusError, Confinement, Event, EventKind, PortId};

impl Bus {
    /// Ends what is due to end by `now`.
    pub fn finish(&mut self, now: Instant) {
        match self.current.take() {
            Some(transmission) if transmission.end <= nanos(now) => self.end(transmission),
            running => self.current = running,
        }
        self.recover(nanos(now));
        self.tell_joined(nanos(now));
    }

    fn end(&mut self, mut transmission: Transmission) {
        // Whoever acknowledged it may have been switched off while the frame was on the wire.
        if transmission.error.is_none() && !self.is_heard(&transmission) {
            transmission.error = Some(BusError::Acknowledgement);
        }
        self.free_at = transmission.end + bit_times(INTERMISSION, transmission.rate);
        self.load.add(self.free_at - transmission.start, transmission.end);
        self.note(&transmission);
        match transmission.error {
            None => self.deliver(&transmission),
            Some(error) => self.count_errors(&transmission, error),
        }
        self.count_idle_sequence();
        for id in &transmission.senders {
            self.after_sending(*id, &transmission);
            self.refresh(*id, instant(transmission.end));
        }
        self.tell_all(transmission.end, |_| WireEvent::Ends);
        transmission.senders.clear();
        self.spare = transmission.senders;
    }

    /// Notes what was on the wire.
    fn note(&mut self, transmission: &Transmission) {
        let Transmission { frame, error, from, .. } = transmission;
        let (frame, start, at) = (*frame, instant(transmission.start), instant(transmission.end));
        self.journal.note(|| {
            let what = match error {
                None => EventKind::Frame { frame, start },
                Some(error) => EventKind::ErrorFrame {
                    frame,
                    start,
                    error: *error,
                    signalled_by: transmission.signalled_by.clone(),
                },
            };
            Event { at, who: from.clone(), what }
        });
    }

    fn is_heard(&self, transmission: &Transmission) -> bool {
        let hears = |(number, port): (usize, &Port)| !port.is_silent() && self.hears(transmission, PortId(number));
        self.ports.iter().enumerate().any(hears)
    }

    #[inline]
    fn hears(&self, transmission: &Transmission, id: PortId) -> bool {
        let port = &self.ports[id.0];
        port.takes_part()
            && port.joined_at <= transmission.start
            && port.rate == transmission.rate
            && !transmission.senders.contains(&id)
    }

    fn deliver(&mut self, transmission: &Transmission) {
        let at = instant(transmission.end);
        for number in 0..self.ports.len() {
            let id = PortId(number);
            if self.hears(transmission, id) {
                let changed = self.change(id, at, Confinement::received);
                if self.ports[number].deliver(&transmission.frame, at) || changed {
                    self.touched.push(id);
                }
            } else if transmission.senders.contains(&id) {
                self.touched.push(id);
            }
        }
    }

    fn count_errors(&mut self, transmission: &Transmission, error: BusError) {
        for number in 0..self.ports.len() {
            let id = PortId(number);
            if transmission.senders.contains(&id) {
                self.touched.push(id);
                continue;
            }
            // A missing acknowledgement is seen by nobody else: there is nobody else.
            let port = &mut self.ports[number];
            let listens = port.takes_part() && port.joined_at <= transmission.start;
            if !listens || error == BusError::Acknowledgement {
                continue;
            }
            let first = transmission.by_other_rate && port.rate != transmission.rate;
            let first = first && port.mode() == BusErrorMode::ErrorActive;
            port.tell(transmission.end, WireEvent::NotReceived { first });
            if self.change(id, instant(transmission.end), |confinement| confinement.receive_error(first)) {
                self.touched.push(id);
            }
        }
    }

    fn after_sending(&mut self, id: PortId, transmission: &Transmission) {
        self.ports[id.0].transmit.sent(transmission.error.is_none());
        self.change(id, instant(transmission.end), |confinement| match transmission.error {
            None => confinement.sent(),
            Some(BusError::Acknowledgement) => confinement.no_acknowledgement(),
            Some(_) => confinement.transmit_error(),
        });
        let port = &mut self.ports[id.0];
        port.tell(transmission.end, transmission.error.map_or(WireEvent::Sent, WireEvent::NotSent));
        if port.mode() == BusErrorMode::ErrorPassive {
            port.ready_at = self.free_at + bit_times(SUSPEND, port.rate);
        }
        // Whether a controller that lives elsewhere comes back is its own decision.
        if port.mode() == BusErrorMode::BusOff && port.external.is_none() {
            self.begin_recovery(id, transmission.end);
        }
    }

    /// The end of a frame, or of an error frame, and the intermission are 11 recessive bits: one sequence for those on
    /// their way back from bus-off, and what controllers that joined in the meantime waited for.
    fn count_idle_sequence(&mut self) {
        if std::mem::take(&mut self.joining) {
            for port in self.ports.iter_mut().filter(|port| port.joined_at == Nanos::MAX) {
                port.joined_at = self.free_at;
                port.ready_at = self.free_at;
            }
        }
        for id in &self.recovering {
            if let Some(recovery) = &mut self.ports[id.0].recovery {
                recovery.left = recovery.left.saturating_sub(1);
                recovery.since = recovery.since.max(self.free_at);
            }
        }
    }

    /// Counts the recessive bits of the idle time that ends at `start`.
    pub(super) fn pass_recovery_time(&mut self, start: Nanos) {
        for id in &self.recovering {
            let port = &mut self.ports[id.0];
            let sequence = bit_times(BUS_IDLE, port.rate);
            if let Some(recovery) = &mut port.recovery {
                let seen = start.saturating_sub(recovery.since) / sequence;
                recovery.left = recovery.left.saturating_sub(u32::try_from(seen).unwrap_or(u32::MAX));
                recovery.since = start;
            }
        }
    }

    fn recover(&mut self, now: Nanos) {
        if self.current.is_some() || self.recovering.is_empty() {
            return;
        }
        let recovering = std::mem::take(&mut self.recovering);
        for id in recovering {
            match self.ports[id.0].recovered_at() {
                Some(due) if due <= now => {
                    self.change(id, instant(due), Confinement::recover);
                    let port = &mut self.ports[id.0];
                    port.recovery = None;
                    port.joined_at = due;
                    port.ready_at = due;
                    port.tell(due, WireEvent::Recovered);
                    self.touched.push(id);
                }
                _ => self.recovering.push(id),
            }
        }
    }
}
