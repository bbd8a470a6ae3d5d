//! The products (SPEC 1), and the setup of a device.

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
    /// Returns the protocol's term for the number of a device: node ID or address.
    #[must_use]
    pub const fn id_name(self) -> &'static str {
        match self {
            Self::Canopen => "node ID",
            Self::Isobus => "address",
        }
    }
}

impl Kind {
    /// All kinds, in the order in which users see them.
    pub const ALL: [Self; 6] = [
        Self::Pve(pve::Kind::PveaCanopen),
        Self::Pve(pve::Kind::PveoCanopen),
        Self::Pve(pve::Kind::PveaIsobus),
        Self::Pve(pve::Kind::PveoIsobus),
        Self::Hat(hat::Kind::Hat1000),
        Self::Hat(hat::Kind::Hat3000),
    ];

    /// Returns the name of the kind, which all interfaces use.
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

    /// Returns the number of the kind in stored memories. The numbers start at 1 and never change.
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

    /// Returns whether a device can lack a node ID. A device on ISOBUS always has an address.
    #[must_use]
    pub const fn can_be_blank(self) -> bool {
        matches!(self.protocol(), Protocol::Canopen)
    }

    /// Returns the number that must be unique on a bus, with its protocol. On CANopen it is the serial number, a part
    /// of the LSS address. On ISOBUS it is the low 21 bits of the serial number, the identity number of the NAME (SPEC
    /// 1).
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

    /// Returns the permitted node IDs; on ISOBUS the permitted addresses.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        match self {
            Self::Pve(kind) => kind.node_ids(),
            Self::Hat(kind) => kind.node_ids(),
        }
    }

    /// Returns the node ID or address of a new device.
    #[must_use]
    pub const fn default_node_id(self) -> u8 {
        match self {
            Self::Pve(kind) => kind.default_node_id(),
            Self::Hat(kind) => kind.default_node_id(),
        }
    }

    /// Returns the serial number of a new device.
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

/// The setup of a device. Node ID, serial number and bit rate fill a new memory. An existing memory keeps its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup<K = Kind> {
    /// The product.
    pub kind: K,
    /// The node ID of a new memory; on ISOBUS the address. A value that the product does not permit counts as `None`:
    /// no node ID on CANopen, the default address on ISOBUS.
    pub node_id: Option<u8>,
    /// The serial number of a new memory; `None` for the default of the product.
    pub serial: Option<u32>,
    /// The bit rate of a new memory. `None` and an unsupported rate mean the default of the product.
    pub bit_rate: Option<BitRate>,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl<K: Copy + Into<Kind>> Setup<K> {
    /// Returns the setup of a device with the default node ID, serial number and bit rate of its kind.
    #[must_use]
    pub fn new(kind: K) -> Self {
        Self { kind, node_id: Some(kind.into().default_node_id()), serial: None, bit_rate: None }
    }
}

impl<K> Setup<K> {
    /// Returns the setup with another type of kind.
    #[must_use]
    pub fn with_kind<L>(self, kind: L) -> Setup<L> {
        Setup { kind, node_id: self.node_id, serial: self.serial, bit_rate: self.bit_rate }
    }
}

impl From<Setup<pve::Kind>> for Setup {
    fn from(setup: Setup<pve::Kind>) -> Self {
        setup.with_kind(setup.kind.into())
    }
}

impl From<Setup<hat::Kind>> for Setup {
    fn from(setup: Setup<hat::Kind>) -> Self {
        setup.with_kind(setup.kind.into())
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

/// Creates the setup of a device as delivered.
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
