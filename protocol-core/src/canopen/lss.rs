//! LSS slave (CiA 305; SPEC 4.4).

use super::fast_scan::ScanPosition;
use crate::controller::BitRate;
use crate::time::{Duration, Instant, NEVER, after};
use crate::wire::cob_id::NodeId;
use crate::wire::lss::{Address, Answer, ConfigureError, NO_NODE_ID, Part, Request};

/// The bit timing table of CiA 305, the only one that is supported.
const CIA_TABLE: u8 = 0;

/// What the slave has to know of its device to answer a request.
#[derive(Clone, Copy, Debug)]
pub struct Identity<'a> {
    /// The four numbers.
    pub address: &'a Address,
    /// The node ID in force.
    pub node_id: Option<NodeId>,
    /// The bit rate in force.
    pub bit_rate: BitRate,
    /// The bit rates that can be configured.
    pub bit_rates: &'static [BitRate],
}

/// What a request comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing.
    Nothing,
    /// An answer.
    Answer(Answer),
    /// Store what is pending, then answer with [`Answer::Stored`]. What is not leaves the memory as it is.
    Store {
        /// The pending node ID.
        node_id: Option<NodeId>,
        /// The pending bit rate.
        bit_rate: Option<BitRate>,
    },
    /// Restart as after reset application, under this node ID.
    Restart(NodeId),
    /// A delay begins, in which nothing may be sent; the bit rate changes in [`LssSlave::poll`].
    Silence,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Waiting,
    Configuration,
}

/// The bit rate is being changed: the delay runs twice.
#[derive(Clone, Copy, Debug)]
struct Activation {
    switch_at: Instant,
    end_at: Instant,
    /// Until it is switched.
    bit_rate: Option<BitRate>,
}

/// The LSS slave of a node.
#[derive(Debug, Default)]
pub struct LssSlave {
    state: State,
    /// How many numbers of a switch selective have agreed so far.
    matched: Part,
    scan: ScanPosition,
    pending_node_id: Option<NodeId>,
    pending_bit_rate: Option<BitRate>,
    activation: Option<Activation>,
}

impl LssSlave {
    /// Takes a request. The caller sees to it that the NMT state allows LSS.
    pub fn handle(&mut self, request: Request, identity: Identity<'_>, now: Instant) -> Outcome {
        if self.activation.is_some() {
            return Outcome::Nothing;
        }
        match (request, self.state) {
            (Request::SwitchGlobal { mode: 0 }, _) => self.leave(identity),
            (Request::SwitchGlobal { mode: 1 }, _) => {
                self.matched = 0;
                self.state = State::Configuration;
                Outcome::Nothing
            }
            (Request::SwitchSelective(part, number), State::Waiting) => self.select(part, number, identity.address),
            (_, State::Waiting) => Outcome::Nothing,
            (request, State::Configuration) => self.configure(request, identity, now),
        }
    }

    /// NMT start: configuration ends, and what is pending is dropped.
    pub fn started(&mut self) {
        let activation = self.activation;
        *self = Self { activation, ..Self::default() };
    }

    /// The bit rate to switch to now, when its delay has passed.
    pub fn poll(&mut self, now: Instant) -> Option<BitRate> {
        let activation = self.activation.as_mut()?;
        let switched = if now >= activation.switch_at { activation.bit_rate.take() } else { None };
        if now >= activation.end_at {
            self.activation = None;
        }
        switched
    }

    /// When [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        match &self.activation {
            None => NEVER,
            Some(Activation { bit_rate: Some(_), switch_at, .. }) => *switch_at,
            Some(Activation { end_at, .. }) => *end_at,
        }
    }

    /// Whether nothing may be sent, because the bit rate is being changed.
    #[inline]
    #[must_use]
    pub const fn is_silent(&self) -> bool {
        self.activation.is_some()
    }

    fn leave(&mut self, identity: Identity<'_>) -> Outcome {
        self.matched = 0;
        self.state = State::Waiting;
        match self.pending_node_id.take().filter(|pending| Some(*pending) != identity.node_id) {
            Some(pending) => Outcome::Restart(pending),
            None => Outcome::Nothing,
        }
    }

    /// A switch selective: the four numbers in order; a mismatch starts over.
    fn select(&mut self, part: Part, number: u32, address: &Address) -> Outcome {
        let expected = part == 0 || part == self.matched;
        self.matched = if expected && address.part(part) == Some(number) { part.saturating_add(1) } else { 0 };
        if self.matched <= 3 {
            return Outcome::Nothing;
        }
        self.matched = 0;
        self.state = State::Configuration;
        Outcome::Answer(Answer::Selected)
    }

    fn configure(&mut self, request: Request, identity: Identity<'_>, now: Instant) -> Outcome {
        let answer = match request {
            Request::ConfigureNodeId(raw) => match NodeId::new(raw) {
                Some(node_id) => {
                    self.pending_node_id = Some(node_id);
                    Answer::NodeId(ConfigureError::None)
                }
                None => Answer::NodeId(ConfigureError::OutOfRange),
            },
            Request::ConfigureBitTiming { table, index } => {
                let bit_rate = BitRate::from_table_index(index)
                    .filter(|bit_rate| table == CIA_TABLE && identity.bit_rates.contains(bit_rate));
                match bit_rate {
                    Some(bit_rate) => {
                        self.pending_bit_rate = Some(bit_rate);
                        Answer::BitTiming(ConfigureError::None)
                    }
                    None => Answer::BitTiming(ConfigureError::OutOfRange),
                }
            }
            Request::ActivateBitTiming { delay_ms } => {
                let delay = Duration::from_millis(u64::from(delay_ms));
                let switch_at = after(now, delay);
                self.activation = Some(Activation {
                    switch_at,
                    end_at: after(switch_at, delay),
                    bit_rate: Some(self.pending_bit_rate.unwrap_or(identity.bit_rate)),
                });
                return Outcome::Silence;
            }
            Request::Store => {
                return Outcome::Store { node_id: self.pending_node_id, bit_rate: self.pending_bit_rate };
            }
            Request::InquireIdentity(part) => Answer::Identity(part, identity.address.part(part).unwrap_or(0)),
            Request::InquireNodeId => Answer::InquiredNodeId(identity.node_id.map_or(NO_NODE_ID, NodeId::get)),
            Request::IdentifyNonConfigured if self.is_unconfigured(identity) => Answer::NonConfigured,
            Request::FastScan(scan) if self.is_unconfigured(identity) && self.scan.answers(scan, identity.address) => {
                Answer::Identified
            }
            _ => return Outcome::Nothing,
        };
        Outcome::Answer(answer)
    }

    /// Without a node ID, pending ones included.
    const fn is_unconfigured(&self, identity: Identity<'_>) -> bool {
        identity.node_id.is_none() && self.pending_node_id.is_none()
    }
}
