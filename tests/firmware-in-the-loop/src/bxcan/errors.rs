//! Error management (RM0090 32.7.6 and 32.9.2, ESR; ISO 11898-1, fault confinement).

use super::registers::{esr, ier};

/// From this value of a counter on there is an error warning.
const WARNING: u16 = 96;
/// Up to this value of both counters the controller is error-active.
const ACTIVE: u16 = 127;
/// Beyond this value of the transmit counter the controller is bus-off.
const BUS_OFF: u16 = 255;
/// What a receive counter above [`ACTIVE`] becomes with a message received.
const RECEIVED_WHILE_PASSIVE: u16 = 120;
/// Where the receive counter stops: it is 8 bits wide.
const RECEIVE_LIMIT: u16 = 255;

/// The last error code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LastError {
    /// Bit stuffing.
    Stuff = 1,
    /// Form.
    Form = 2,
    /// Acknowledgement.
    Acknowledgement = 3,
    /// A recessive bit was sent, a dominant one seen.
    BitRecessive = 4,
    /// A dominant bit was sent, a recessive one seen.
    BitDominant = 5,
    /// Checksum.
    Crc = 6,
}

/// Error counters, the flags that follow from them, and the last error code.
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

    /// Software may set the last error code, to see it change.
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

    /// A frame of this controller was sent.
    pub(super) fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
        self.last = 0;
    }

    /// A frame was received.
    pub(super) fn received(&mut self) {
        self.receive = if self.receive > ACTIVE { RECEIVED_WHILE_PASSIVE } else { self.receive.saturating_sub(1) };
        self.last = 0;
    }

    /// A frame of this controller was destroyed or not acknowledged; which enabled error interrupts that raises.
    ///
    /// An error-passive sender does not count a missing acknowledgement: alone on the bus it never gets to bus-off.
    pub(super) fn not_sent(&mut self, error: LastError, enabled: u32) -> bool {
        let passive = self.flags() & esr::EPVF != 0;
        let raised = if error == LastError::Acknowledgement && passive { 0 } else { 8 };
        self.note(error, enabled, |errors| {
            errors.transmit += raised;
            errors.bus_off |= errors.transmit > BUS_OFF;
        })
    }

    /// A frame of somebody else was destroyed; `first` when others' error flags came after this controller's own.
    pub(super) fn not_received(&mut self, error: LastError, first: bool, enabled: u32) -> bool {
        let raised = if first { 1 + 8 } else { 1 };
        self.note(error, enabled, |errors| errors.receive = (errors.receive + raised).min(RECEIVE_LIMIT))
    }

    /// Back from bus-off.
    pub(super) fn recovered(&mut self) {
        (self.transmit, self.receive, self.bus_off) = (0, 0, false);
    }

    /// Counts, and says whether the error is noted.
    fn note(&mut self, error: LastError, enabled: u32, count: impl FnOnce(&mut Self)) -> bool {
        count(self);
        self.last = error as u32;
        enabled & ier::LECIE != 0 || self.stands(enabled)
    }

    /// Whether a flag is set whose interrupt is enabled. The manual does not say whether a flag that stands is noted
    /// again, at a further error or as soon as the note is cleared: here it is (A), and software that it floods is seen
    /// to be.
    pub(super) fn stands(&self, enabled: u32) -> bool {
        let set = self.flags();
        let raises = |flag: u32, enable: u32| set & flag != 0 && enabled & enable != 0;
        raises(esr::EWGF, ier::EWGIE) || raises(esr::EPVF, ier::EPVIE) || raises(esr::BOFF, ier::BOFIE)
    }
}
