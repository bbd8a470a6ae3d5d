//! The address claim of a controller that cannot choose its address (SAE J1939-81, ISO 11783-5; SPEC 5).
//!
//! ```text
//!   start        sent           250 ms           a lower NAME claims the address
//! ────────▶ begun ────▶ waiting ───────▶ claimed ────────────────────────────────▶ lost
//!             └────────────┴─────────────────────────────────────────────────────▶
//! ```

use super::Outcome;
use super::request::Request;
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::j1939_id::{Address, Pgn};
use crate::wire::name::{CommandedAddress, Name};

/// The wait after the first claim. No other message is sent before its end.
pub const CLAIM_WAIT: Duration = Duration::from_millis(250);

/// The unit of the pseudo-random delay before a cannot-claim. All cannot-claims have the same identifier, and the delay
/// makes a collision of two of them unlikely.
pub const CANNOT_CLAIM_STEP: Duration = Duration::from_micros(600);

/// The minimum time between two objections to another controller's use of the address (ISO 11783-5).
pub const OBJECTION_INTERVAL: Duration = Duration::from_secs(5);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The first claim is unsent.
    Begun,
    Waiting {
        until: Instant,
    },
    Claimed,
    Lost {
        /// The time of the next cannot-claim; [`NEVER`] if none is pending.
        answer_at: Instant,
    },
}

/// The claim of a controller to its address.
#[derive(Clone, Debug)]
pub struct AddressClaim {
    name: Name,
    address: Address,
    state: State,
    /// The earliest time of the next objection.
    next_objection: Instant,
}

impl AddressClaim {
    /// Begins an address claim. The first claim is pending. No other message may be sent until the claim is
    /// [sent](Self::sent) and the wait is over.
    #[must_use]
    pub const fn new(name: Name, address: Address) -> Self {
        Self { name, address, state: State::Begun, next_objection: Instant::MIN }
    }

    /// Records the transmission of the claim. The first claim starts the wait.
    ///
    /// The wait lasts [`CLAIM_WAIT`] for the addresses 128–247, which self-configurable controllers may also choose.
    /// Other addresses need no wait.
    pub const fn sent(&mut self, now: Instant) {
        if matches!(self.state, State::Begun) {
            self.state = State::Waiting { until: delayed(now, self.wait()) };
        }
    }

    /// Returns the NAME.
    #[must_use]
    pub const fn name(&self) -> Name {
        self.name
    }

    /// Returns the address; `None` after its loss.
    #[inline]
    #[must_use]
    pub const fn address(&self) -> Option<Address> {
        if self.is_lost() { None } else { Some(self.address) }
    }

    /// Returns whether messages other than claims may be sent.
    #[inline]
    #[must_use]
    pub const fn may_send(&self) -> bool {
        matches!(self.state, State::Claimed)
    }

    /// Returns whether another controller has taken the address.
    #[inline]
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        matches!(self.state, State::Lost { .. })
    }

    /// Encodes the claim or, after the loss of the address, the cannot-claim.
    #[inline]
    #[must_use]
    pub fn frame(&self) -> Frame {
        self.name.claim(self.address().unwrap_or(Address::NULL))
    }

    /// Handles a claim of `source` by another controller. A claim with the same NAME is ignored, because two identical
    /// controllers would claim forever.
    #[must_use]
    pub fn contend(&mut self, source: Address, name: Name, now: Instant) -> Outcome {
        if source != self.address || name == self.name || self.is_lost() {
            return Outcome::Nothing;
        }
        if self.name < name {
            return Outcome::Pending;
        }
        self.state = State::Lost { answer_at: self.cannot_claim_at(now) };
        Outcome::Lost
    }

    /// Handles another controller's frame, other than a claim, with this controller's address as its source. The
    /// objection is a claim without a DTC (R), at most one per [`OBJECTION_INTERVAL`]. Before the end of the wait and
    /// after the loss of the address there is no objection.
    #[must_use]
    pub fn object(&mut self, now: Instant) -> Outcome {
        if !self.may_send() || now < self.next_objection {
            return Outcome::Nothing;
        }
        self.next_objection = delayed(now, OBJECTION_INTERVAL);
        Outcome::Pending
    }

    /// Handles a request for [`Pgn::ADDRESS_CLAIMED`]. Requests for other groups have no effect.
    ///
    /// After the loss of the address, only a request to all is answered: by a cannot-claim after a pseudo-random delay.
    /// Further requests during the delay have no effect.
    #[inline]
    #[must_use]
    pub fn requested(&mut self, request: &Request, now: Instant) -> Outcome {
        if request.pgn != Pgn::ADDRESS_CLAIMED {
            return Outcome::Nothing;
        }
        match self.state {
            State::Begun | State::Waiting { .. } | State::Claimed => return Outcome::Pending,
            State::Lost { answer_at: NEVER } if !request.addressed => {
                self.state = State::Lost { answer_at: self.cannot_claim_at(now) };
            }
            State::Lost { .. } => {}
        }
        Outcome::Nothing
    }

    /// Returns the address that a [commanded address](CommandedAddress) assigns to this controller, whether its address
    /// is claimed or lost. Returns `None` for a malformed command and for another NAME.
    #[must_use]
    pub fn commanded(&self, payload: &[u8]) -> Option<Address> {
        CommandedAddress::parse(payload).filter(|command| command.name == self.name).map(|command| command.address)
    }

    /// Ends the wait, or queues a cannot-claim, when it is due.
    #[must_use]
    pub fn poll(&mut self, now: Instant) -> Outcome {
        match self.state {
            State::Waiting { until } if now >= until => {
                self.state = State::Claimed;
                Outcome::Claimed
            }
            State::Lost { answer_at } if now >= answer_at => {
                self.state = State::Lost { answer_at: NEVER };
                Outcome::Pending
            }
            _ => Outcome::Nothing,
        }
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        match self.state {
            State::Waiting { until } => until,
            State::Lost { answer_at } => answer_at,
            State::Begun | State::Claimed => NEVER,
        }
    }

    const fn wait(&self) -> Duration {
        match self.address.get() {
            128..=247 => CLAIM_WAIT,
            _ => Duration::from_ticks(0),
        }
    }

    /// Returns the time of the next cannot-claim, 0 to 255 units of [`CANNOT_CLAIM_STEP`] after `now`. The number of
    /// units is the top byte of a product, which depends on all bits of NAME and `now`.
    fn cannot_claim_at(&self, now: Instant) -> Instant {
        let mixed = (self.name.raw() ^ now.as_ticks()).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let steps = mixed >> 56;
        delayed(now, Duration::from_ticks(CANNOT_CLAIM_STEP.as_ticks().saturating_mul(steps)))
    }
}
