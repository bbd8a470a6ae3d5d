//! The CAN controller of a device: its trait, its filters and its error mode.
//!
//! The simulated controller and the controller of the board share these types, so that host tests run the flashed code.

use heapless::Vec;

use crate::frame::Frame;

/// A CAN controller, for use with [`pump`](crate::pump::pump).
pub trait Controller: embedded_can::nb::Can<Frame = Frame> {
    /// Returns whether no mailbox is pending: the controller has sent all frames handed to it.
    fn is_idle(&self) -> bool;

    /// Drops the pending transmit frames that match `which`. A frame already on the wire continues, but is not
    /// retransmitted if the present attempt fails.
    fn abort(&mut self, which: Filter);

    /// Sets the receive filters. From now on the controller accepts data frames that pass at least one filter, and may
    /// reject all others. Frames already received stay.
    fn set_filters(&mut self, filters: &Filters);
}

/// The maximum number of transmit frames that a controller holds at once.
pub const MAILBOXES: usize = 3;

/// An identifier filter: passes frames whose key equals `key` in the bits of `mask`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// The key of an identifier, see [`frame::key`](crate::frame::key).
    pub key: u32,
    /// The compared bits. Receive filters always compare bit 29, which marks an extended identifier.
    pub mask: u32,
}

impl Filter {
    /// Passes every identifier.
    pub const ALL: Self = Self { key: 0, mask: 0 };

    /// Passes one identifier.
    #[must_use]
    pub const fn exactly(key: u32) -> Self {
        Self { key, mask: u32::MAX }
    }

    /// Returns whether a frame passes.
    #[inline]
    #[must_use]
    pub const fn passes(&self, frame: &Frame) -> bool {
        (frame.key() ^ self.key) & self.mask == 0
    }
}

/// The maximum number of filters of a device: one for each service with its own identifier.
pub const FILTERS: usize = 8;

/// The filters of a device.
pub type Filters = Vec<Filter, FILTERS>;

/// The error mode of a controller, by its error counters (ISO 11898-1, fault confinement).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusErrorMode {
    /// Normal operation, with active error flags.
    #[default]
    ErrorActive,
    /// An error counter is above 127: normal operation, but with passive error flags.
    ErrorPassive,
    /// The transmit error counter is above 255: no communication until recovery. The platform must drop the
    /// controller's pending frames before it reports bus-off to the device, because those frames would be outdated
    /// after recovery.
    BusOff,
}

/// The bit rates of CiA 301. The discriminants are the indices in LSS bit timing table 0 (CiA 305).
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

    /// Returns the bit rate with this index in LSS bit timing table 0; `None` for 5 (reserved) and above 8.
    #[must_use]
    pub fn from_table_index(index: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.table_index() == index)
    }

    /// Returns the bit rate with this number of bits per second; `None` if CiA 301 does not define it.
    #[must_use]
    pub fn from_bits_per_second(bits: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|rate| rate.bits_per_second() == bits)
    }
}
