//! The products (SPEC 1).

use crate::actuator::Regulation;
use crate::controller::BitRate;

/// A valve on CANopen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// PVEA-CI: proportional.
    PveaCanopen,
    /// PVEO-CI: on/off.
    PveoCanopen,
}

/// The bit rates of the CANopen kinds, the default first.
pub(super) const BIT_RATES: &[BitRate] = &[BitRate::Kbit250, BitRate::Kbit125, BitRate::Kbit500];

/// The default node ID of the CANopen kinds.
pub(super) const DEFAULT_NODE_ID: u8 = 0x20;

impl Kind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::PveaCanopen, Self::PveoCanopen];

    /// The name used everywhere.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PveaCanopen => "pvea-canopen",
            Self::PveoCanopen => "pveo-canopen",
        }
    }

    /// The kind of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The part number.
    #[must_use]
    pub const fn part_number(self) -> u32 {
        match self {
            Self::PveaCanopen => 11_149_437,
            Self::PveoCanopen => 11_149_443,
        }
    }

    /// Object 0x100A: version 132, the part number, release 000 (A), firmware date 180701 (A).
    #[must_use]
    pub const fn software_version(self) -> &'static str {
        match self {
            Self::PveaCanopen => "APP-_S6m1_M_R132_CANOPEN-_11149437_-000_ 180701",
            Self::PveoCanopen => "APP-_S6m1_M_R132_CANOPEN-_11149443_-000_ 180701",
        }
    }

    /// The default of object 0x6053.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::PveaCanopen => "PVEA-CI S6",
            Self::PveoCanopen => "PVEO-CI S6",
        }
    }

    pub(super) const fn regulation(self) -> Regulation {
        match self {
            Self::PveaCanopen => Regulation::Proportional,
            Self::PveoCanopen => Regulation::OnOff,
        }
    }
}
