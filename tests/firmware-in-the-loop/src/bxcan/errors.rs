//! Error management (RM0090 32.7.6 and 32.9.2, ESR; ISO 11898-1, fault confinement).

use super::registers::{esr, ier};

/// The counter value from which on there is an error warning.
const WARNING: u16 = 96;
/// The highest value of both counters with which the controller is error-active.
const ACTIVE: u16 = 127;
/// The highest value of the transmit counter with which the controller is not bus-off.
const BUS_OFF: u16 = 255;
/// The value of a receive counter above [`ACTIVE`] after a received message.
const RECEIVED_WHILE_PASSIVE: u16 = 120;
/// The maximum of the receive counter, which has 8 bits.
const RECEIVE_LIMIT: u16 = 255;

/// The last error code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LastError {
    /// A stuff error.
    Stuff = 1,
    /// A form error.
    Form = 2,
    /// An acknowledgement error.
    Acknowledgement = 3,
    /// A bit error: a recessive bit was sent and a dominant one seen.
    BitRecessive = 4,
    /// A bit error: a dominant bit was sent and a recessive one seen.
    BitDominant = 5,
    /// A checksum error.
    Crc = 6,
}

/// The error counters, their flags, and the last error code.
#[derive(Clone, Debug, Default)]
pub(super) struct Errors {
    transmit: u16,
    receive: u16,
    last: u32,
    bus_off: bool,
}

impl Errors {
    pub(super) fn read(&self) -> u32 {
        // The register shows the low byte of the transmit counter, which has nine bits.
        let counters = u32::from(self.receive) << esr::REC | u32::from(self.transmit & 0xFF) << esr::TEC;
        counters | self.last << esr::LEC | self.flags()
    }

    /// Writes the last error code, which software may set in order to see changes.
    pub(super) fn write(&mut self, value: u32) {
        self.last = (value & esr::LEC_MASK) >> esr::LEC;
    }

    fn flags(&self) -> u32 {
        let highest = self.transmit.max(self.receive);
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        flag(highest >= WARNING, esr::EWGF) | flag(highest > ACTIVE, esr::EPVF) | flag(self.bus_off, esr::BOFF)
    }

    pub(super) const fn is_bus_off(&self) -> bool {
        self.bus_off
    }

    /// Counts a sent frame.
    pub(super) fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
        self.last = 0;
    }

    /// Counts a received frame.
    pub(super) fn received(&mut self) {
        self.receive = if self.receive > ACTIVE { RECEIVED_WHILE_PASSIVE } else { self.receive.saturating_sub(1) };
        self.last = 0;
    }

    /// Counts a sent frame that was destroyed or not acknowledged. Returns whether this raises an enabled error
    /// interrupt.
    ///
    /// An error-passive sender does not count a missing acknowledgement, so it does not become bus-off alone on the
    /// bus.
    pub(super) fn not_sent(&mut self, error: LastError, enabled: u32) -> bool {
        let passive = self.flags() & esr::EPVF != 0;
        let raised = if error == LastError::Acknowledgement && passive { 0 } else { 8 };
        self.note(error, enabled, |errors| {
            errors.transmit += raised;
            errors.bus_off |= errors.transmit > BUS_OFF;
        })
    }

    /// Counts a destroyed frame of another node. `first` says that the error flags of other nodes followed that of this
    /// controller.
    pub(super) fn not_received(&mut self, error: LastError, first: bool, enabled: u32) -> bool {
        let raised = if first { 1 + 8 } else { 1 };
        self.note(error, enabled, |errors| errors.receive = (errors.receive + raised).min(RECEIVE_LIMIT))
    }

    /// Resets the counters after bus-off.
    pub(super) fn recovered(&mut self) {
        (self.transmit, self.receive, self.bus_off) = (0, 0, false);
    }

    /// Counts an error. Returns whether the error is noted.
    fn note(&mut self, error: LastError, enabled: u32, count: impl FnOnce(&mut Self)) -> bool {
        count(self);
        self.last = error as u32;
        enabled & ier::LECIE != 0 || self.stands(enabled)
    }

    /// Returns whether a flag with an enabled interrupt is set. The manual does not say whether a set flag is noted
    /// again, at a further error or once its note is cleared. Here it is (A), so that software which floods itself is
    /// found.
    pub(super) fn stands(&self, enabled: u32) -> bool {
        let set = self.flags();
        let raises = |flag: u32, enable: u32| set & flag != 0 && enabled & enable != 0;
        raises(esr::EWGF, ier::EWGIE) || raises(esr::EPVF, ier::EPVIE) || raises(esr::BOFF, ier::BOFIE)
    }
}
