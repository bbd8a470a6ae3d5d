//! bxCAN, the CAN controller of the STM32F4 (RM0090 chapter 32): registers on the side of software, events on the side
//! of the wire. The model has no clock and no bus.
//!
//! ```text
//! registers   addresses and bits
//! timing      bit timing
//! mailboxes   transmit mailboxes
//! fifo        receive FIFOs
//! filters     filter banks
//! errors      error counters and codes
//! message     a frame in registers
//! ```
//!
//! A write to a register that is not writable causes a complaint, and any complaint fails the harness.
//!
//! Left out: time-triggered communication (TTCM, time stamps), debug freeze (DBF), the filters of CAN2, and the state
//! of the pins (SAMP and RX read recessive).

mod errors;
mod fifo;
mod filters;
mod mailboxes;
mod message;
pub mod registers;
mod timing;

#[cfg(test)]
mod tests;

use hal_sim::{BusError, WireEvent};

pub use errors::LastError;
pub use message::Message;
pub use timing::BitTiming;

use errors::Errors;
use fifo::Fifo;
use filters::Filters;
use mailboxes::{Attempt, Mailboxes};
use registers::*;

/// The interrupt lines, in their order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interrupts {
    /// A mailbox was emptied.
    pub transmit: bool,
    /// FIFO 0 or FIFO 1 holds a message, is full, or has an overrun.
    pub fifo: [bool; 2],
    /// Status change and error.
    pub status: bool,
}

/// The presence of the controller on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presence {
    /// The controller neither listens nor sends.
    Off,
    /// The controller waits for a start of frame.
    Asleep {
        /// The bit timing after the wake-up.
        timing: BitTiming,
    },
    /// The controller listens, and may send.
    On {
        /// The bit timing.
        timing: BitTiming,
        /// Whether the controller sends nothing dominant.
        silent: bool,
    },
}

/// Operating modes (RM0090 32.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Sleep,
    Initialization,
    /// The controller is on the way to [`Normal`](Self::Normal): it waits for 11 recessive bits, and still acknowledges
    /// the previous mode.
    Synchronising {
        from_sleep: bool,
    },
    Normal,
}

/// The controller.
#[derive(Clone, Debug)]
pub struct BxCan {
    mode: Mode,
    control: u32,
    /// The flags ERRI, WKUI and SLAKI.
    noted: u32,
    enabled: u32,
    timing: u32,
    /// Whether a frame of any node is on the wire.
    busy: bool,
    recovery: Recovery,
    mailboxes: Mailboxes,
    fifos: [Fifo; 2],
    filters: Filters,
    errors: Errors,
    /// The value of MSR.TXM instead of the true one, for tests.
    sending_shown: Option<bool>,
    /// Whether RXD is held dominant.
    dominant: bool,
    error_interrupts: u32,
    complaints: Vec<String>,
}

/// The recovery from bus-off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Recovery {
    /// Software must enter and leave initialization mode.
    Wanted,
    /// Software has been in initialization mode since.
    Running,
}

impl Default for BxCan {
    fn default() -> Self {
        Self {
            mode: Mode::Sleep,
            control: mcr::AT_RESET,
            noted: 0,
            enabled: 0,
            timing: btr::AT_RESET,
            busy: false,
            recovery: Recovery::Wanted,
            mailboxes: Mailboxes::default(),
            fifos: Default::default(),
            filters: Filters::default(),
            errors: Errors::default(),
            sending_shown: None,
            dominant: false,
            error_interrupts: 0,
            complaints: Vec::new(),
        }
    }
}

/// The registers, on the side of software.
impl BxCan {
    /// Reads the register at an offset.
    #[must_use]
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            MCR => self.control,
            MSR => self.status(),
            TSR => self.mailboxes.status(self.control & mcr::TXFP != 0),
            RF0R => self.fifos[0].read(),
            RF1R => self.fifos[1].read(),
            IER => self.enabled,
            ESR => self.errors.read(),
            BTR => self.timing,
            TI0R..RI0R => {
                let place = (offset - TI0R) as usize / 4;
                self.mailboxes.read(place / 4, place % 4)
            }
            RI0R..FMR => {
                let place = (offset - RI0R) as usize / 4;
                self.fifos.get(place / 4).map_or(0, |fifo| fifo.output(place % 4))
            }
            _ => self.filters.read(offset),
        }
    }

    /// Counts an access of the processor to a register, before a write and after a read. Some operations take a number
    /// of accesses.
    pub fn pass_access(&mut self, offset: u32) {
        let is_output = |fifo: usize| (RI0R..FMR).contains(&offset) && (offset - RI0R) as usize / 0x10 == fifo;
        if let Some(fifo) = (0..2).find(|fifo| is_output(*fifo) && self.fifos[*fifo].is_releasing()) {
            self.complain(format!("the output of FIFO {fifo} is accessed before its release has ended"));
        }
        self.fifos.iter_mut().for_each(Fifo::pass_access);
    }

    /// Writes the register at an offset.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            MCR if value & mcr::RESET != 0 => self.master_reset(),
            MCR => {
                self.control = value & mcr::ALL;
                self.follow_requests();
            }
            MSR => {
                self.noted &= !value;
                self.note_error(self.errors.stands(self.enabled));
            }
            TSR => self.mailboxes.write_status(value),
            RF0R => self.fifos[0].write(value),
            RF1R => self.fifos[1].write(value),
            IER => self.enabled = value,
            ESR => self.errors.write(value),
            BTR if self.mode == Mode::Initialization => self.timing = value & btr::ALL,
            BTR => self.complain("BTR is written outside of initialization mode".into()),
            TI0R..RI0R => {
                let place = (offset - TI0R) as usize / 4;
                if !self.mailboxes.write(place / 4, place % 4, value) {
                    self.complain(format!("mailbox {} is written while it is pending", place / 4));
                }
            }
            _ => {
                if !self.filters.write(offset, value) {
                    self.complain(format!("the filter register at {offset:#x} is written while it is in use"));
                }
            }
        }
    }

    /// Returns the levels of the interrupt lines (RM0090 32.8).
    #[must_use]
    pub fn interrupts(&self) -> Interrupts {
        let enabled = |bit: u32| self.enabled & bit != 0;
        let noted = |bit: u32| self.noted & bit != 0;
        let fifo = |number: usize| {
            let enabled = |bit: u32| enabled(bit << (ier::NEXT_FIFO * number as u32));
            let fifo = &self.fifos[number];
            let holds = |bit: u32| fifo.read() & bit != 0;
            enabled(ier::FMPIE) && fifo.is_pending()
                || enabled(ier::FFIE) && holds(rfr::FULL)
                || enabled(ier::FOVIE) && holds(rfr::FOVR)
        };
        Interrupts {
            transmit: enabled(ier::TMEIE) && self.mailboxes.is_completed(),
            fifo: [fifo(0), fifo(1)],
            status: enabled(ier::ERRIE) && noted(msr::ERRI)
                || enabled(ier::WKUIE) && noted(msr::WKUI)
                || enabled(ier::SLKIE) && noted(msr::SLAKI),
        }
    }

    /// Returns the number of messages that the two FIFOs have lost.
    #[must_use]
    pub fn lost(&self) -> [u32; 2] {
        [self.fifos[0].lost, self.fifos[1].lost]
    }

    /// Returns the number of messages that the filters have passed to the two FIFOs.
    #[must_use]
    pub fn came(&self) -> [u64; 2] {
        [self.fifos[0].came, self.fifos[1].came]
    }

    /// Returns the number of times that a filter, or all filters, were off between equal contents. Silicon loses frames
    /// meanwhile.
    #[must_use]
    pub const fn filter_gaps(&self) -> u32 {
        self.filters.gaps
    }

    /// Takes the complaints about the firmware.
    pub fn take_complaints(&mut self) -> Vec<String> {
        std::mem::take(&mut self.complaints)
    }

    pub(crate) fn complain(&mut self, what: String) {
        self.complaints.push(what);
    }

    pub(crate) fn complain_of(&mut self, complaints: Vec<String>) {
        self.complaints.extend(complaints);
    }

    /// Sets the value that MSR.TXM reads, whatever the state. A test can so show software the state just before a
    /// frame, or during a lost arbitration, which takes no time in the world.
    pub const fn show_sending(&mut self, shown: Option<bool>) {
        self.sending_shown = shown;
    }

    /// Holds RXD dominant, as a transceiver without supply does, or releases it. A dominant RXD keeps the controller
    /// from initialization and sleep mode (A).
    pub fn hold_dominant(&mut self, dominant: bool) {
        self.dominant = dominant;
        self.follow_requests();
    }

    /// Returns whether RXD [is held dominant](Self::hold_dominant).
    #[must_use]
    pub const fn is_held_dominant(&self) -> bool {
        self.dominant
    }

    /// Returns the number of error interrupts.
    #[must_use]
    pub const fn error_interrupts(&self) -> u32 {
        self.error_interrupts
    }

    fn status(&self) -> u32 {
        let acknowledged = match self.mode {
            Mode::Sleep | Mode::Synchronising { from_sleep: true } => msr::SLAK,
            Mode::Initialization | Mode::Synchronising { from_sleep: false } => msr::INAK,
            Mode::Normal => 0,
        };
        let sending = self.sending_shown.unwrap_or(self.mailboxes.is_sending());
        let activity = match (sending, self.busy) {
            (true, _) => msr::TXM,
            (false, true) => msr::RXM,
            (false, false) => 0,
        };
        msr::RECESSIVE | activity | self.noted | acknowledged
    }

    fn master_reset(&mut self) {
        let (enabled, timing, error_interrupts) = (self.enabled, self.timing, self.error_interrupts);
        let Self { filters, mut fifos, complaints, dominant, .. } = std::mem::take(self);
        fifos.iter_mut().for_each(Fifo::clear);
        *self = Self { enabled, timing, filters, fifos, error_interrupts, complaints, dominant, ..Self::default() };
    }

    /// Enters the mode that MCR requests, at the end of a frame on the wire.
    fn follow_requests(&mut self) {
        if self.busy && self.mode == Mode::Normal || self.dominant && self.mode != Mode::Initialization {
            return;
        }
        let asked = |bit: u32| self.control & bit != 0;
        let before = self.mode;
        self.mode = match before {
            _ if asked(mcr::SLEEP) => Mode::Sleep,
            _ if asked(mcr::INRQ) => Mode::Initialization,
            Mode::Sleep => Mode::Synchronising { from_sleep: true },
            Mode::Initialization => Mode::Synchronising { from_sleep: false },
            Mode::Synchronising { .. } | Mode::Normal => before,
        };
        if self.mode == Mode::Sleep && before != Mode::Sleep && self.enabled & ier::SLKIE != 0 {
            self.noted |= msr::SLAKI;
        }
        if self.mode != Mode::Sleep {
            self.noted &= !msr::SLAKI;
        }
        if self.mode == Mode::Initialization {
            self.busy = false;
            self.recovery = Recovery::Running;
        }
        // In loop back mode the bus does not end the synchronisation.
        if self.is_loopback() && matches!(self.mode, Mode::Synchronising { .. }) {
            self.mode = Mode::Normal;
        }
    }
}

/// The side of the bus.
impl BxCan {
    /// Returns the presence on the bus.
    #[must_use]
    pub fn presence(&self) -> Presence {
        let timing = BitTiming::of(self.timing);
        match self.mode {
            _ if self.is_loopback() => Presence::Off,
            Mode::Initialization => Presence::Off,
            Mode::Sleep => Presence::Asleep { timing },
            Mode::Synchronising { .. } | Mode::Normal => {
                Presence::On { timing, silent: timing::is_silent(self.timing) }
            }
        }
    }

    /// Returns whether the controller hears itself instead of the bus.
    #[must_use]
    pub const fn is_loopback(&self) -> bool {
        timing::is_loopback(self.timing)
    }

    /// Returns the message for the next arbitration.
    pub fn offer(&mut self) -> Option<Message> {
        let may = self.mode == Mode::Normal
            && !self.errors.is_bus_off()
            && (self.is_loopback() || !timing::is_silent(self.timing));
        if may { self.mailboxes.offer(self.control & mcr::TXFP != 0) } else { None }
    }

    /// Returns whether the controller is bus-off and counts sequences of 11 recessive bits.
    #[must_use]
    pub fn is_recovering(&self) -> bool {
        let automatic = self.control & mcr::ABOM != 0;
        self.errors.is_bus_off()
            && matches!(self.mode, Mode::Normal | Mode::Synchronising { .. })
            && (automatic || self.recovery == Recovery::Running)
    }

    /// Handles an event of the bus. A received frame has its length code of the wire.
    pub fn hear(&mut self, event: WireEvent) {
        self.fifos.iter_mut().for_each(Fifo::settle);
        match event {
            WireEvent::Received(frame) => self.receive(frame.into()),
            WireEvent::Joined => self.joined(),
            WireEvent::Recovered => {
                self.errors.recovered();
                self.recovery = Recovery::Wanted;
            }
            WireEvent::Begins { .. } if self.mode == Mode::Sleep => self.start_of_frame_in_sleep(),
            WireEvent::Ends => {
                self.busy = false;
                self.follow_requests();
            }
            _ if self.mode != Mode::Normal => {}
            WireEvent::Begins { own } => {
                self.busy = true;
                if own {
                    self.mailboxes.begin();
                }
            }
            WireEvent::LostArbitration => self.end_attempt(Attempt::LostArbitration),
            WireEvent::Sent => {
                self.errors.sent();
                self.end_attempt(Attempt::Sent);
            }
            WireEvent::NotSent(error) => {
                let error = match error {
                    BusError::Acknowledgement => LastError::Acknowledgement,
                    BusError::Bit => LastError::BitRecessive,
                    BusError::Stuff => LastError::Stuff,
                };
                self.not_sent(error);
            }
            WireEvent::NotReceived { first } => self.not_received(LastError::Stuff, first),
        }
    }

    /// Handles a failed attempt to send the offered message.
    pub fn not_sent(&mut self, error: LastError) {
        let was_on = !self.errors.is_bus_off();
        let noted = self.errors.not_sent(error, self.enabled);
        if was_on && self.errors.is_bus_off() {
            self.recovery = Recovery::Wanted;
        }
        self.note_error(noted);
        self.end_attempt(Attempt::Failed);
    }

    /// Handles a destroyed frame of another node.
    pub fn not_received(&mut self, error: LastError, first: bool) {
        let noted = self.errors.not_received(error, first, self.enabled);
        self.note_error(noted);
    }

    /// Handles a frame without an error.
    pub fn receive(&mut self, message: Message) {
        if self.mode != Mode::Normal || self.errors.is_bus_off() {
            return;
        }
        self.fifos.iter_mut().for_each(Fifo::settle);
        self.errors.received();
        if let Some(found) = self.filters.find(message.identifier()) {
            self.fifos[found.fifo].store(message, found.index, self.control & mcr::RFLM != 0);
        }
    }

    /// Receives the offered message, in loop back mode.
    pub fn loop_back(&mut self) {
        if let Some(message) = self.offer() {
            self.hear(WireEvent::Begins { own: true });
            self.hear(WireEvent::Sent);
            self.receive(message);
            self.hear(WireEvent::Ends);
        }
    }

    fn end_attempt(&mut self, attempt: Attempt) {
        self.mailboxes.end(attempt, self.control & mcr::NART != 0);
    }

    fn note_error(&mut self, noted: bool) {
        if noted {
            self.error_interrupts += u32::from(self.noted & msr::ERRI == 0);
            self.noted |= msr::ERRI;
        }
    }

    fn joined(&mut self) {
        if let Mode::Synchronising { .. } = self.mode {
            self.mode = Mode::Normal;
            self.follow_requests();
        }
    }

    fn start_of_frame_in_sleep(&mut self) {
        self.noted |= msr::WKUI;
        if self.control & mcr::AWUM != 0 {
            self.control &= !mcr::SLEEP;
            self.follow_requests();
        }
    }
}
