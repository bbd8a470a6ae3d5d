//! LSS slave (CiA 305; SPEC 4.4).

use super::fast_scan::ScanPosition;
use crate::controller::BitRate;
use crate::outcome::Outcome;
use crate::time::{Duration, Instant, NEVER, after};
use crate::wire::cob_id::NodeId;
use crate::wire::lss::{Address, Answer, NO_NODE_ID, Part, Request, SUCCESS};

/// The bit timing table of CiA 305, the only one that is supported.
const CIA_TABLE: u8 = 0;

/// The LSS states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Waits to be selected.
    #[default]
    Waiting,
    /// Selected: can be configured.
    Configuration,
}

/// The rules of a product for LSS.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// The bit rates that can be configured.
    pub bit_rates: &'static [BitRate],
    /// The states in which a slave without node ID answers identify non-configured and fast scan.
    pub identified_in: &'static [State],
    /// The error code for a node ID out of range.
    pub node_id_error: u8,
    /// The error code for a bit rate that is not supported.
    pub bit_rate_error: u8,
    /// The error code for a memory that could not be written.
    pub store_error: u8,
}

/// What the slave has to know of its device to answer a request.
#[derive(Clone, Copy, Debug)]
pub struct Identity<'a> {
    /// The four numbers.
    pub address: &'a Address,
    /// The node ID in force.
    pub node_id: Option<NodeId>,
    /// The bit rate in force.
    pub bit_rate: BitRate,
}

/// What a request demands of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demand {
    /// Store [`LssSlave::unstored`], then answer with [`Answer::Stored`].
    Store,
    /// Restart as after reset application, under this node ID.
    Restart(NodeId),
}

/// Node ID and bit rate, as far as LSS configured them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Configuration {
    /// The node ID.
    pub node_id: Option<NodeId>,
    /// The bit rate.
    pub bit_rate: Option<BitRate>,
}

impl Configuration {
    /// Nothing configured.
    pub const NONE: Self = Self { node_id: None, bit_rate: None };
}

/// A change of the bit rate: the delay runs twice.
#[derive(Clone, Copy, Debug)]
struct Activation {
    switch_at: Instant,
    end_at: Instant,
    /// Until it is in force.
    switch_to: Option<Switch>,
}

/// The bit rate that an activation puts in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Switch {
    /// The bit rate.
    pub bit_rate: BitRate,
    /// Whether LSS configured it and did not store it; without a configured one, the one in force stays.
    pub unstored: bool,
}

/// The LSS slave of a node.
#[derive(Debug, Default)]
pub struct LssSlave {
    state: State,
    /// How many numbers of a switch selective have agreed so far.
    matched: Part,
    scan: ScanPosition,
    /// Configured, and not in force.
    pending: Configuration,
    /// Configured, and not stored since.
    unstored: Configuration,
    activation: Option<Activation>,
}

impl LssSlave {
    /// Returns a slave that waits, with nothing configured.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            state: State::Waiting,
            matched: 0,
            scan: ScanPosition::new(),
            pending: Configuration::NONE,
            unstored: Configuration::NONE,
            activation: None,
        }
    }

    /// Takes a request. The caller sees to it that the NMT state allows LSS.
    pub fn handle(
        &mut self,
        request: Request,
        identity: Identity<'_>,
        rules: &Rules,
        now: Instant,
    ) -> Outcome<Answer, Demand> {
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
            (Request::IdentifyNonConfigured | Request::FastScan(_), state) if rules.identified_in.contains(&state) => {
                self.identify(request, identity)
            }
            (_, State::Waiting) => Outcome::Nothing,
            (request, State::Configuration) => self.configure(request, identity, rules, now),
        }
    }

    /// Ends configuration at NMT start or reset communication: what is pending is dropped, an activation goes on.
    pub fn end_configuration(&mut self) {
        let activation = self.activation;
        *self = Self { activation, ..Self::new() };
    }

    /// Starts anew at reset application: of an activation only its silence goes on.
    pub fn restart(&mut self) {
        self.end_configuration();
        if let Some(activation) = &mut self.activation {
            activation.switch_to = None;
        }
    }

    /// Returns the node ID that was configured and is not in force.
    #[must_use]
    pub const fn pending_node_id(&self) -> Option<NodeId> {
        self.pending.node_id
    }

    /// Returns what was configured and is not stored.
    #[must_use]
    pub const fn unstored(&self) -> Configuration {
        self.unstored
    }

    /// Notes that the memory holds this configuration.
    pub fn stored(&mut self, stored: Configuration) {
        self.unstored.node_id = self.unstored.node_id.filter(|node_id| Some(*node_id) != stored.node_id);
        self.unstored.bit_rate = self.unstored.bit_rate.filter(|bit_rate| Some(*bit_rate) != stored.bit_rate);
    }

    /// Returns the bit rate to be put in force now, when its delay has passed.
    pub fn poll(&mut self, now: Instant) -> Option<Switch> {
        let activation = self.activation.as_mut()?;
        let switched = if now >= activation.switch_at { activation.switch_to.take() } else { None };
        if now >= activation.end_at {
            self.activation = None;
        }
        switched
    }

    /// Returns when [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        match &self.activation {
            None => NEVER,
            Some(Activation { switch_to: Some(_), switch_at, .. }) => *switch_at,
            Some(Activation { end_at, .. }) => *end_at,
        }
    }

    /// Returns whether nothing may be sent, because the bit rate is being changed.
    #[inline]
    #[must_use]
    pub const fn is_silent(&self) -> bool {
        self.activation.is_some()
    }

    fn leave(&mut self, identity: Identity<'_>) -> Outcome<Answer, Demand> {
        self.matched = 0;
        self.state = State::Waiting;
        match self.pending.node_id.take().filter(|pending| Some(*pending) != identity.node_id) {
            Some(pending) => Outcome::Demand(Demand::Restart(pending)),
            None => Outcome::Nothing,
        }
    }

    /// Takes one number of a switch selective: the four come in order, a mismatch starts over.
    fn select(&mut self, part: Part, number: u32, address: &Address) -> Outcome<Answer, Demand> {
        let expected = part == 0 || part == self.matched;
        self.matched = if expected && address.part(part) == Some(number) { part.saturating_add(1) } else { 0 };
        if self.matched <= 3 {
            return Outcome::Nothing;
        }
        self.matched = 0;
        self.state = State::Configuration;
        Outcome::Done(Answer::Selected)
    }

    /// Answers for a slave without node ID, pending ones included.
    fn identify(&mut self, request: Request, identity: Identity<'_>) -> Outcome<Answer, Demand> {
        if identity.node_id.or(self.pending.node_id).is_some() {
            return Outcome::Nothing;
        }
        match request {
            Request::IdentifyNonConfigured => Outcome::Done(Answer::NonConfigured),
            Request::FastScan(scan) if self.scan.answers(scan, identity.address) => Outcome::Done(Answer::Identified),
            _ => Outcome::Nothing,
        }
    }

    fn configure(
        &mut self,
        request: Request,
        identity: Identity<'_>,
        rules: &Rules,
        now: Instant,
    ) -> Outcome<Answer, Demand> {
        Outcome::Done(match request {
            Request::ConfigureNodeId(raw) => match NodeId::new(raw) {
                Some(node_id) => {
                    self.pending.node_id = Some(node_id);
                    self.unstored.node_id = Some(node_id);
                    Answer::NodeId(SUCCESS)
                }
                None => Answer::NodeId(rules.node_id_error),
            },
            Request::ConfigureBitTiming { table, index } => {
                let bit_rate = BitRate::from_table_index(index)
                    .filter(|bit_rate| table == CIA_TABLE && rules.bit_rates.contains(bit_rate));
                match bit_rate {
                    Some(bit_rate) => {
                        self.pending.bit_rate = Some(bit_rate);
                        self.unstored.bit_rate = Some(bit_rate);
                        Answer::BitTiming(SUCCESS)
                    }
                    None => Answer::BitTiming(rules.bit_rate_error),
                }
            }
            Request::ActivateBitTiming { delay_ms } => {
                let delay = Duration::from_millis(u64::from(delay_ms));
                let switch_at = after(now, delay);
                let pending = self.pending.bit_rate;
                let unstored = pending.is_some() && pending == self.unstored.bit_rate;
                let switch = Switch { bit_rate: pending.unwrap_or(identity.bit_rate), unstored };
                self.activation =
                    Some(Activation { switch_at, end_at: after(switch_at, delay), switch_to: Some(switch) });
                return Outcome::Nothing;
            }
            Request::Store => return Outcome::Demand(Demand::Store),
            Request::InquireIdentity(part) => Answer::Identity(part, identity.address.part(part).unwrap_or(0)),
            Request::InquireNodeId => Answer::InquiredNodeId(identity.node_id.map_or(NO_NODE_ID, NodeId::get)),
            _ => return Outcome::Nothing,
        })
    }
}
