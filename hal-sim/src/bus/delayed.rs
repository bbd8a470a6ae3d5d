//! The way of a frame from an application to its controller, and the frames that faults keep there.

use std::convert::Infallible;

use embedded_can::nb::Can;
use protocol_core::controller::{Controller, Filter, Filters};
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, NEVER, after};

use super::faults::Handed;
use super::port::Port;
use super::transmit::Transmit;
use super::{Bus, PortId};

/// How many frames of a device wait between it and its controller; further ones stay in the device.
const DELAYED: usize = 256;

/// A frame that a fault keeps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Delayed {
    pub(super) frame: Frame,
    /// When it goes to the controller; [`NEVER`] while it waits for room there.
    due: Instant,
    wait: Wait,
    /// Later frames of its identifier do not wait behind it.
    is_overtaken: bool,
}

/// What else a frame waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wait {
    /// Nothing.
    No,
    /// The next frame of its sender.
    Next,
    /// The end of the next frame of its sender on the bus.
    Sent,
}

/// The CAN controller of a device, as the device uses it: with the faults between the two.
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
    fn is_idle(&self) -> bool {
        self.bus.port(self.id).is_idle()
    }

    fn abort(&mut self, which: Filter) {
        self.port().abort(which);
    }

    fn set_filters(&mut self, filters: &Filters) {
        self.port().set_filters(filters);
    }
}

impl Bus {
    /// Takes a frame from the application behind a port; to be followed by [`refresh`](Self::refresh). Gives back a
    /// less urgent one that the controller has no room for.
    ///
    /// # Errors
    /// When the controller cannot take it now.
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
        let is_behind = |delayed: &Delayed| match delayed.wait {
            Wait::No => delayed.frame.key() == frame.key() && !delayed.is_overtaken,
            Wait::Next => false,
            Wait::Sent => true,
        };
        let waits_behind = port.delayed.iter().any(is_behind);
        let is_full = matches!(port.transmit, Transmit::Mailboxes(_)) && port.delayed.len() >= DELAYED;
        if is_full || (!waits_behind && !port.transmit.takes(frame)) {
            port.used = true;
            return Err(nb::Error::WouldBlock);
        }
        let struck = self.faults.at_sender(&port.name, frame, now);
        let port = &mut self.ports[id.0];
        let is_next_of_swap = port.delayed.iter().any(|delayed| delayed.wait == Wait::Next);
        let taken = match struck {
            None if !waits_behind => port.transmit(frame),
            None => {
                port.delay(Handed::at_once(frame), now);
                Ok(None)
            }
            Some(struck) => {
                self.journal.extend(struck.events);
                struck.frames.into_iter().for_each(|handed| port.delay(handed, now));
                Ok(None)
            }
        };
        if is_next_of_swap {
            // The frame that was just handed over may be swapped itself: the earlier one is the first that waits.
            if let Some(delayed) = port.delayed.iter_mut().find(|delayed| delayed.wait == Wait::Next) {
                (delayed.wait, delayed.due) = (Wait::Sent, NEVER);
            }
        }
        self.release(id, now);
        taken
    }

    /// Hands those frames of a port to its controller that are due, as far as it has room for them.
    fn release(&mut self, id: PortId, now: Instant) {
        let port = &mut self.ports[id.0];
        let mut place = 0;
        while let Some(delayed) = port.delayed.get(place).copied() {
            let is_due = match delayed.wait {
                Wait::No => delayed.due <= now || delayed.due == NEVER,
                Wait::Next => delayed.due <= now,
                Wait::Sent => port.transmit.is_empty(),
            };
            if !is_due {
                if delayed.wait == Wait::Sent {
                    // Whatever came later waits behind it.
                    break;
                }
                place += 1;
                continue;
            }
            match port.transmit.put(delayed.frame) {
                Ok(overtaken) => {
                    port.used = true;
                    port.delayed.remove(place);
                    if let Some(frame) = overtaken {
                        port.delayed.insert(0, Delayed { frame, due: NEVER, wait: Wait::No, is_overtaken: false });
                        place += 1;
                    }
                }
                Err(_) => {
                    (port.delayed[place].due, port.delayed[place].wait) = (NEVER, Wait::No);
                    place += 1;
                }
            }
        }
        let (is_empty, listed) = (port.delayed.is_empty(), self.delaying.iter().position(|other| *other == id));
        match listed {
            None if !is_empty => self.delaying.push(id),
            Some(place) if is_empty => drop(self.delaying.remove(place)),
            _ => {}
        }
        self.schedule_faults();
    }

    /// Hands over what is due by now.
    pub(super) fn release_due(&mut self, now: Instant) {
        for id in self.delaying.clone() {
            if self.ports[id.0].next_release() <= now {
                self.release(id, now);
                self.refresh(id, now);
            }
        }
    }

    /// Looks, after a frame of a port has left its controller, whether there is room for those that wait.
    pub(super) fn release_waiting(&mut self, id: PortId, now: Instant) {
        if !self.ports[id.0].delayed.is_empty() {
            self.release(id, now);
        }
    }

    /// Returns when the next frame is to be handed over.
    pub(super) fn next_release(&self) -> Instant {
        self.delaying.iter().map(|id| self.ports[id.0].next_release()).min().unwrap_or(NEVER)
    }
}

impl Port {
    /// Keeps a frame. It waits behind earlier ones of its identifier, unless they are overtaken.
    fn delay(&mut self, handed: Handed, now: Instant) {
        let Handed { frame, late, is_overtaken, swaps } = handed;
        let due = after(now, late);
        let is_ahead = |delayed: &&Delayed| {
            delayed.wait == Wait::No
                && delayed.due != NEVER
                && delayed.frame.key() == frame.key()
                && !delayed.is_overtaken
        };
        let last = self.delayed.iter().filter(is_ahead).map(|delayed| delayed.due).max();
        let (due, wait) = match swaps {
            Some(within) => (after(due, within), Wait::Next),
            None => (last.map_or(due, |last| last.max(due)), Wait::No),
        };
        self.delayed.push(Delayed { frame, due, wait, is_overtaken });
    }

    /// Returns when the next frame is to be handed to the controller, other than when that has room.
    fn next_release(&self) -> Instant {
        self.delayed.iter().map(|delayed| delayed.due).min().unwrap_or(NEVER)
    }
}
