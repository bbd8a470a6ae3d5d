//! The addresses of the registers (RM0090 32.9.6, bxCAN register map), and their bits.

/// Master control.
pub const MCR: u32 = 0x000;
/// Master status.
pub const MSR: u32 = 0x004;
/// Transmit status.
pub const TSR: u32 = 0x008;
/// Receive FIFO 0; that of FIFO 1 follows.
pub const RF0R: u32 = 0x00C;
/// Receive FIFO 1.
pub const RF1R: u32 = 0x010;
/// Interrupt enable.
pub const IER: u32 = 0x014;
/// Error status.
pub const ESR: u32 = 0x018;
/// Bit timing.
pub const BTR: u32 = 0x01C;
/// Mailbox 0: identifier, length, data low, data high; then those of mailbox 1 and 2.
pub const TI0R: u32 = 0x180;
/// Output of FIFO 0: identifier, length, data low, data high; then that of FIFO 1.
pub const RI0R: u32 = 0x1B0;
/// Filter master.
pub const FMR: u32 = 0x200;
/// Filter mode: 1 is identifier list.
pub const FM1R: u32 = 0x204;
/// Filter scale: 1 is 32 bits.
pub const FS1R: u32 = 0x20C;
/// Filter FIFO assignment.
pub const FFA1R: u32 = 0x214;
/// Filter activation.
pub const FA1R: u32 = 0x21C;
/// Bank 0: register 1, register 2; then those of the other banks.
pub const F0R1: u32 = 0x240;

/// Bits of [`MCR`].
pub mod mcr {
    /// Initialization request.
    pub const INRQ: u32 = 1;
    /// Sleep mode request.
    pub const SLEEP: u32 = 1 << 1;
    /// Transmit priority by the order of requests.
    pub const TXFP: u32 = 1 << 2;
    /// Receive FIFOs locked against overrun.
    pub const RFLM: u32 = 1 << 3;
    /// No automatic retransmission.
    pub const NART: u32 = 1 << 4;
    /// Automatic wake-up.
    pub const AWUM: u32 = 1 << 5;
    /// Automatic bus-off management.
    pub const ABOM: u32 = 1 << 6;
    /// Master reset.
    pub const RESET: u32 = 1 << 15;
    /// The value after a reset.
    pub const AT_RESET: u32 = 0x0001_0002;
    /// The bits of the register, without the reset bit, which reads 0.
    pub const ALL: u32 = 0x0001_00FF;
}

/// Bits of [`MSR`].
pub mod msr {
    /// Initialization acknowledge.
    pub const INAK: u32 = 1;
    /// Sleep acknowledge.
    pub const SLAK: u32 = 1 << 1;
    /// An error was noted and its interrupt is enabled.
    pub const ERRI: u32 = 1 << 2;
    /// A start of frame was seen in sleep.
    pub const WKUI: u32 = 1 << 3;
    /// Sleep was entered.
    pub const SLAKI: u32 = 1 << 4;
    /// The controller is sending.
    pub const TXM: u32 = 1 << 8;
    /// The controller is receiving.
    pub const RXM: u32 = 1 << 9;
    /// The last sample and the pin, which are recessive between frames.
    pub const RECESSIVE: u32 = 0xC00;
}

/// Bits of [`TSR`], of mailbox 0; those of the others are 8 and 16 bits up.
pub mod tsr {
    /// The request was carried out.
    pub const RQCP: u32 = 1;
    /// The last attempt succeeded.
    pub const TXOK: u32 = 1 << 1;
    /// The last attempt lost arbitration.
    pub const ALST: u32 = 1 << 2;
    /// The last attempt failed by an error.
    pub const TERR: u32 = 1 << 3;
    /// Abort request.
    pub const ABRQ: u32 = 1 << 7;
    /// The position of the number of the next mailbox.
    pub const CODE: u32 = 24;
    /// The position of the three empty flags.
    pub const TME: u32 = 26;
    /// The position of the three flags of the lowest priority.
    pub const LOW: u32 = 29;
}

/// Bits of [`RF0R`] and [`RF1R`].
pub mod rfr {
    /// Three messages were stored.
    pub const FULL: u32 = 1 << 3;
    /// A message came while it was full.
    pub const FOVR: u32 = 1 << 4;
    /// Release the output.
    pub const RFOM: u32 = 1 << 5;
}

/// Bits of [`IER`].
pub mod ier {
    /// A mailbox is empty.
    pub const TMEIE: u32 = 1;
    /// Messages pending in FIFO 0; those of FIFO 1 are 3 bits up.
    pub const FMPIE: u32 = 1 << 1;
    /// FIFO 0 full.
    pub const FFIE: u32 = 1 << 2;
    /// FIFO 0 overrun.
    pub const FOVIE: u32 = 1 << 3;
    /// The distance from the bits of FIFO 0 to those of FIFO 1.
    pub const NEXT_FIFO: u32 = 3;
    /// Error warning.
    pub const EWGIE: u32 = 1 << 8;
    /// Error passive.
    pub const EPVIE: u32 = 1 << 9;
    /// Bus-off.
    pub const BOFIE: u32 = 1 << 10;
    /// Last error code.
    pub const LECIE: u32 = 1 << 11;
    /// The interrupt of all errors.
    pub const ERRIE: u32 = 1 << 15;
    /// Wake-up.
    pub const WKUIE: u32 = 1 << 16;
    /// Sleep.
    pub const SLKIE: u32 = 1 << 17;
}

/// Bits of [`ESR`].
pub mod esr {
    /// A counter has reached 96.
    pub const EWGF: u32 = 1;
    /// A counter is above 127.
    pub const EPVF: u32 = 1 << 1;
    /// Bus-off.
    pub const BOFF: u32 = 1 << 2;
    /// The position of the last error code.
    pub const LEC: u32 = 4;
    /// The mask of the last error code.
    pub const LEC_MASK: u32 = 7 << LEC;
    /// The position of the transmit error counter.
    pub const TEC: u32 = 16;
    /// The position of the receive error counter.
    pub const REC: u32 = 24;
}

/// Bits of [`BTR`].
pub mod btr {
    /// Loop back.
    pub const LBKM: u32 = 1 << 30;
    /// Silent.
    pub const SILM: u32 = 1 << 31;
    /// The value after a reset.
    pub const AT_RESET: u32 = 0x0123_0000;
    /// The bits of the register.
    pub const ALL: u32 = 0xC37F_03FF;
}

/// Bits of the identifier registers of mailboxes and FIFOs.
pub mod ir {
    /// Transmit request, in a mailbox.
    pub const TXRQ: u32 = 1;
    /// Remote frame.
    pub const RTR: u32 = 1 << 1;
    /// Extended identifier.
    pub const IDE: u32 = 1 << 2;
    /// The position of a 29-bit identifier.
    pub const EXID: u32 = 3;
    /// The position of an 11-bit identifier.
    pub const STID: u32 = 21;
}
