//! What the broadcast manager of Linux does for a client of the reference daemon: subscriptions, content filters,
//! cyclic frames; and the counts of control mode. No I/O, time as a parameter.
//!
//! It differs in one thing: a frame that comes too soon for its subscription is left out, and not delivered later.

use std::time::Duration;

use protocol_core::frame::{Frame, Id};
use tokio::time::Instant;

/// The most subscriptions, and the most cyclic frames, of one client.
pub(super) const MOST: usize = 256;

/// The shortest cycle: that of the timers.
const SHORTEST: Duration = Duration::from_millis(1);

/// What a client is told of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Mode {
    /// What it has subscribed to.
    #[default]
    Broadcast,
    /// Everything.
    Raw,
    /// Nothing but statistics.
    Control,
}

/// Frames and the bytes in them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Traffic {
    pub(super) frames: u64,
    pub(super) bytes: u64,
}

/// The broadcast manager of one client.
#[derive(Debug, Default)]
pub(super) struct Broadcast {
    pub(super) mode: Mode,
    subscriptions: Vec<Subscription>,
    cyclic: Vec<Cyclic>,
    received: Traffic,
    sent: Traffic,
    /// How often the counts are told, and when next.
    statistics: Option<(Duration, Instant)>,
}

/// No room for more than [`MOST`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Full;

#[derive(Debug)]
struct Subscription {
    id: Id,
    /// The bits that count; `None`: every frame.
    mask: Option<u64>,
    throttle: Duration,
    /// The frame that was delivered last: data and time.
    last: Option<(u64, Instant)>,
}

#[derive(Debug)]
struct Cyclic {
    frame: Frame,
    period: Duration,
    due: Instant,
}

impl Broadcast {
    /// Adds a subscription, or a filter by the bits of `mask`; an equal one before is replaced.
    pub(super) fn subscribe(&mut self, id: Id, mask: Option<&[u8]>, throttle: Duration) -> Result<(), Full> {
        let mask = mask.map(bits);
        self.subscriptions.retain(|other| other.id != id || other.mask.is_some() != mask.is_some());
        if self.subscriptions.len() == MOST {
            return Err(Full);
        }
        self.subscriptions.push(Subscription { id, mask, throttle, last: None });
        Ok(())
    }

    /// Takes all subscriptions and filters of an identifier away.
    pub(super) fn unsubscribe(&mut self, id: Id) {
        self.subscriptions.retain(|other| other.id != id);
    }

    /// Counts a frame that was on the bus; returns whether the client gets it.
    pub(super) fn deliver(&mut self, frame: &Frame, now: Instant) -> bool {
        self.received.add(frame);
        match self.mode {
            Mode::Raw => true,
            Mode::Control => false,
            // One delivery is enough, but each subscription takes note.
            Mode::Broadcast => {
                let taken = self.subscriptions.iter_mut().filter(|subscription| subscription.id == frame.id());
                taken.filter_map(|subscription| subscription.takes(frame, now).then_some(())).count() > 0
            }
        }
    }

    /// Sends a frame in a cycle from now on; a cycle of that identifier is replaced.
    pub(super) fn add(&mut self, frame: Frame, period: Duration, now: Instant) -> Result<(), Full> {
        self.delete(frame.id());
        if self.cyclic.len() == MOST {
            return Err(Full);
        }
        self.cyclic.push(Cyclic { frame, period, due: now });
        Ok(())
    }

    /// Changes the data of a cyclic frame; returns whether there is one.
    pub(super) fn update(&mut self, frame: Frame) -> bool {
        let cyclic = self.cyclic.iter_mut().find(|cyclic| cyclic.frame.id() == frame.id());
        cyclic.map(|cyclic| cyclic.frame = frame).is_some()
    }

    /// Ends the cycle of an identifier.
    pub(super) fn delete(&mut self, id: Id) {
        self.cyclic.retain(|cyclic| cyclic.frame.id() != id);
    }

    /// Returns when a frame is to be sent.
    pub(super) fn due(&self) -> Option<Instant> {
        self.cyclic.iter().map(|cyclic| cyclic.due).min()
    }

    /// Returns a frame that is due. One without a period is sent once; a cycle that was held up goes on from now.
    pub(super) fn take_due(&mut self, now: Instant) -> Option<Frame> {
        let place = self.cyclic.iter().position(|cyclic| cyclic.due <= now)?;
        let Cyclic { frame, period, due } = &mut self.cyclic[place];
        let frame = *frame;
        if period.is_zero() {
            self.cyclic.remove(place);
        } else {
            let period = (*period).max(SHORTEST);
            *due = if now > *due + period { now + period } else { *due + period };
        }
        Some(frame)
    }

    /// Counts a frame that the client sends.
    pub(super) fn count_sent(&mut self, frame: &Frame) {
        self.sent.add(frame);
    }

    /// Tells the counts every so often; with zero, no more.
    pub(super) fn set_statistics(&mut self, every: Duration, now: Instant) {
        self.statistics = (!every.is_zero()).then(|| (every, now + every));
    }

    /// Returns when the counts are to be told: in control mode alone.
    pub(super) fn statistics_due(&self) -> Option<Instant> {
        self.statistics.filter(|_| self.mode == Mode::Control).map(|(_, due)| due)
    }

    /// Returns the counts, received and sent, when they are due.
    pub(super) fn take_statistics(&mut self, now: Instant) -> Option<[Traffic; 2]> {
        self.statistics_due().filter(|due| *due <= now)?;
        let (every, due) = self.statistics.as_mut()?;
        *due = now + *every;
        Some([self.received, self.sent])
    }
}

impl Subscription {
    fn takes(&mut self, frame: &Frame, now: Instant) -> bool {
        let data = bits(frame.data());
        let news = match (self.last, self.mask) {
            (Some((last, _)), Some(mask)) => (data ^ last) & mask != 0,
            _ => true,
        };
        let soon = self.last.is_some_and(|(_, at)| now.saturating_duration_since(at) < self.throttle);
        let taken = news && !soon;
        if taken {
            self.last = Some((data, now));
        }
        taken
    }
}

impl Traffic {
    fn add(&mut self, frame: &Frame) {
        self.frames += 1;
        self.bytes += frame.data().len() as u64;
    }
}

/// Returns up to eight bytes as a number, the first byte highest.
fn bits(data: &[u8]) -> u64 {
    let mut bytes = [0; 8];
    bytes.iter_mut().zip(data).for_each(|(slot, byte)| *slot = *byte);
    u64::from_be_bytes(bytes)
}

#[cfg(test)]
#[path = "broadcast_tests.rs"]
mod tests;
