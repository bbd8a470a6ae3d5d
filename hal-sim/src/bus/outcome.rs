//! The end of a frame or an error frame: deliveries, error counters, bus-off and the way back.

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Instant;

use super::bits::{BUS_IDLE, INTERMISSION, SUSPEND};
use super::clock::{Nanos, bit_times, instant, nanos};
use super::external::WireEvent;
use super::port::Port;
use super::transmission::Transmission;
use super::{Bus, BusError, Ended, PortId};

impl Bus {
    /// Ends what is due to end by `now`; says what was on the wire.
    pub fn finish(&mut self, now: Instant) -> Option<Ended> {
        let ended = match self.current.take() {
            Some(transmission) if transmission.end <= nanos(now) => Some(self.end(transmission)),
            running => {
                self.current = running;
                None
            }
        };
        self.recover(nanos(now));
        self.tell_joined(nanos(now));
        ended
    }

    fn end(&mut self, mut transmission: Transmission) -> Ended {
        // Whoever acknowledged it may have been switched off while the frame was on the wire.
        if transmission.error.is_none() && !self.is_heard(&transmission) {
            transmission.error = Some(BusError::Acknowledgement);
        }
        self.free_at = transmission.end + bit_times(INTERMISSION, transmission.rate);
        self.load.add(self.free_at - transmission.start, transmission.end);
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
        let Transmission { from, frame, error, mut senders, .. } = transmission;
        senders.clear();
        self.spare = senders;
        Ended { from, frame, error }
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
                if self.ports[number].deliver(&transmission.frame, at) {
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
            let port = &mut self.ports[number];
            if transmission.senders.contains(&id) {
                self.touched.push(id);
                continue;
            }
            // A missing acknowledgement is seen by nobody else: there is nobody else.
            let listens = port.takes_part() && port.joined_at <= transmission.start;
            if !listens || error == BusError::Acknowledgement {
                continue;
            }
            let before = port.mode();
            let first = transmission.by_other_rate && port.rate != transmission.rate;
            let first = first && before == BusErrorMode::ErrorActive;
            port.confinement.receive_error(first);
            port.tell(transmission.end, WireEvent::NotReceived { first });
            if port.mode() != before {
                self.touched.push(id);
            }
        }
    }

    fn after_sending(&mut self, id: PortId, transmission: &Transmission) {
        let port = &mut self.ports[id.0];
        port.transmit.sent(transmission.error.is_none());
        match transmission.error {
            None => port.confinement.sent(),
            Some(BusError::Acknowledgement) => port.confinement.no_acknowledgement(),
            Some(_) => port.confinement.transmit_error(),
        }
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
            let port = &mut self.ports[id.0];
            match port.recovered_at() {
                Some(due) if due <= now => {
                    port.recovery = None;
                    port.confinement.recover();
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
