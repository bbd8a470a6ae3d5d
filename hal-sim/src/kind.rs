//! The kinds of devices that can be put on the bus, by the name that is used everywhere (SPEC 1).

use std::fmt;
use std::ops::RangeInclusive;

/// A product that the simulator stands in for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// The proportional valve on CANopen.
    PveaCanopen,
    /// The on/off valve on CANopen.
    PveoCanopen,
}

impl Kind {
    /// Every kind there is, in the order in which they are listed to the user.
    pub const ALL: [Self; 2] = [Self::PveaCanopen, Self::PveoCanopen];

    /// The name: in options, in state files, as default name of a device.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PveaCanopen => "pvea-canopen",
            Self::PveoCanopen => "pveo-canopen",
        }
    }

    /// The kind of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The node IDs that a device of this kind can have.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        match self {
            Self::PveaCanopen | Self::PveoCanopen => 0x01..=0x7F,
        }
    }

    /// The node ID that it leaves the factory with.
    #[must_use]
    pub const fn default_node_id(self) -> u8 {
        match self {
            Self::PveaCanopen | Self::PveoCanopen => 0x20,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
