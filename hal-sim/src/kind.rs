//! The kinds of devices that can be put on the bus, by the name that is used everywhere (SPEC 1), and how each is built.

use std::fmt;
use std::ops::RangeInclusive;

use protocol_core::device::StartCause;
use protocol_core::device::pve::{self, Protocol, PveCanopen, PveIsobus, Setup};
use protocol_core::memory::Image;
use protocol_core::time::Instant;

use crate::world::SimDevice;

/// A product that the simulator stands in for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// A valve actuator.
    Pve(pve::Kind),
}

/// What a new memory is filled with; an existing one decides for itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Birth {
    /// The node ID; `None`: blank from the factory, to be found by LSS.
    pub node_id: Option<u8>,
    /// The serial number; `None`: the kind's.
    pub serial: Option<u32>,
}

impl Kind {
    /// Every kind there is, in the order in which they are listed to the user.
    pub const ALL: [Self; 4] = [
        Self::Pve(pve::Kind::PveaCanopen),
        Self::Pve(pve::Kind::PveoCanopen),
        Self::Pve(pve::Kind::PveaIsobus),
        Self::Pve(pve::Kind::PveoIsobus),
    ];

    /// The name: in options, in traces, as default name of a device.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pve(kind) => kind.name(),
        }
    }

    /// The kind of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The number that state files carry.
    #[must_use]
    pub const fn number(self) -> u32 {
        match self {
            Self::Pve(pve::Kind::PveaCanopen) => 1,
            Self::Pve(pve::Kind::PveoCanopen) => 2,
            Self::Pve(pve::Kind::PveaIsobus) => 3,
            Self::Pve(pve::Kind::PveoIsobus) => 4,
        }
    }

    /// The kind of a number in a state file.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.number() == number)
    }

    /// The node IDs that a device of this kind can have.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        match self {
            Self::Pve(kind) => kind.node_ids(),
        }
    }

    /// Returns the protocol that it speaks.
    #[must_use]
    pub const fn protocol(self) -> Protocol {
        match self {
            Self::Pve(kind) => kind.protocol(),
        }
    }

    /// Returns what its standard calls the number in its identifiers.
    #[must_use]
    pub const fn id_name(self) -> &'static str {
        match self.protocol() {
            Protocol::Canopen => "node ID",
            Protocol::Isobus => "address",
        }
    }

    /// Whether it can be without a node ID. One on ISOBUS always has an address.
    #[must_use]
    pub const fn can_be_blank(self) -> bool {
        match self {
            Self::Pve(kind) => matches!(kind.protocol(), Protocol::Canopen),
        }
    }

    /// Returns the default serial number (SPEC 1).
    #[must_use]
    pub const fn default_serial(self) -> u32 {
        match self {
            Self::Pve(kind) => kind.default_serial(),
        }
    }

    /// Returns the number that distinguishes a device on the bus: on CANopen the whole serial number, a part of the LSS
    /// address; on ISOBUS its low 21 bits, the identity number of the NAME (SPEC 1).
    #[must_use]
    pub const fn known_by(self, serial: u32) -> (Protocol, u32) {
        const IDENTITY_NUMBER: u32 = 0x001F_FFFF;
        match self {
            Self::Pve(kind) => match kind.protocol() {
                Protocol::Canopen => (Protocol::Canopen, serial),
                Protocol::Isobus => (Protocol::Isobus, serial & IDENTITY_NUMBER),
            },
        }
    }

    /// As it leaves the factory.
    #[must_use]
    pub fn default_birth(self) -> Birth {
        match self {
            Self::Pve(kind) => {
                let Setup { node_id, serial, .. } = Setup::new(kind);
                Birth { node_id, serial }
            }
        }
    }

    /// What builds such a device from its memory at each start.
    pub fn factory(
        self,
        birth: Birth,
    ) -> impl FnMut(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + 'static {
        move |image, cause, now| match self {
            Self::Pve(kind) => {
                let setup = Setup { kind, node_id: birth.node_id, serial: birth.serial };
                match kind.protocol() {
                    Protocol::Canopen => Box::new(PveCanopen::power_on(setup, image, cause, now)),
                    Protocol::Isobus => Box::new(PveIsobus::power_on(setup, image, cause, now)),
                }
            }
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
