//! The end of a frame or error frame: delivery and error counters.

use protocol_core::controller::BusErrorMode;
use protocol_core::time::Instant;

use std::sync::Arc;

use super::bits::{ERROR_DELIMITER, ERROR_FLAG, INTERMISSION, SUSPEND};
use super::clock::{Nanos, bit_times, instant, nanos};
use super::confinement::Confinement;
use super::event::WireEvent;
use super::transmission::{Failure, Omission, Transmission, members};
use super::{Bus, BusError, Event, EventKind, FaultEffect, PortId};

impl Bus {
    /// Ends the frame or error frame that is due by `now`, completes due bus-off recoveries, and reports completed bus
    /// integrations.
    pub(crate) fn finish(&mut self, now: Instant) {
        if let Some(transmission) = &self.current
            && transmission.over <= now
            && (transmission.omission.is_none() || !self.accept())
        {
            self.end();
        }
        if !self.recovering.is_empty() {
            self.recover(nanos(now));
        }
        if !self.externals.is_empty() {
            self.tell_joined(nanos(now));
        }
    }

    /// Handles the last but one bit of a frame with an omission: delivers the frame to the unaffected receivers and
    /// starts the error frame with the last bit. If no affected receiver is error-active any more, the frame continues
    /// to its last bit instead. Returns whether the transmission continues.
    #[cold]
    fn accept(&mut self) -> bool {
        let is_pending = |transmission: &mut Transmission| {
            let omission = transmission.omission.as_deref();
            transmission.error().is_none() && omission.is_some_and(|omission| omission.signalled_by.is_some())
        };
        let Some(mut transmission) = self.current.take_if(is_pending) else { return false };
        let signals = |id: &PortId| self.ports[id.0].member && self.ports[id.0].signals_errors();
        let by = transmission.omission.as_mut().and_then(|omission| {
            omission.signalled_by = omission.receivers.iter().copied().find(signals);
            omission.signalled_by
        });
        let bits = match by {
            None => 1,
            Some(by) => {
                self.deliver(&transmission);
                let failure = Failure::new(BusError::Bit, Some(self.ports[by.0].name.clone()));
                let gone = transmission.gone().cloned();
                transmission.failure = Some(Box::new(Failure { gone, ..*failure }));
                // The sender responds with an error flag one bit later, the unaffected receivers with an overload flag.
                1 + ERROR_FLAG + ERROR_DELIMITER
            }
        };
        transmission.set_end(transmission.end + bit_times(bits, transmission.rate));
        self.current = Some(transmission);
        true
    }

    /// Ends the frame or error frame on the wire.
    fn end(&mut self) {
        let Some(mut transmission) = self.current.take() else { return };
        // The only acknowledging controller may have disconnected while the frame was on the wire.
        if transmission.failure.is_none() && !self.is_heard(transmission.rate) {
            let signalled_by = self.senders.first().map(|id| self.ports[id.0].name.clone());
            transmission.failure = Some(Failure::new(BusError::Acknowledgement, signalled_by));
        }
        self.free_at = transmission.end + bit_times(INTERMISSION, transmission.rate);
        self.load.add(self.free_at - transmission.start, transmission.end);
        self.note(&transmission);
        let error = transmission.error();
        match error {
            None => self.deliver(&transmission),
            // A sender without acknowledgement is alone, so no other controller counts the error.
            Some(BusError::Acknowledgement) => {}
            Some(_) => self.count_errors(&transmission),
        }
        self.count_idle_sequence();
        for place in 0..self.senders.len() {
            self.after_sending(self.senders[place], error, transmission.end, transmission.over);
        }
        self.senders.clear();
        self.tell_end(transmission.end);
    }

    /// Records the end of the frame or error frame as an event.
    fn note(&mut self, transmission: &Transmission) {
        let (ports, sender) = (&self.ports, self.senders.first());
        self.journal.note(|| {
            let Transmission { frame, start, over, failure, .. } = transmission;
            let (frame, start, at) = (*frame, instant(*start), *over);
            let who = sender.map(|id| &ports[id.0].name).or_else(|| transmission.gone())?.clone();
            let Some(error) = transmission.error() else {
                return Some(Event { at, who, what: EventKind::Frame { frame, start } });
            };
            // No error flag: the sender fell silent and no other controller listened.
            let signalled_by = failure.as_ref()?.signalled_by.clone()?;
            Some(Event { at, who, what: EventKind::ErrorFrame { frame, start, error, signalled_by } })
        });
    }

    fn deliver(&mut self, transmission: &Transmission) {
        let Transmission { frame, rate, end, over: at, omission, .. } = transmission;
        let Some(place) = self.groups.iter().position(|group| group.rate == *rate) else { return };
        if !self.groups[place].counting.is_empty() {
            self.count_received(place, *at, omission.as_deref());
        }
        let is_lost = self.faults.at_receivers && self.lose(transmission);
        let Self { ports, senders, .. } = self;
        for id in senders {
            ports[id.0].heard = *end;
        }
        if let Some(omission) = omission {
            omission.receivers.iter().for_each(|id| ports[id.0].heard = *end);
            if omission.signalled_by.is_none() {
                self.count_omitted(place, &omission.receivers, *at);
            }
        }
        let Self { groups, ports, touched, .. } = self;
        if is_lost {
            return;
        }
        groups[place].hearers(frame, |hearers| {
            for id in hearers {
                let port = &mut ports[id.0];
                // The port may be listed for several filters.
                if std::mem::replace(&mut port.heard, *end) == *end {
                    continue;
                }
                port.deliver(frame, *at);
                if port.is_device() {
                    touched.push(*id);
                }
            }
        });
    }

    /// Counts an omission without an error flag: increments the receive error counter of each affected receiver.
    #[cold]
    fn count_omitted(&mut self, place: usize, receivers: &[PortId], at: Instant) {
        for id in receivers.iter().filter(|id| self.groups[place].members.contains(id)).copied().collect::<Vec<_>>() {
            if self.ports[id.0].confinement.receive_errors() == 0 {
                self.groups[place].counting.push(id);
            }
            self.change(id, at, |confinement| confinement.receive_error(false));
        }
    }

    /// Applies the faults between the receiving controllers and their applications. Returns whether the frame is lost
    /// for all receivers. The fault events precede the event of the frame.
    #[cold]
    fn lose(&mut self, transmission: &Transmission) -> bool {
        let Self { faults, ports, groups, senders, .. } = self;
        let sender = senders.first().map(|id| &ports[id.0].name).or_else(|| transmission.gone());
        let Some(name) = sender else { return false };
        let has_receiver = |names: &[Arc<str>]| {
            let hears = |id: &PortId| {
                let port = &ports[id.0];
                !senders.contains(id) && names.contains(&port.name) && port.accepts(&transmission.frame)
            };
            members(groups, transmission.rate).any(hears)
        };
        let frame = &transmission.frame;
        let struck = faults.at_receivers(name, frame, has_receiver, transmission.over);
        let mut is_lost = false;
        for event in &struck {
            let EventKind::Fault { effect: FaultEffect::Lost(receivers), .. } = &event.what else { continue };
            is_lost |= receivers.is_empty();
            for port in self.ports.iter_mut().filter(|port| receivers.contains(&port.name)) {
                port.heard = transmission.end;
            }
        }
        self.journal.note_before(&transmission.frame, transmission.over, struck);
        is_lost
    }

    /// Lowers the receive error counters of the receivers at one bit rate after a successful reception.
    fn count_received(&mut self, place: usize, at: Instant, omission: Option<&Omission>) {
        let mut counting = std::mem::take(&mut self.groups[place].counting);
        counting.retain(|id| {
            let is_omitted = omission.is_some_and(|omission| omission.receivers.contains(id));
            if !self.senders.contains(id) && !is_omitted {
                self.change(*id, at, Confinement::received);
            }
            self.ports[id.0].confinement.receive_errors() > 0
        });
        self.groups[place].counting = counting;
    }

    /// Raises the receive error counter of each controller that detected the error, except the senders.
    fn count_errors(&mut self, transmission: &Transmission) {
        let by_other_rate = transmission.failure.as_ref().is_some_and(|failure| failure.by_other_rate);
        for group in 0..self.groups.len() {
            let other_rate = by_other_rate && self.groups[group].rate != transmission.rate;
            // Receive errors never cause bus-off, so the members do not change in this loop.
            for place in 0..self.groups[group].members.len() {
                let id = self.groups[group].members[place];
                let accepted = |omission: &Omission| !omission.receivers.contains(&id);
                if self.senders.contains(&id) || transmission.omission.as_deref().is_some_and(accepted) {
                    continue;
                }
                let port = &mut self.ports[id.0];
                if port.confinement.receive_errors() == 0 {
                    self.groups[group].counting.push(id);
                }
                let is_first = other_rate || transmission.omission.is_some();
                let first = is_first && port.mode() == BusErrorMode::ErrorActive;
                port.tell(transmission.end, WireEvent::NotReceived { first });
                self.change(id, transmission.over, |confinement| confinement.receive_error(first));
            }
        }
    }

    fn after_sending(&mut self, id: PortId, error: Option<BusError>, end: Nanos, at: Instant) {
        let port = &mut self.ports[id.0];
        port.transmit.sent(error.is_none());
        port.tell(end, error.map_or(WireEvent::Sent, WireEvent::NotSent));
        self.change(id, at, |confinement| match error {
            None => confinement.sent(),
            Some(BusError::Acknowledgement) => confinement.no_acknowledgement(),
            Some(_) => confinement.transmit_error(),
        });
        let port = &mut self.ports[id.0];
        if port.mode() == BusErrorMode::ErrorPassive {
            port.ready_at = self.free_at + bit_times(SUSPEND, port.rate);
        }
        if port.is_device() {
            self.touched.push(id);
        }
        self.release_waiting(id, at);
        self.refresh(id, at);
    }
}
