//! The CAN controller of a device: trait, filters, error mode and bit rates.
//!
//! Simulator and board share these types, so that host tests run the code of the image.

use heapless::Vec;

use crate::frame::Frame;

/// A CAN controller for the [`pump`](crate::pump::pump).
pub trait Controller: embedded_can::nb::Can<Frame = Frame> {
    /// Returns whether the controller holds an unsent frame that passes `which`. A frame on the wire is unsent.
    fn holds(&self, which: Filter) -> bool;

    /// Drops the pending transmit frames that pass `which`. A frame on the wire is not dropped, but it is not repeated
    /// after an error.
    fn abort(&mut self, which: Filter);

    /// Sets the receive filters. From now on the controller must accept data frames that pass a filter, and may reject
    /// all other frames. Frames that are already received are kept.
    fn set_filters(&mut self, filters: &Filters);
}

/// The maximum number of transmit frames in a controller.
pub const MAILBOXES: usize = 3;

/// An identifier filter. It passes a frame if the frame's key equals `key` in all bits that are set in `mask`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// The identifier key, see [`frame::key`](crate::frame::key).
    pub key: u32,
    /// The compared bits. Receive filters always compare bit 29, which marks a 29-bit identifier.
    pub mask: u32,
}

impl Filter {
    /// The filter that passes every frame.
    pub const ALL: Self = Self { key: 0, mask: 0 };

    /// Creates a filter that passes one identifier.
    #[must_use]
    pub const fn exactly(key: u32) -> Self {
        Self { key, mask: u32::MAX }
    }

    /// Returns whether a frame passes the filter.
    #[inline]
    #[must_use]
    pub const fn passes(&self, frame: &Frame) -> bool {
        (frame.key() ^ self.key) & self.mask == 0
    }
}

/// The maximum number of filters of a device.
pub const FILTERS: usize = 8;

/// The receive filters of a device.
pub type Filters = Vec<Filter, FILTERS>;

/// The error mode of a controller (ISO 11898-1, fault confinement).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusErrorMode {
    /// The controller communicates with active error flags.
    #[default]
    ErrorActive,
    /// An error counter is above 127. The controller communicates with passive error flags.
    ErrorPassive,
    /// The transmit error counter is above 255. The controller does not communicate until recovery. The platform drops
    /// the controller's pending frames before it reports bus-off to the device. These frames would be outdated after
    /// recovery.
    BusOff,
}

impl BusErrorMode {
    /// Returns the name of the mode.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ErrorActive => "error-active",
            Self::ErrorPassive => "error-passive",
            Self::BusOff => "bus-off",
        }
    }
}

/// The bit rates of CiA 301. The numbers are the indices in LSS bit timing table 0 (CiA 305).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum BitRate {
    /// 1 Mbit/s
    Kbit1000 = 0,
    /// 800 kbit/s
    Kbit800 = 1,
    /// 500 kbit/s
    Kbit500 = 2,
    /// 250 kbit/s
    Kbit250 = 3,
    /// 125 kbit/s
    Kbit125 = 4,
    /// 50 kbit/s
    Kbit50 = 6,
    /// 20 kbit/s
    Kbit20 = 7,
    /// 10 kbit/s
    Kbit10 = 8,
}

impl BitRate {
    /// All bit rates, the fastest first.
    pub const ALL: [Self; 8] = [
        Self::Kbit1000,
        Self::Kbit800,
        Self::Kbit500,
        Self::Kbit250,
        Self::Kbit125,
        Self::Kbit50,
        Self::Kbit20,
        Self::Kbit10,
    ];

    /// Returns the bit rate in bits per second.
    #[must_use]
    pub const fn bits_per_second(self) -> u32 {
        match self {
            Self::Kbit1000 => 1_000_000,
            Self::Kbit800 => 800_000,
            Self::Kbit500 => 500_000,
            Self::Kbit250 => 250_000,
            Self::Kbit125 => 125_000,
            Self::Kbit50 => 50_000,
            Self::Kbit20 => 20_000,
            Self::Kbit10 => 10_000,
        }
    }

    /// Returns the index in LSS bit timing table 0 (CiA 305).
    #[must_use]
    pub const fn table_index(self) -> u8 {
        self as u8
    }

    /// Returns the bit rate with this index in LSS bit timing table 0; `None` for the reserved index 5 and indices
    /// above 8.
    #[must_use]
    pub fn from_table_index(index: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.table_index() == index)
    }

    /// Returns the bit rate with this number of bits per second; `None` for a rate that CiA 301 does not define.
    #[must_use]
    pub fn from_bits_per_second(bits: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.bits_per_second() == bits)
    }
}
