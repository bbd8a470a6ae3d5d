//! The valve actuators (SPEC 1).

use core::ops::RangeInclusive;

use crate::actuator::ActuatorType;
use crate::controller::BitRate;
use crate::device::Protocol;

/// A valve actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// PVEA-CI on CANopen, proportional.
    PveaCanopen,
    /// PVEO-CI on CANopen, on/off.
    PveoCanopen,
    /// PVEA-CI on ISOBUS, proportional.
    PveaIsobus,
    /// PVEO-CI on ISOBUS, on/off.
    PveoIsobus,
}

impl Kind {
    /// All PVE kinds.
    pub const ALL: [Self; 4] = [Self::PveaCanopen, Self::PveoCanopen, Self::PveaIsobus, Self::PveoIsobus];

    /// Returns the name of the kind, which all interfaces use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PveaCanopen => "pvea-canopen",
            Self::PveoCanopen => "pveo-canopen",
            Self::PveaIsobus => "pvea-isobus",
            Self::PveoIsobus => "pveo-isobus",
        }
    }

    /// Returns the kind with this name; `None` for an unknown name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns the part number.
    #[must_use]
    pub const fn part_number(self) -> u32 {
        match self {
            Self::PveaCanopen => 11_149_437,
            Self::PveoCanopen => 11_149_443,
            Self::PveaIsobus => 11_121_945,
            Self::PveoIsobus => 11_124_002,
        }
    }

    /// Returns the protocol.
    #[must_use]
    pub const fn protocol(self) -> Protocol {
        match self {
            Self::PveaCanopen | Self::PveoCanopen => Protocol::Canopen,
            Self::PveaIsobus | Self::PveoIsobus => Protocol::Isobus,
        }
    }

    /// Returns the permitted node IDs; on ISOBUS the permitted addresses.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        match self.protocol() {
            Protocol::Canopen => 0x01..=0x7F,
            Protocol::Isobus => 0x80..=0x8F,
        }
    }

    /// Returns the node ID of a new valve; on ISOBUS the address (A).
    #[must_use]
    pub const fn default_node_id(self) -> u8 {
        match self.protocol() {
            Protocol::Canopen => 0x20,
            Protocol::Isobus => 0x80,
        }
    }

    /// Returns the serial number in the examples of the manual. On ISOBUS it is the identity number of the NAME.
    #[must_use]
    pub const fn default_serial(self) -> u32 {
        match self.protocol() {
            Protocol::Canopen => 0x5B2E_0100,
            Protocol::Isobus => 1,
        }
    }

    /// Returns the supported bit rates, the default first.
    #[must_use]
    pub const fn bit_rates(self) -> &'static [BitRate] {
        match self.protocol() {
            Protocol::Canopen => &[BitRate::Kbit250, BitRate::Kbit125, BitRate::Kbit500],
            Protocol::Isobus => &[BitRate::Kbit250],
        }
    }

    /// Returns the type of actuator.
    #[must_use]
    pub const fn actuator_type(self) -> ActuatorType {
        match self {
            Self::PveaCanopen | Self::PveaIsobus => ActuatorType::Proportional,
            Self::PveoCanopen | Self::PveoIsobus => ActuatorType::OnOff,
        }
    }
}
