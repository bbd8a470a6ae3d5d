//! All products (SPEC 1), and the setup of a device.

pub(super) mod hat;
pub(super) mod pve;

use core::fmt;
use core::ops::RangeInclusive;

use super::hat::Error;
use super::view::FAULTS;
use crate::actuator::Fault;
use crate::controller::BitRate;
use crate::wire::name::IDENTITY_NUMBER;

/// A product.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A valve actuator.
    Pve(pve::Kind),
    /// An angle sensor.
    Hat(hat::Kind),
}

/// The protocol of a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Protocol {
    /// CiA 301 and 305, with a device profile.
    Canopen,
    /// ISO 11783-7, J1939.
    Isobus,
}

impl Protocol {
    /// Returns the protocol's term for the address of a device: node ID or address.
    #[must_use]
    pub const fn id_name(self) -> &'static str {
        match self {
            Self::Canopen => "node ID",
            Self::Isobus => "address",
        }
    }
}

impl Kind {
    /// All kinds, in the order shown to the user.
    pub const ALL: [Self; 6] = [
        Self::Pve(pve::Kind::PveaCanopen),
        Self::Pve(pve::Kind::PveoCanopen),
        Self::Pve(pve::Kind::PveaIsobus),
        Self::Pve(pve::Kind::PveoIsobus),
        Self::Hat(hat::Kind::Hat1000),
        Self::Hat(hat::Kind::Hat3000),
    ];

    /// Returns the kind's name, the same in every interface.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pve(kind) => kind.name(),
            Self::Hat(kind) => kind.name(),
        }
    }

    /// Returns the kind with this name; `None` for an unknown name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns the number of the kind in stored memories; numbers start at 1 and never change.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Pve(pve::Kind::PveaCanopen) => 1,
            Self::Pve(pve::Kind::PveoCanopen) => 2,
            Self::Pve(pve::Kind::PveaIsobus) => 3,
            Self::Pve(pve::Kind::PveoIsobus) => 4,
            Self::Hat(hat::Kind::Hat1000) => 5,
            Self::Hat(hat::Kind::Hat3000) => 6,
        }
    }

    /// Returns the kind with this number; `None` for an unknown number.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.number() == number)
    }

    /// Returns the protocol.
    #[must_use]
    pub const fn protocol(self) -> Protocol {
        match self {
            Self::Pve(kind) => kind.protocol(),
            Self::Hat(_) => Protocol::Canopen,
        }
    }

    /// Returns whether a device can be without node ID. A device on ISOBUS always has an address.
    #[must_use]
    pub const fn can_be_blank(self) -> bool {
        matches!(self.protocol(), Protocol::Canopen)
    }

    /// Returns the number that distinguishes a device on the bus: on CANopen the serial number, part of the LSS
    /// address; on ISOBUS its low 21 bits, the identity number of the NAME (SPEC 1).
    #[must_use]
    pub const fn known_by(self, serial: u32) -> (Protocol, u32) {
        match self.protocol() {
            Protocol::Canopen => (Protocol::Canopen, serial),
            Protocol::Isobus => (Protocol::Isobus, serial & IDENTITY_NUMBER),
        }
    }

    /// Returns the names of the reported faults, in the order of [`View::faults`](super::View::faults).
    #[must_use]
    pub fn fault_names(self) -> heapless::Vec<&'static str, FAULTS> {
        match self {
            Self::Pve(_) => Fault::ALL.into_iter().map(Fault::name).collect(),
            Self::Hat(_) => Error::ALL.into_iter().map(Error::name).collect(),
        }
    }

    /// Returns the permitted node IDs, on ISOBUS addresses.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        match self {
            Self::Pve(kind) => kind.node_ids(),
            Self::Hat(kind) => kind.node_ids(),
        }
    }

    /// Returns the node ID or address as delivered.
    #[must_use]
    pub const fn default_node_id(self) -> u8 {
        match self {
            Self::Pve(kind) => kind.default_node_id(),
            Self::Hat(kind) => kind.default_node_id(),
        }
    }

    /// Returns the serial number as delivered.
    #[must_use]
    pub const fn default_serial(self) -> u32 {
        match self {
            Self::Pve(kind) => kind.default_serial(),
            Self::Hat(kind) => kind.default_serial(),
        }
    }

    /// Returns the supported bit rates, the default first.
    #[must_use]
    pub const fn bit_rates(self) -> &'static [BitRate] {
        match self {
            Self::Pve(kind) => kind.bit_rates(),
            Self::Hat(kind) => kind.bit_rates(),
        }
    }
}

/// The setup of a device. The node ID, serial number and bit rate apply to a new memory; an existing memory takes
/// precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup<K = Kind> {
    /// The product.
    pub kind: K,
    /// The node ID, on ISOBUS the address, of a new memory. A value that the product does not permit counts as `None`:
    /// on CANopen no node ID, on ISOBUS the default address.
    pub node_id: Option<u8>,
    /// The serial number of a new memory; `None` for the product's default.
    pub serial: Option<u32>,
    /// The bit rate of a new memory. `None` or an unsupported bit rate selects the product's default.
    pub bit_rate: Option<BitRate>,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Setup {
    /// Returns the setup of this kind with the default node ID and serial number.
    #[must_use]
    pub const fn new(kind: Kind) -> Self {
        Self { kind, node_id: Some(kind.default_node_id()), serial: None, bit_rate: None }
    }

    /// Converts the setup to another type of kind.
    #[must_use]
    pub fn with_kind<K>(self, kind: K) -> Setup<K> {
        Setup { kind, node_id: self.node_id, serial: self.serial, bit_rate: self.bit_rate }
    }
}

impl Setup<pve::Kind> {
    /// Returns the setup of this valve with the default node ID and serial number.
    #[must_use]
    pub const fn new(kind: pve::Kind) -> Self {
        Self { kind, node_id: Some(kind.default_node_id()), serial: None, bit_rate: None }
    }
}

impl Setup<hat::Kind> {
    /// Returns the setup of this sensor with the default node ID and serial number.
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

/// The setup of a device as delivered.
impl<K: Into<Kind>> From<K> for Setup {
    fn from(kind: K) -> Self {
        Self::new(kind.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_memories_have_them() {
        let names = [1, 2, 3, 4, 5, 6].map(|number| Kind::from_number(number).map(Kind::name));
        let stored = ["pvea-canopen", "pveo-canopen", "pvea-isobus", "pveo-isobus", "hat1000", "hat3000"];
        assert_eq!(names, stored.map(Some));
        assert_eq!([0, 7, 255].map(Kind::from_number), [None; 3]);
    }
}
