//! Diagnostic messages: DM1 by itself, DM2 on request (SAE J1939-73 5.7.1 and 5.7.2; SPEC 5).

use super::transport::BamSender;
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER, after};
use crate::wire::dm::{self, Trouble};
use crate::wire::j1939_id::{Address, J1939Id, Pgn, Priority};

/// How often DM1 is repeated while anything is active.
pub const PERIOD: Duration = Duration::from_millis(1000);

/// Sends DM1: the one active trouble code that the product shows.
#[derive(Debug)]
pub struct Dm1 {
    active: Option<Trouble>,
    /// What is active has changed since it was last sent.
    changed: bool,
    next: Instant,
}

impl Dm1 {
    /// Nothing is active, and nothing is to be sent.
    #[must_use]
    pub const fn new() -> Self {
        Self { active: None, changed: false, next: NEVER }
    }

    /// Takes what is active now. A change, be it of the counter alone, is due to be sent at once.
    pub fn set(&mut self, active: Option<Trouble>, now: Instant) {
        if active != self.active {
            self.active = active;
            self.changed = true;
            self.next = now;
        }
    }

    /// The message when it is due: a change, which restarts the period, or a repetition. The end of all is told once.
    ///
    /// While the claim of the address forbids to send, it is not to be called: what is due stays due. While the bus cannot
    /// be used, it is, and the frame is dropped.
    #[must_use]
    pub fn poll(&mut self, source: Address, now: Instant) -> Option<Frame> {
        if now < self.next {
            return None;
        }
        let planned = after(self.next, PERIOD);
        self.next = match self.active {
            None => NEVER,
            // After a pause longer than a period there is no burst of what was missed.
            Some(_) if self.changed || planned <= now => after(now, PERIOD),
            Some(_) => planned,
        };
        self.changed = false;
        Some(self.frame(source))
    }

    /// The message as it stands, for a request: the period goes on.
    #[must_use]
    pub fn frame(&self, source: Address) -> Frame {
        single(Pgn::DM1, self.active, source)
    }

    /// When [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.next
    }
}

impl Default for Dm1 {
    fn default() -> Self {
        Self::new()
    }
}

/// Answers a request for DM2, always to all: `previously` active trouble codes in the order in which they are to stand.
/// None or one is the frame that is returned, more are handed to `bam`. While that is busy, the request is dropped.
#[must_use]
pub fn answer_dm2<const SIZE: usize>(
    previously: &[Trouble],
    source: Address,
    bam: &mut BamSender<SIZE>,
    now: Instant,
) -> Option<Frame> {
    match previously {
        _ if bam.is_busy() => None,
        [] => Some(single(Pgn::DM2, None, source)),
        [one] => Some(single(Pgn::DM2, Some(*one), source)),
        several => {
            // It is not busy, and two codes are more bytes than the fewest that go this way.
            _ = bam.start(Pgn::DM2, dm::payload(several), now);
            None
        }
    }
}

fn single(pgn: Pgn, trouble: Option<Trouble>, source: Address) -> Frame {
    Frame::full(J1939Id::global(Priority::DEFAULT, pgn, source).id(), dm::single(trouble))
}
