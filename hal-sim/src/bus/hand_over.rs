//! The handover of frames from an application to its CAN controller, including the faults that act on this path.

use std::convert::Infallible;

use embedded_can::nb::Can;
use protocol_core::controller::{Controller, Filter, Filters};
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER};

use super::delayed::Delayed;
use super::fault::FaultId;
use super::port::{Port, SlowAnswers};
use super::{Bus, PortId};

/// A device's view of its CAN controller. Communication faults act on the frames that the device sends.
pub struct DeviceCan<'a> {
    bus: &'a mut Bus,
    id: PortId,
    now: Instant,
}

impl<'a> DeviceCan<'a> {
    pub(crate) const fn new(bus: &'a mut Bus, id: PortId, now: Instant) -> Self {
        Self { bus, id, now }
    }

    fn port(&mut self) -> &mut Port {
        self.bus.port_mut(self.id)
    }
}

impl Can for DeviceCan<'_> {
    type Frame = Frame;
    type Error = Infallible;

    #[inline]
    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        self.bus.hand_over(self.id, frame, self.now)
    }

    #[inline]
    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        self.port().receive()
    }
}

impl Controller for DeviceCan<'_> {
    #[inline]
    fn holds(&self, which: Filter) -> bool {
        self.bus.port(self.id).holds(which)
    }

    fn abort(&mut self, which: Filter) {
        self.port().abort(which);
        self.bus.release_waiting(self.id, self.now);
    }

    fn set_filters(&mut self, filters: &Filters) {
        self.port().set_filters(filters);
    }
}

impl Bus {
    /// Queues a frame from the application for transmission. Returns the displaced, less urgent frame, if any. The
    /// caller must call [`refresh`](Self::refresh) afterwards.
    ///
    /// # Errors
    /// `WouldBlock` if the controller cannot accept the frame now.
    #[inline]
    pub(crate) fn hand_over(
        &mut self,
        id: PortId,
        frame: &Frame,
        now: Instant,
    ) -> nb::Result<Option<Frame>, Infallible> {
        if self.faults.at_senders || !self.ports[id.0].delayed.is_empty() {
            return self.hand_over_with_faults(id, frame, now);
        }
        self.ports[id.0].transmit(frame)
    }

    #[cold]
    fn hand_over_with_faults(
        &mut self,
        id: PortId,
        frame: &Frame,
        now: Instant,
    ) -> nb::Result<Option<Frame>, Infallible> {
        let port = &mut self.ports[id.0];
        let waits = port.delayed.holds_back(frame);
        let is_full = port.is_device() && port.delayed.is_full();
        if is_full || !(waits || port.queues || port.transmit.takes(frame)) {
            port.used = true;
            return Err(nb::Error::WouldBlock);
        }
        if port.answers.as_ref().is_some_and(|answers| (answers.is_answer)(frame)) && port.delayed.is_full_of_answers()
        {
            self.note_dropped(id, 1, now);
            return Ok(None);
        }
        let swapped = port.delayed.swapped();
        // Faults were already applied to a frame that the controller returned.
        let is_returned = port.returned.iter().position(|returned| returned == frame);
        let struck = match is_returned {
            Some(place) => {
                port.returned.remove(place);
                Vec::new()
            }
            None => self.strike_at_sender(id, frame, now),
        };
        let port = &mut self.ports[id.0];
        let next = port.delayed.len();
        let mut displaced = None;
        if !struck.is_empty() {
            struck.into_iter().for_each(|delayed| port.delayed.add(delayed));
        } else if waits {
            port.delayed.add(Delayed::new(*frame, now));
        } else if let Ok(returned) = port.transmit(frame) {
            port.returned.extend(returned);
            displaced = returned;
        } else {
            port.delayed.queue(*frame, now);
        }
        if let Some((swapped, fault)) = swapped {
            port.delayed.follow(swapped, next);
            self.faults.count(fault);
        }
        self.release(id, now);
        Ok(displaced)
    }

    /// Applies the answer delay, then the faults, to a frame from the application. Returns the resulting frames; none if
    /// the frame is unaffected.
    fn strike_at_sender(&mut self, id: PortId, frame: &Frame, now: Instant) -> Vec<Delayed> {
        let late = self.ports[id.0].answers.as_mut().and_then(|answers| answers.delay(frame));
        let mut sent = Delayed::new(*frame, now);
        if let Some(late) = late {
            sent.delay(late);
            sent.is_own = true;
        }
        let (ports, delaying) = (&self.ports, &self.delaying);
        let uncounted = |fault: FaultId| delaying.iter().map(|id| ports[id.0].delayed.uncounted(fault)).sum::<usize>();
        let can_swap = ports[id.0].delayed.swapped().is_none();
        let (mut frames, events) = self.faults.at_sender(&ports[id.0].name, &sent, can_swap, uncounted, now);
        if !sent.is_own && events.is_empty() {
            frames.clear();
        }
        self.journal.note(|| events);
        frames
    }

    /// Sets the answer delay of a device; `None` removes the delay.
    pub(crate) fn delay_answers(&mut self, id: PortId, answers: Option<SlowAnswers>) {
        self.ports[id.0].answers = answers.map(Box::new);
        self.slow_down();
    }

    /// Sets whether refused frames from a device wait for a free mailbox. A device with a slow cycle could offer a
    /// refused frame again only in its next cycle.
    pub(crate) fn queue_frames(&mut self, id: PortId, queues: bool) {
        self.ports[id.0].queues = queues;
        self.slow_down();
    }

    fn slow_down(&mut self) {
        self.faults.slow_down(self.ports.iter().any(|port| port.answers.is_some() || port.queues));
    }

    /// Hands a port's due frames to its controller, and updates the list of ports with delayed frames.
    pub(super) fn release(&mut self, id: PortId, now: Instant) {
        let Self { ports, faults, .. } = self;
        let port = &mut ports[id.0];
        port.used |= port.delayed.release(&mut port.transmit, now, |fault| faults.count(fault));
        let (is_empty, listed) = (port.delayed.is_empty(), self.delaying.iter().position(|other| *other == id));
        match listed {
            None if !is_empty => self.delaying.push(id),
            Some(place) if is_empty => drop(self.delaying.remove(place)),
            _ => {}
        }
        self.schedule_faults();
    }

    /// Hands over all delayed frames that are due by `now`.
    pub(super) fn release_due(&mut self, now: Instant) {
        for id in self.delaying.clone() {
            if self.ports[id.0].delayed.next_handover() <= now {
                self.release(id, now);
                self.refresh(id, now);
            }
        }
    }

    /// Hands over the frames that wait for a free mailbox, after a frame on the port was sent or aborted.
    pub(super) fn release_waiting(&mut self, id: PortId, now: Instant) {
        if !self.ports[id.0].delayed.is_empty() {
            self.release(id, now);
        }
    }

    /// Returns the time of the next scheduled handover.
    pub(super) fn next_release(&self) -> Instant {
        self.delaying.iter().map(|id| self.ports[id.0].delayed.next_handover()).min().unwrap_or(NEVER)
    }
}
