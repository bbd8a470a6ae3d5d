//! The kinds of devices that can be put on the bus, by the name that is used everywhere (SPEC 1), and how each is
//! built.

use protocol_core::controller::BitRate;
pub use protocol_core::device::Kind;
use protocol_core::device::hat::Hat;
use protocol_core::device::pve::{self, PveCanopen, PveIsobus};
use protocol_core::device::{Protocol, Setup, StartCause, hat};
use protocol_core::memory::Image;
use protocol_core::time::Instant;

use crate::world::SimDevice;

/// What a new memory is filled with; an existing one decides for itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Birth {
    /// The node ID; `None`: blank from the factory, to be found by LSS.
    pub node_id: Option<u8>,
    /// The serial number; `None`: the kind's.
    pub serial: Option<u32>,
    /// The bit rate; `None`: the kind's.
    pub bit_rate: Option<BitRate>,
}

impl Birth {
    /// Returns how a device of this kind is made with it.
    #[must_use]
    pub const fn of(self, kind: Kind) -> Setup {
        let Self { node_id, serial, bit_rate } = self;
        Setup { kind, node_id, serial, bit_rate }
    }
}

/// What the simulator knows of a [`Kind`].
pub trait Simulated: Sized {
    /// Returns the number that state files carry.
    fn number(self) -> u32;

    /// Returns the kind of a number in a state file.
    fn from_number(number: u32) -> Option<Self>;

    /// Returns what its standard calls the number in its identifiers.
    fn id_name(self) -> &'static str;

    /// Returns whether it can be without a node ID. A device on ISOBUS always has an address.
    fn can_be_blank(self) -> bool;

    /// Returns the number that distinguishes a device on the bus: on CANopen the whole serial number, a part of the LSS
    /// address; on ISOBUS its low 21 bits, the identity number of the NAME (SPEC 1).
    fn known_by(self, serial: u32) -> (Protocol, u32);

    /// Returns a device as it leaves the factory.
    fn default_birth(self) -> Birth;

    /// Returns what builds such a device from its memory at each start.
    fn factory(self, birth: Birth) -> impl FnMut(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + 'static;
}

impl Simulated for Kind {
    fn number(self) -> u32 {
        match self {
            Self::Pve(pve::Kind::PveaCanopen) => 1,
            Self::Pve(pve::Kind::PveoCanopen) => 2,
            Self::Pve(pve::Kind::PveaIsobus) => 3,
            Self::Pve(pve::Kind::PveoIsobus) => 4,
            Self::Hat(hat::Kind::Hat1000) => 5,
            Self::Hat(hat::Kind::Hat3000) => 6,
        }
    }

    fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.number() == number)
    }

    fn id_name(self) -> &'static str {
        match self.protocol() {
            Protocol::Canopen => "node ID",
            Protocol::Isobus => "address",
        }
    }

    fn can_be_blank(self) -> bool {
        self.protocol() == Protocol::Canopen
    }

    fn known_by(self, serial: u32) -> (Protocol, u32) {
        const IDENTITY_NUMBER: u32 = 0x001F_FFFF;
        match self.protocol() {
            Protocol::Canopen => (Protocol::Canopen, serial),
            Protocol::Isobus => (Protocol::Isobus, serial & IDENTITY_NUMBER),
        }
    }

    fn default_birth(self) -> Birth {
        let Setup { node_id, serial, bit_rate, .. } = Setup::<Self>::new(self);
        Birth { node_id, serial, bit_rate }
    }

    fn factory(self, birth: Birth) -> impl FnMut(&Image, StartCause, Instant) -> Box<dyn SimDevice> + Send + 'static {
        let setup = birth.of(self);
        move |image, cause, now| match self {
            Self::Pve(kind) => match kind.protocol() {
                Protocol::Canopen => Box::new(PveCanopen::power_on(setup.with_kind(kind), image, cause, now)),
                Protocol::Isobus => Box::new(PveIsobus::power_on(setup.with_kind(kind), image, cause, now)),
            },
            Self::Hat(kind) => Box::new(Hat::power_on(setup.with_kind(kind), image, cause, now)),
        }
    }
}
