//! The CAN controller of a device: its trait, its filters and its error mode.
//!
//! The simulated controller and that of the board share these types, so that host tests run the flashed code.

use heapless::Vec;

use crate::frame::Frame;

/// A CAN controller that a device can be pumped through.
pub trait Controller: embedded_can::nb::Can<Frame = Frame> {
    /// Returns whether every frame it took is on the bus: no mailbox is pending.
    fn is_idle(&self) -> bool;

    /// Drops the frames under the identifiers of `which` that wait for the bus. A frame on the wire goes on, and is not
    /// repeated when that attempt fails.
    fn abort(&mut self, which: Filter);

    /// Receives from now on the data frames that one of these filters lets through, and may keep others away. What was
    /// received before stays.
    fn set_filters(&mut self, filters: &Filters);
}

/// The number of frames that a controller holds at the most: older ones that it took are on the bus.
pub const MAILBOXES: usize = 3;

/// A filter of a controller: passes every frame whose identifier equals `key` in the bits of `mask`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// An identifier as one number, as [`frame::key`](crate::frame::key) makes it.
    pub key: u32,
    /// The bits of it that count; that of an extended identifier always does.
    pub mask: u32,
}

impl Filter {
    /// Passes every identifier.
    pub const ALL: Self = Self { key: 0, mask: 0 };

    /// Lets one identifier through.
    #[must_use]
    pub const fn exactly(key: u32) -> Self {
        Self { key, mask: u32::MAX }
    }

    /// Returns whether it lets a frame through.
    #[inline]
    #[must_use]
    pub const fn passes(&self, frame: &Frame) -> bool {
        (frame.key() ^ self.key) & self.mask == 0
    }
}

/// The most filters that a device needs: one for each service with an identifier of its own.
pub const FILTERS: usize = 8;

/// The filters of a device.
pub type Filters = Vec<Filter, FILTERS>;

/// The error mode of a controller, by its error counters (ISO 11898-1, fault confinement).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusErrorMode {
    /// Takes part in full.
    #[default]
    ErrorActive,
    /// A counter is above 127: takes part, but signals errors passively.
    ErrorPassive,
    /// The transmit counter is above 255: takes no part until it has recovered. What waits in the controller is to be
    /// dropped then, before the device is told: it would be out of date when the bus is back.
    BusOff,
}

/// The bit rates of CiA 301; discriminants are the indices of LSS bit timing table 0 (CiA 305).
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
    /// All bit rates, fastest first.
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

    /// Returns the bit rate at an index of LSS bit timing table 0; `None` for 5 (reserved) and above 8.
    #[must_use]
    pub fn from_table_index(index: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.table_index() == index)
    }

    /// Returns the bit rate of a number of bits per second.
    #[must_use]
    pub fn from_bits_per_second(bits: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.bits_per_second() == bits)
    }
}
