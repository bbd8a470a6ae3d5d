//! The angle sensors (SPEC 1, 9).

use core::ops::RangeInclusive;

use crate::controller::BitRate;

/// An angle sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// HAT 1000
    Hat1000,
    /// HAT 3000
    Hat3000,
}

impl Kind {
    /// All HAT kinds.
    pub const ALL: [Self; 2] = [Self::Hat1000, Self::Hat3000];

    /// Returns the name of the kind, which all interfaces use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hat1000 => "hat1000",
            Self::Hat3000 => "hat3000",
        }
    }

    /// Returns the device name, object 0x1008.
    #[must_use]
    pub const fn device_name(self) -> &'static str {
        match self {
            Self::Hat1000 => "HAT 1000",
            Self::Hat3000 => "HAT 3000",
        }
    }

    /// Returns the product code, which equals the part number. The code of the HAT 3000 is an assumption (A).
    #[must_use]
    pub const fn product_code(self) -> u32 {
        match self {
            Self::Hat1000 => 925_010,
            Self::Hat3000 => 925_011,
        }
    }

    /// Returns the permitted node IDs.
    #[must_use]
    pub const fn node_ids(self) -> RangeInclusive<u8> {
        1..=127
    }

    /// Returns the node ID of a new sensor.
    #[must_use]
    pub const fn default_node_id(self) -> u8 {
        1
    }

    /// Returns the serial number of a new sensor (A).
    #[must_use]
    pub const fn default_serial(self) -> u32 {
        1
    }

    /// Returns the supported bit rates, the default first.
    #[must_use]
    pub const fn bit_rates(self) -> &'static [BitRate] {
        use BitRate::{Kbit10, Kbit20, Kbit50, Kbit125, Kbit250, Kbit500, Kbit800, Kbit1000};
        &[Kbit500, Kbit10, Kbit20, Kbit50, Kbit125, Kbit250, Kbit800, Kbit1000]
    }
}
