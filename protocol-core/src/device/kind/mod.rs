//! Every product (SPEC 1), and what a device of one is made as.

pub(super) mod hat;
pub(super) mod pve;

use core::fmt;
use core::ops::RangeInclusive;

use super::hat::Error;
use super::view::FAULTS;
use crate::actuator::Fault;
use crate::controller::BitRate;

/// A product.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A valve actuator.
    Pve(pve::Kind),
    /// An angle sensor.
    Hat(hat::Kind),
}

/// The protocol that a product speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// CiA 301 and 305, with a device profile.
    Canopen,
    /// ISO 11783-7, J1939.
    Isobus,
}

impl Kind {
    /// All of them, in the order in which they are listed to the user.
    pub const ALL: [Self; 6] = [
        Self::Pve(pve::Kind::PveaCanopen),
        Self::Pve(pve::Kind::PveoCanopen),
        Self::Pve(pve::Kind::PveaIsobus),
        Self::Pve(pve::Kind::PveoIsobus),
        Self::Hat(hat::Kind::Hat1000),
        Self::Hat(hat::Kind::Hat3000),
    ];

    /// Returns the name used everywhere.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pve(kind) => kind.name(),
            Self::Hat(kind) => kind.name(),
        }
    }

    /// Returns the kind of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns the protocol. A device on CANopen can be without a node ID.
    #[must_use]
    pub const fn protocol(self) -> Protocol {
        match self {
            Self::Pve(kind) => kind.protocol(),
            Self::Hat(_) => Protocol::Canopen,
        }
    }

    /// Returns the names of the faults that it tells of, in the order of [`View::faults`](super::View::faults).
    #[must_use]
    pub fn fault_names(self) -> heapless::Vec<&'static str, FAULTS> {
        match self {
            Self::Pve(_) => Fault::ALL.into_iter().map(Fault::name).collect(),
            Self::Hat(_) => Error::ALL.into_iter().map(Error::name).collect(),
        }
    }

    /// Returns the node IDs, on ISOBUS addresses, that it can have.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        match self {
            Self::Pve(kind) => kind.node_ids(),
            Self::Hat(kind) => kind.node_ids(),
        }
    }

    /// Returns the node ID that it leaves the factory with.
    #[must_use]
    pub const fn default_node_id(self) -> u8 {
        match self {
            Self::Pve(kind) => kind.default_node_id(),
            Self::Hat(kind) => kind.default_node_id(),
        }
    }

    /// Returns the serial number that it leaves the factory with.
    #[must_use]
    pub const fn default_serial(self) -> u32 {
        match self {
            Self::Pve(kind) => kind.default_serial(),
            Self::Hat(kind) => kind.default_serial(),
        }
    }

    /// Returns the bit rates that it can run at, the default first.
    #[must_use]
    pub const fn bit_rates(self) -> &'static [BitRate] {
        match self {
            Self::Pve(kind) => kind.bit_rates(),
            Self::Hat(kind) => kind.bit_rates(),
        }
    }
}

/// What a device is made as. Node ID and serial number fill a new memory; one that holds them decides by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup<K = Kind> {
    /// The product.
    pub kind: K,
    /// The node ID, on ISOBUS the address, of a new memory. One that the product cannot have counts as `None`: on
    /// CANopen a device that leaves the factory blank, on ISOBUS the default.
    pub node_id: Option<u8>,
    /// The serial number of a new memory; `None` for the product's.
    pub serial: Option<u32>,
    /// The bit rate of a new memory; `None`, or one that the product cannot run at, for its default.
    pub bit_rate: Option<BitRate>,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Setup {
    /// Returns a device of this kind with the default node ID and serial number.
    #[must_use]
    pub const fn new(kind: Kind) -> Self {
        Self { kind, node_id: Some(kind.default_node_id()), serial: None, bit_rate: None }
    }

    /// Returns the same setup of another type of kind.
    #[must_use]
    pub fn with_kind<K>(self, kind: K) -> Setup<K> {
        Setup { kind, node_id: self.node_id, serial: self.serial, bit_rate: self.bit_rate }
    }
}

impl Setup<pve::Kind> {
    /// Returns a valve of this kind with the default node ID and serial number.
    #[must_use]
    pub const fn new(kind: pve::Kind) -> Self {
        Self { kind, node_id: Some(kind.default_node_id()), serial: None, bit_rate: None }
    }
}

impl Setup<hat::Kind> {
    /// Returns a sensor of this kind with the default node ID and serial number.
    #[must_use]
    pub const fn new(kind: hat::Kind) -> Self {
        Self { kind, node_id: Some(kind.default_node_id()), serial: None, bit_rate: None }
    }
}

impl From<Setup<pve::Kind>> for Setup {
    fn from(setup: Setup<pve::Kind>) -> Self {
        Self { kind: Kind::Pve(setup.kind), node_id: setup.node_id, serial: setup.serial, bit_rate: setup.bit_rate }
    }
}

impl From<Setup<hat::Kind>> for Setup {
    fn from(setup: Setup<hat::Kind>) -> Self {
        Self { kind: Kind::Hat(setup.kind), node_id: setup.node_id, serial: setup.serial, bit_rate: setup.bit_rate }
    }
}

impl From<pve::Kind> for Kind {
    fn from(kind: pve::Kind) -> Self {
        Self::Pve(kind)
    }
}

impl From<hat::Kind> for Kind {
    fn from(kind: hat::Kind) -> Self {
        Self::Hat(kind)
    }
}

/// A device as it leaves the factory.
impl<K: Into<Kind>> From<K> for Setup {
    fn from(kind: K) -> Self {
        Self::new(kind.into())
    }
}
