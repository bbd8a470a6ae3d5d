//! Address claim of a controller that cannot take another address by itself (SAE J1939-81; SPEC 5).
//!
//! ```text
//!        start          sent           250 ms           a lower NAME claims the address
//! idle ────────▶ begun ────────▶ waiting ───────▶ claimed ────────────────────────────────▶ lost
//!                  └────────────────┴─────────────────────────────────────────────────────▶
//! ```

use super::request::Request;
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER, after};
use crate::wire::j1939_id::{Address, Pgn};
use crate::wire::name::{CommandedAddress, Name};

/// How long a controller waits for objections to its first claim before it sends anything else.
pub const CLAIM_WAIT: Duration = Duration::from_millis(250);

/// A cannot-claim is held back by so much, times 0–255, that those that lost at the same time do not meet: their
/// identifiers are the same.
pub const CANNOT_CLAIM_STEP: Duration = Duration::from_micros(600);

/// What became of the claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing.
    Nothing,
    /// Send this: a claim, or a cannot-claim. It may be sent whatever [`AddressClaim::may_send`] says.
    Send(Frame),
    /// The wait is over: everything may be sent.
    Claimed,
    /// The address belongs to somebody else: nothing more may be sent, nor what waits to be.
    Lost,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// The first claim is not on the bus yet.
    Begun,
    Waiting {
        until: Instant,
    },
    Claimed,
    Lost {
        /// When the cannot-claim goes out; [`NEVER`] when none is owed.
        answer_at: Instant,
    },
}

/// A controller's claim of its address.
#[derive(Debug)]
pub struct AddressClaim {
    name: Name,
    address: Address,
    state: State,
}

impl AddressClaim {
    /// A controller that has not claimed its address yet.
    #[must_use]
    pub const fn new(name: Name, address: Address) -> Self {
        Self { name, address, state: State::Idle }
    }

    /// Claims the address. The claim that is returned is to be sent, and [`sent`](Self::sent) to be called when it is on
    /// the bus, however long that takes: nothing else may go out before.
    #[must_use]
    pub fn start(&mut self) -> Frame {
        self.state = State::Begun;
        self.claim()
    }

    /// The first claim is on the bus: the wait begins. For any later claim nothing is waited for.
    ///
    /// An address of 128–247 may be another's by its own choice: the wait lets that one object. Outside there is none.
    pub const fn sent(&mut self, now: Instant) {
        if self.is_begun() {
            self.state = State::Waiting { until: after(now, self.wait()) };
        }
    }

    /// Whether the first claim is not on the bus yet.
    #[inline]
    #[must_use]
    pub const fn is_begun(&self) -> bool {
        matches!(self.state, State::Begun)
    }

    /// The NAME.
    #[must_use]
    pub const fn name(&self) -> Name {
        self.name
    }

    /// The address, from its claim on and until it is lost.
    #[inline]
    #[must_use]
    pub const fn address(&self) -> Option<Address> {
        match self.state {
            State::Begun | State::Waiting { .. } | State::Claimed => Some(self.address),
            State::Idle | State::Lost { .. } => None,
        }
    }

    /// Whether more than claims may be sent.
    #[inline]
    #[must_use]
    pub const fn may_send(&self) -> bool {
        matches!(self.state, State::Claimed)
    }

    /// Whether the address belongs to somebody else.
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        matches!(self.state, State::Lost { .. })
    }

    /// Somebody claims `source`. A claim with the own NAME is ignored: two twins would claim for ever.
    #[inline]
    #[must_use]
    pub fn contend(&mut self, source: Address, name: Name, now: Instant) -> Outcome {
        if source != self.address || name == self.name || self.address().is_none() {
            return Outcome::Nothing;
        }
        if self.name < name {
            return Outcome::Send(self.claim());
        }
        self.state = State::Lost { answer_at: self.cannot_claim_at(now) };
        Outcome::Lost
    }

    /// A request for [`Pgn::ADDRESS_CLAIMED`]; others are not the claim's.
    ///
    /// One that lost its address answers a request to all with a cannot-claim, after its delay; while that is owed, one
    /// request more changes nothing.
    #[inline]
    #[must_use]
    pub fn requested(&mut self, request: &Request, now: Instant) -> Outcome {
        if request.pgn != Pgn::ADDRESS_CLAIMED {
            return Outcome::Nothing;
        }
        match self.state {
            State::Begun | State::Waiting { .. } | State::Claimed => return Outcome::Send(self.claim()),
            State::Lost { answer_at: NEVER } if !request.addressed => {
                self.state = State::Lost { answer_at: self.cannot_claim_at(now) };
            }
            State::Idle | State::Lost { .. } => {}
        }
        Outcome::Nothing
    }

    /// The address that a [commanded address](CommandedAddress) gives this controller, whether it has one or not; `None`
    /// when it is for another NAME, or is no commanded address.
    #[must_use]
    pub fn commanded(&self, payload: &[u8]) -> Option<Address> {
        CommandedAddress::parse(payload).filter(|command| command.name == self.name).map(|command| command.address)
    }

    /// Ends the wait, or sends a cannot-claim, when it is due.
    #[must_use]
    pub fn poll(&mut self, now: Instant) -> Outcome {
        match self.state {
            State::Waiting { until } if now >= until => {
                self.state = State::Claimed;
                Outcome::Claimed
            }
            State::Lost { answer_at } if now >= answer_at => {
                self.state = State::Lost { answer_at: NEVER };
                Outcome::Send(self.name.claim(Address::NULL))
            }
            _ => Outcome::Nothing,
        }
    }

    /// When [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        match self.state {
            State::Waiting { until } => until,
            State::Lost { answer_at } => answer_at,
            State::Idle | State::Begun | State::Claimed => NEVER,
        }
    }

    fn claim(&self) -> Frame {
        self.name.claim(self.address)
    }

    const fn wait(&self) -> Duration {
        match self.address.get() {
            128..=247 => CLAIM_WAIT,
            _ => Duration::from_ticks(0),
        }
    }

    /// Pseudo-random by NAME and time: the top byte of a product with an odd number, which every bit below goes into.
    fn cannot_claim_at(&self, now: Instant) -> Instant {
        let mixed = (self.name.raw() ^ now.as_ticks()).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let steps = mixed >> 56;
        after(now, Duration::from_ticks(CANNOT_CLAIM_STEP.as_ticks().saturating_mul(steps)))
    }
}
