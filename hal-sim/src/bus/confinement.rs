//! Fault confinement (ISO 11898-1, 12.1): the error counters of one controller, and what they let it do.

use protocol_core::controller::BusErrorMode;

/// From this value on a counter makes the controller error-passive.
const PASSIVE_FROM: u16 = 128;
/// From this value on the transmit counter takes the controller off the bus.
const BUS_OFF_FROM: u16 = 256;
/// What a receive counter above 127 becomes with a frame received; the standard allows 119 to 127.
const RECEIVED_WHILE_PASSIVE: u16 = 119;
/// Where the receive counter stops: it decides nothing above 127.
const RECEIVE_LIMIT: u16 = 255;
/// How many sequences of 11 recessive bits a controller that is bus-off waits for.
pub(super) const RECOVERY_SEQUENCES: u32 = 128;

/// The error counters of one controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Confinement {
    transmit: u16,
    receive: u16,
    mode: BusErrorMode,
}

impl Confinement {
    /// Returns the mode that the counters put the controller into.
    #[inline]
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

    /// Counts a frame that was sent and acknowledged.
    #[inline]
    pub(super) const fn sent(&mut self) {
        if self.transmit > 0 {
            self.transmit -= 1;
            self.settle();
        }
    }

    /// Counts a frame that was received.
    #[inline]
    pub(super) const fn received(&mut self) {
        self.receive =
            if self.receive >= PASSIVE_FROM { RECEIVED_WHILE_PASSIVE } else { self.receive.saturating_sub(1) };
        self.settle();
    }

    /// Counts an error in a frame that this controller sent.
    pub(super) const fn transmit_error(&mut self) {
        self.transmit += 8;
        self.settle();
    }

    /// Counts a frame that nobody acknowledged. An error-passive sender does not count that: a lone node never gets to
    /// bus-off.
    pub(super) fn no_acknowledgement(&mut self) {
        if self.mode == BusErrorMode::ErrorActive {
            self.transmit_error();
        }
    }

    /// Counts an error in a frame of somebody else; `first` when this controller's error flag was the first one, which
    /// it knows by the dominant bit of the others' flags after its own.
    pub(super) const fn receive_error(&mut self, first: bool) {
        let raised = self.receive + if first { 1 + 8 } else { 1 };
        self.receive = if raised < RECEIVE_LIMIT { raised } else { RECEIVE_LIMIT };
        self.settle();
    }

    /// Enters bus-off, whatever the counters say.
    pub(super) const fn force_bus_off(&mut self) {
        self.transmit = BUS_OFF_FROM;
        self.settle();
    }

    /// Works out the mode anew. Bus-off ends with a recovery only.
    const fn settle(&mut self) {
        self.mode = if matches!(self.mode, BusErrorMode::BusOff) || self.transmit >= BUS_OFF_FROM {
            BusErrorMode::BusOff
        } else if self.transmit >= PASSIVE_FROM || self.receive >= PASSIVE_FROM {
            BusErrorMode::ErrorPassive
        } else {
            BusErrorMode::ErrorActive
        };
    }

    /// Comes back to the bus, as new.
    pub(super) fn recover(&mut self) {
        *self = Self::default();
    }
}
