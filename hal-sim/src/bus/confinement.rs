//! Fault confinement (ISO 11898-1, 12.1): the error counters and the error mode of one controller.

use protocol_core::controller::BusErrorMode;

/// The counter value from which the controller is error-passive.
const PASSIVE_FROM: u16 = 128;
/// The transmit error counter value from which the controller is bus-off.
const BUS_OFF_FROM: u16 = 256;
/// The new value of a receive error counter above 127 after a successful reception. The standard allows 119 to 127.
const RECEIVED_WHILE_PASSIVE: u16 = 119;
/// The upper limit of the receive error counter: higher values would not change the mode.
const RECEIVE_LIMIT: u16 = 255;
/// The number of sequences of 11 recessive bits required for bus-off recovery.
pub(super) const RECOVERY_SEQUENCES: u32 = 128;

/// The error counters of one controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Confinement {
    transmit: u16,
    receive: u16,
    mode: BusErrorMode,
}

impl Confinement {
    /// Returns the error mode.
    #[must_use]
    pub const fn mode(&self) -> BusErrorMode {
        self.mode
    }

    /// Returns the transmit error counter, TEC.
    #[must_use]
    pub const fn transmit_errors(&self) -> u16 {
        self.transmit
    }

    /// Returns the receive error counter, REC.
    #[must_use]
    pub const fn receive_errors(&self) -> u16 {
        self.receive
    }

    /// Decrements the transmit error counter after a successful transmission.
    pub(super) const fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
        self.settle();
    }

    /// Lowers the receive error counter after a successful reception.
    pub(super) const fn received(&mut self) {
        self.receive =
            if self.receive >= PASSIVE_FROM { RECEIVED_WHILE_PASSIVE } else { self.receive.saturating_sub(1) };
        self.settle();
    }

    /// Raises the transmit error counter after a failed transmission.
    pub(super) const fn transmit_error(&mut self) {
        self.transmit += 8;
        self.settle();
    }

    /// Raises the transmit error counter after a missing acknowledgement, unless the controller is error-passive. A
    /// lone node therefore never goes bus-off.
    pub(super) fn no_acknowledgement(&mut self) {
        if self.mode == BusErrorMode::ErrorActive {
            self.transmit_error();
        }
    }

    /// Raises the receive error counter after an error in another controller's frame: by 1, or by 9 if this controller
    /// sent the `first` error flag, because this controller then detects a dominant bit after its flag.
    pub(super) fn receive_error(&mut self, first: bool) {
        self.receive = (self.receive + if first { 1 + 8 } else { 1 }).min(RECEIVE_LIMIT);
        self.settle();
    }

    /// Raises the transmit error counter to the bus-off limit.
    pub(super) const fn force_bus_off(&mut self) {
        self.transmit = BUS_OFF_FROM;
        self.settle();
    }

    /// Updates the mode from the counters. Only [`recover`](Self::recover) ends bus-off.
    const fn settle(&mut self) {
        self.mode = if matches!(self.mode, BusErrorMode::BusOff) || self.transmit >= BUS_OFF_FROM {
            BusErrorMode::BusOff
        } else if self.transmit >= PASSIVE_FROM || self.receive >= PASSIVE_FROM {
            BusErrorMode::ErrorPassive
        } else {
            BusErrorMode::ErrorActive
        };
    }

    /// Clears the counters and returns to error-active.
    pub(super) fn recover(&mut self) {
        *self = Self::default();
    }
}
