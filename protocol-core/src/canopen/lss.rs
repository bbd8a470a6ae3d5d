//! The LSS slave (CiA 305; SPEC 4.4).

use super::fast_scan::ScanPosition;
use crate::controller::BitRate;
use crate::outcome::Outcome;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::cob_id::NodeId;
use crate::wire::lss::{Address, Answer, Bound, FastScan, LssNodeId, Part, Request, SUCCESS};

/// The bit timing table of CiA 305. Other tables are not supported.
const CIA_TABLE: u8 = 0;

/// The LSS state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum State {
    /// The slave waits for its selection.
    #[default]
    Waiting,
    /// The slave is selected and can be configured.
    Configuration,
}

/// The effect on a pending node ID when the slave switches to LSS waiting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OnWaiting {
    /// The device restarts with the new node ID, as after reset application.
    Restart,
    /// A device without a node ID boots with the pending node ID once the memory holds this node ID (CiA 305). In all
    /// other cases the pending node ID takes effect at reset communication.
    Boot,
}

/// A product's rules for LSS.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// The bit rates that can be configured.
    pub(crate) bit_rates: &'static [BitRate],
    /// The states in which the slave answers identify remote slave.
    pub(crate) remote_in: &'static [State],
    /// The states in which a slave without a node ID answers identify non-configured remote slave.
    pub(crate) non_configured_in: &'static [State],
    /// The states in which a slave without a node ID answers fast scan.
    pub(crate) fast_scan_in: &'static [State],
    /// Whether a slave that a fast scan has found enters configuration.
    pub(crate) fast_scan_selects: bool,
    /// Whether the node ID 255 can be configured, which removes the node ID.
    pub(crate) can_remove_node_id: bool,
    /// The effect on a pending node ID when the slave switches to LSS waiting.
    pub(crate) on_waiting: OnWaiting,
    /// Whether NMT start drops the pending configuration.
    pub(crate) start_drops_pending: bool,
    /// The error code for a node ID out of range.
    pub(crate) node_id_error: u8,
    /// The error code for an unsupported bit rate.
    pub(crate) bit_rate_error: u8,
    /// The error code for a failed memory write.
    pub(crate) store_error: u8,
}

/// The identity of the device, for answers to LSS requests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Identity<'a> {
    /// The LSS address.
    pub(crate) address: &'a Address,
    /// The node ID in force.
    pub(crate) node_id: Option<NodeId>,
    /// The bit rate in force.
    pub(crate) bit_rate: BitRate,
}

/// An action that a request demands of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Demand {
    /// Store the present value of [`LssSlave::unstored`], then send [`Answer::Stored`].
    Store,
    /// Restart as after reset application, with this node ID.
    Restart(LssNodeId),
    /// Boot with the pending node ID, as after reset communication.
    Boot,
}

/// A node ID and a bit rate; `None` for a value that is not configured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Configuration {
    /// The node ID.
    pub(crate) node_id: Option<LssNodeId>,
    /// The bit rate.
    pub(crate) bit_rate: Option<BitRate>,
}

impl Configuration {
    /// Nothing configured.
    pub(crate) const NONE: Self = Self { node_id: None, bit_rate: None };

    /// Returns the configuration with its missing values taken from `other`.
    #[must_use]
    pub(crate) fn or(self, other: Self) -> Self {
        Self { node_id: self.node_id.or(other.node_id), bit_rate: self.bit_rate.or(other.bit_rate) }
    }
}

/// A node ID and a bit rate, stored or in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layer {
    /// The node ID.
    pub(crate) node_id: LssNodeId,
    /// The bit rate.
    pub(crate) bit_rate: BitRate,
}

impl Layer {
    /// Returns the layer with the values of `change`.
    #[must_use]
    pub(crate) fn with(self, change: Configuration) -> Self {
        Self { node_id: change.node_id.unwrap_or(self.node_id), bit_rate: change.bit_rate.unwrap_or(self.bit_rate) }
    }

    /// Converts the layer to a complete configuration.
    #[must_use]
    pub(crate) const fn configuration(self) -> Configuration {
        Configuration { node_id: Some(self.node_id), bit_rate: Some(self.bit_rate) }
    }

    /// Encodes the node ID, 255 for none, and the table index of the bit rate.
    #[must_use]
    pub(crate) fn encode(self) -> [u8; 2] {
        [self.node_id.get(), self.bit_rate.table_index()]
    }

    /// Decodes a layer. Returns `None` for a wrong length, a reserved node ID or an unknown bit rate.
    #[must_use]
    pub(crate) fn decode(payload: &[u8]) -> Option<Self> {
        let &[node_id, bit_rate] = payload else { return None };
        Some(Self { node_id: LssNodeId::new(node_id)?, bit_rate: BitRate::from_table_index(bit_rate)? })
    }
}

/// The activation of a bit rate, with the same delay before and after the switch.
#[derive(Clone, Copy, Debug)]
struct Activation {
    switch_at: Instant,
    end_at: Instant,
    /// The pending switch; `None` after the switch, and after reset application.
    switch_to: Option<Switch>,
}

/// The bit rate that an activation puts in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Switch {
    /// The bit rate.
    pub(crate) bit_rate: BitRate,
    /// Whether LSS has configured the bit rate without storing it.
    pub(crate) unstored: bool,
}

/// The LSS slave of a node.
#[derive(Clone, Debug)]
pub(crate) struct LssSlave {
    state: State,
    /// The count of matching numbers in the present sequence of switch state selective.
    matched: Part,
    /// The count of bounds met in the present sequence of identify remote slave.
    bounds: u8,
    scan: ScanPosition,
    /// The configured values. A node ID that has taken effect is removed.
    pending: Configuration,
    /// The configuration that is not yet stored.
    unstored: Configuration,
    activation: Option<Activation>,
}

impl LssSlave {
    /// Creates a slave in waiting, with nothing configured.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self {
            state: State::Waiting,
            matched: 0,
            bounds: 0,
            scan: ScanPosition::new(),
            pending: Configuration::NONE,
            unstored: Configuration::NONE,
            activation: None,
        }
    }

    /// Handles a request. The NMT state must permit LSS. Requests during a bit-rate activation are ignored.
    pub(crate) fn handle(
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
            (Request::SwitchGlobal { mode: 0 }, _) => self.leave(identity, rules.on_waiting),
            (Request::SwitchGlobal { mode: 1 }, _) => {
                self.state = State::Configuration;
                Outcome::Nothing
            }
            (Request::SwitchSelective(part, number), State::Waiting) => self.select(part, number, identity.address),
            (Request::IdentifyRemote(bound, limit), state) if rules.remote_in.contains(&state) => {
                self.identify_remote(bound, limit, identity.address)
            }
            (Request::IdentifyNonConfigured, state) if rules.non_configured_in.contains(&state) => {
                if self.is_configured(identity) { Outcome::Nothing } else { Outcome::Done(Answer::NonConfigured) }
            }
            (Request::FastScan(scan), state) if rules.fast_scan_in.contains(&state) => {
                self.scan(scan, identity, rules.fast_scan_selects)
            }
            (_, State::Waiting) => Outcome::Nothing,
            (request, State::Configuration) => self.configure(request, identity, rules, now),
        }
    }

    /// Handles NMT start: enters waiting and, with [`Rules::start_drops_pending`], drops the configuration.
    pub(crate) fn start(&mut self, rules: &Rules) {
        if rules.start_drops_pending {
            self.end_configuration();
        } else {
            self.state = State::Waiting;
            self.matched = 0;
            self.bounds = 0;
        }
    }

    /// Enters waiting and drops the configuration. A bit-rate activation continues.
    pub(crate) fn end_configuration(&mut self) {
        let activation = self.activation;
        *self = Self { activation, ..Self::new() };
    }

    /// Resets the slave, for reset application. A running bit-rate activation keeps the node silent, but no longer
    /// changes the bit rate.
    pub(crate) fn restart(&mut self) {
        self.end_configuration();
        if let Some(activation) = &mut self.activation {
            activation.switch_to = None;
        }
    }

    /// Returns the configured node ID that is not yet in force.
    #[must_use]
    pub(crate) const fn pending_node_id(&self) -> Option<LssNodeId> {
        self.pending.node_id
    }

    /// Returns the configuration that is not yet stored.
    #[must_use]
    pub(crate) const fn unstored(&self) -> Configuration {
        self.unstored
    }

    /// Records the configuration that the memory now holds. A pending value that another service has overwritten in the
    /// memory counts as unstored again.
    pub(crate) fn stored(&mut self, stored: Configuration) {
        let Self { pending, unstored, .. } = self;
        if let Some(stored) = stored.node_id {
            unstored.node_id = pending.node_id.or(unstored.node_id).filter(|node_id| *node_id != stored);
        }
        if let Some(stored) = stored.bit_rate {
            unstored.bit_rate = pending.bit_rate.or(unstored.bit_rate).filter(|bit_rate| *bit_rate != stored);
        }
    }

    /// Returns whether the device must boot (CiA 305, transition 4): the slave is in waiting, no node ID is in force,
    /// and the pending node ID is stored.
    #[must_use]
    pub(crate) fn must_boot(&self, node_id: Option<NodeId>) -> bool {
        let stored = self.pending.node_id.filter(|_| self.unstored.node_id.is_none());
        let has_new = node_id.is_none() && stored.is_some_and(|stored| stored.0.is_some());
        has_new && self.state == State::Waiting
    }

    /// Handles the delays of a bit-rate activation. Returns the new bit rate at the end of the first delay.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Switch> {
        let activation = self.activation.as_mut()?;
        let switched = if now >= activation.switch_at { activation.switch_to.take() } else { None };
        if now >= activation.end_at {
            self.activation = None;
        }
        switched
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) const fn deadline(&self) -> Instant {
        match &self.activation {
            None => NEVER,
            Some(Activation { switch_to: Some(_), switch_at, .. }) => *switch_at,
            Some(Activation { end_at, .. }) => *end_at,
        }
    }

    /// Returns whether the node must be silent because the bit rate is changing.
    #[inline]
    #[must_use]
    pub(crate) const fn is_silent(&self) -> bool {
        self.activation.is_some()
    }

    fn leave(&mut self, identity: Identity<'_>, on_waiting: OnWaiting) -> Outcome<Answer, Demand> {
        self.matched = 0;
        self.bounds = 0;
        self.state = State::Waiting;
        match on_waiting {
            OnWaiting::Restart => match self.pending.node_id.take().filter(|pending| pending.0 != identity.node_id) {
                Some(pending) => Outcome::Demand(Demand::Restart(pending)),
                None => Outcome::Nothing,
            },
            OnWaiting::Boot if self.must_boot(identity.node_id) => Outcome::Demand(Demand::Boot),
            OnWaiting::Boot => Outcome::Nothing,
        }
    }

    /// Handles one of the four numbers of switch state selective. A number that does not match, or is out of order,
    /// resets the sequence.
    fn select(&mut self, part: Part, number: u32, address: &Address) -> Outcome<Answer, Demand> {
        let expected = part == 0 || part == self.matched;
        self.matched = if expected && address.part(part) == Some(number) { part.saturating_add(1) } else { 0 };
        if self.matched <= 3 {
            return Outcome::Nothing;
        }
        self.state = State::Configuration;
        Outcome::Done(Answer::Selected)
    }

    /// Handles one of the six bounds of identify remote slave. A bound that does not hold, or is out of order, resets
    /// the sequence.
    fn identify_remote(&mut self, bound: Bound, limit: u32, address: &Address) -> Outcome<Answer, Demand> {
        let [first, .., last] = Bound::ALL;
        let expected = bound == first || Bound::ALL.get(usize::from(self.bounds)) == Some(&bound);
        let held = expected && bound.holds(limit, address);
        self.bounds = match (held, bound == first) {
            (false, _) => 0,
            (true, true) => 1,
            (true, false) => self.bounds.saturating_add(1),
        };
        if held && bound == last { Outcome::Done(Answer::Identified) } else { Outcome::Nothing }
    }

    /// Handles a fast scan request. Slaves with a node ID ignore it.
    fn scan(&mut self, scan: FastScan, identity: Identity<'_>, selects: bool) -> Outcome<Answer, Demand> {
        if self.is_configured(identity) || !self.scan.answers(scan, identity.address) {
            return Outcome::Nothing;
        }
        if selects && scan.is_last() {
            self.state = State::Configuration;
        }
        Outcome::Done(Answer::Identified)
    }

    /// Returns whether the slave has a node ID, in force or pending (R).
    fn is_configured(&self, identity: Identity<'_>) -> bool {
        identity.node_id.or(self.pending.node_id.and_then(|pending| pending.0)).is_some()
    }

    fn configure(
        &mut self,
        request: Request,
        identity: Identity<'_>,
        rules: &Rules,
        now: Instant,
    ) -> Outcome<Answer, Demand> {
        Outcome::Done(match request {
            Request::ConfigureNodeId(raw) => {
                match LssNodeId::new(raw).filter(|node_id| node_id.0.is_some() || rules.can_remove_node_id) {
                    Some(node_id) => {
                        self.pending.node_id = Some(node_id);
                        self.unstored.node_id = Some(node_id);
                        Answer::NodeId(SUCCESS)
                    }
                    None => Answer::NodeId(rules.node_id_error),
                }
            }
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
                let switch_at = delayed(now, delay);
                let pending = self.pending.bit_rate;
                let unstored = pending.is_some() && pending == self.unstored.bit_rate;
                let switch = Switch { bit_rate: pending.unwrap_or(identity.bit_rate), unstored };
                self.activation =
                    Some(Activation { switch_at, end_at: delayed(switch_at, delay), switch_to: Some(switch) });
                return Outcome::Nothing;
            }
            Request::Store => return Outcome::Demand(Demand::Store),
            Request::InquireIdentity(part) => Answer::Identity(part, identity.address.part(part).unwrap_or(0)),
            Request::InquireNodeId => Answer::InquiredNodeId(LssNodeId(identity.node_id).get()),
            _ => return Outcome::Nothing,
        })
    }
}
