//! The errors that a sensor reports by EMCYs (SPEC 9).

use crate::wire::emcy::{Emcy, NO_ERROR};

/// An error of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Error {
    /// The user set-up could not be loaded, because a record of the memory is damaged.
    SetUp = 1 << 0,
    /// The controller has an error: an internal fault or a watchdog reset.
    Controller = 1 << 1,
    /// The CAN controller is error-passive.
    Passive = 1 << 2,
    /// The CAN controller was bus-off. The error is reported after recovery.
    BusOff = 1 << 3,
}

impl Error {
    /// All errors, in the order in which they are reported.
    pub const ALL: [Self; 4] = [Self::SetUp, Self::Controller, Self::Passive, Self::BusOff];

    /// Returns the emergency error code, the manufacturer-specific field and the bits of the error register.
    #[must_use]
    pub const fn codes(self) -> (u16, u16, u8) {
        match self {
            Self::SetUp => (0xFF00, 1, 0x81),
            Self::Controller => (0xFF00, 2, 0x81),
            Self::Passive => (0x8120, 3, 0x11),
            Self::BusOff => (0x8140, 4, 0x11),
        }
    }
}

/// A set of errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::device) struct Errors(u8);

impl Errors {
    pub(super) const NONE: Self = Self(0);

    pub(in crate::device) const fn has(self, error: Error) -> bool {
        self.0 & error as u8 != 0
    }

    /// Adds or removes an error. Returns whether the set has changed.
    pub(super) const fn set(&mut self, error: Error, active: bool) -> bool {
        let changes = self.has(error) != active;
        if changes {
            self.0 ^= error as u8;
        }
        changes
    }

    /// Returns the error register.
    pub(super) fn register(self) -> u8 {
        Error::ALL.into_iter().filter(|error| self.has(*error)).fold(0, |register, error| register | error.codes().2)
    }

    /// Encodes the EMCY of an error.
    pub(super) fn message(self, error: Error) -> Emcy {
        let (code, field, _) = error.codes();
        let [low, high] = field.to_le_bytes();
        Emcy { code, register: self.register(), manufacturer: [low, high, 0, 0, 0] }
    }

    /// Encodes the EMCY for the end of an error. The error register shows the remaining errors. (R) A valve reports
    /// only the end of the last error.
    pub(super) fn end(self) -> Emcy {
        Emcy { code: NO_ERROR, register: self.register(), manufacturer: [0; 5] }
    }
}
