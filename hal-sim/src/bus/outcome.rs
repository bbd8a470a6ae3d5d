//! The end of a frame or an error frame: deliveries and error counters.

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Instant;

use super::bits::{INTERMISSION, SUSPEND};
use super::clock::{bit_times, instant, nanos};
use super::confinement::Confinement;
use super::transmission::Transmission;
use super::wire_event::WireEvent;
use super::{Bus, BusError, Event, EventKind, PortId};

impl Bus {
    /// Ends what is due to end by `now`.
    pub fn finish(&mut self, now: Instant) {
        if let Some(transmission) = self.current.take_if(|transmission| transmission.end <= nanos(now)) {
            self.end(transmission);
        }
        if !self.recovering.is_empty() {
            self.recover(nanos(now));
        }
        if !self.externals.is_empty() {
            self.tell_joined(nanos(now));
        }
    }

    fn end(&mut self, mut transmission: Transmission) {
        // Whoever acknowledged it may have been switched off while the frame was on the wire.
        if transmission.error.is_none() && !self.is_heard(transmission.rate, &transmission.senders) {
            transmission.error = Some(BusError::Acknowledgement);
            transmission.signalled_by = transmission.senders.first().map(|id| self.ports[id.0].name.clone());
        }
        self.free_at = transmission.end + bit_times(INTERMISSION, transmission.rate);
        self.load.add(self.free_at - transmission.start, transmission.end);
        self.note(&transmission);
        match transmission.error {
            None => self.deliver(&transmission),
            // A missing acknowledgement is seen by nobody else: there is nobody else.
            Some(BusError::Acknowledgement) => {}
            Some(_) => self.count_errors(&transmission),
        }
        self.count_idle_sequence();
        for id in &transmission.senders {
            self.after_sending(*id, &transmission);
        }
        self.tell_end(transmission.end);
        transmission.senders.clear();
        self.spare = transmission.senders;
    }

    /// Notes what was on the wire.
    fn note(&mut self, transmission: &Transmission) {
        let Transmission { frame, start, end, error, senders, gone, signalled_by, .. } = transmission;
        let (frame, start) = (*frame, instant(*start));
        let ports = &self.ports;
        let what = || match (error, signalled_by) {
            (None, _) => Some(EventKind::Frame { frame, start }),
            (Some(error), Some(by)) => {
                Some(EventKind::ErrorFrame { frame, start, error: *error, signalled_by: by.clone() })
            }
            // A sender fell silent, and nobody listened.
            (Some(_), None) => None,
        };
        let from = || senders.first().map_or_else(|| gone.clone(), |id| Some(ports[id.0].name.clone()));
        self.journal.note(|| Some(Event { at: instant(*end), who: from()?, what: what()? }));
    }

    fn deliver(&mut self, transmission: &Transmission) {
        let at = instant(transmission.end);
        let Some(place) = self.groups.iter().position(|group| group.rate == transmission.rate) else { return };
        if !self.groups[place].counting.is_empty() {
            self.count_received(place, transmission, at);
        }
        let mut hearers = std::mem::take(&mut self.hearers);
        self.groups[place].hearers(&transmission.frame, &mut hearers);
        for id in hearers.drain(..) {
            if !transmission.senders.contains(&id) {
                let port = &mut self.ports[id.0];
                port.deliver(&transmission.frame, at);
                if port.is_device {
                    self.touched.push(id);
                }
            }
        }
        self.hearers = hearers;
    }

    /// Counts a received frame for those whom it matters to: a counter that is 0 stays so.
    fn count_received(&mut self, place: usize, transmission: &Transmission, at: Instant) {
        let mut counting = std::mem::take(&mut self.groups[place].counting);
        counting.retain(|id| {
            if !transmission.senders.contains(id) {
                self.change(*id, at, Confinement::received);
            }
            self.ports[id.0].confinement.receive_errors() > 0
        });
        self.groups[place].counting = counting;
    }

    /// Counts an error for everybody who saw it.
    fn count_errors(&mut self, transmission: &Transmission) {
        let at = instant(transmission.end);
        for group in 0..self.groups.len() {
            let other_rate = transmission.by_other_rate && self.groups[group].rate != transmission.rate;
            // Receive errors take nobody off the bus: the members stay what they are.
            for place in 0..self.groups[group].members.len() {
                let id = self.groups[group].members[place];
                if transmission.senders.contains(&id) {
                    continue;
                }
                let port = &mut self.ports[id.0];
                if port.confinement.receive_errors() == 0 {
                    self.groups[group].counting.push(id);
                }
                let first = other_rate && port.mode() == BusErrorMode::ErrorActive;
                port.tell(transmission.end, WireEvent::NotReceived { first });
                self.change(id, at, |confinement| confinement.receive_error(first));
            }
        }
    }

    fn after_sending(&mut self, id: PortId, transmission: &Transmission) {
        let at = instant(transmission.end);
        let port = &mut self.ports[id.0];
        port.transmit.sent(transmission.error.is_none());
        port.tell(transmission.end, transmission.error.map_or(WireEvent::Sent, WireEvent::NotSent));
        self.change(id, at, |confinement| match transmission.error {
            None => confinement.sent(),
            Some(BusError::Acknowledgement) => confinement.no_acknowledgement(),
            Some(_) => confinement.transmit_error(),
        });
        let port = &mut self.ports[id.0];
        if port.mode() == BusErrorMode::ErrorPassive {
            port.ready_at = self.free_at + bit_times(SUSPEND, port.rate);
        }
        if port.is_device {
            self.touched.push(id);
        }
        self.refresh(id, at);
    }
}
