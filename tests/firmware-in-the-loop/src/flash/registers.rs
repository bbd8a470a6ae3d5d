//! The addresses of the registers (RM0090 3.9, STM32F42xxx), and their bits.

/// Access control.
pub const ACR: u32 = 0x00;
/// Key.
pub const KEYR: u32 = 0x04;
/// Option key.
pub const OPTKEYR: u32 = 0x08;
/// Status.
pub const SR: u32 = 0x0C;
/// Control.
pub const CR: u32 = 0x10;

/// The first key that unlocks [`CR`].
pub const KEY1: u32 = 0x4567_0123;
/// The second key that unlocks [`CR`].
pub const KEY2: u32 = 0xCDEF_89AB;

/// Bits of [`ACR`].
pub mod acr {
    /// Data cache enable.
    pub const DCEN: u32 = 1 << 10;
    /// Data cache reset.
    pub const DCRST: u32 = 1 << 12;
    /// The bits of the register.
    pub const ALL: u32 = 0x1F0F;
}

/// Bits of [`SR`].
pub mod sr {
    /// End of operation; only with its interrupt enabled.
    pub const EOP: u32 = 1;
    /// An error; only with its interrupt enabled.
    pub const OPERR: u32 = 1 << 1;
    /// The sector is protected, or there is none.
    pub const WRPERR: u32 = 1 << 4;
    /// The width differs from PSIZE.
    pub const PGPERR: u32 = 1 << 6;
    /// Programming was not set up.
    pub const PGSERR: u32 = 1 << 7;
    /// An operation is under way.
    pub const BSY: u32 = 1 << 16;
}

/// Bits of [`CR`].
pub mod cr {
    /// Programming.
    pub const PG: u32 = 1;
    /// Sector erase.
    pub const SER: u32 = 1 << 1;
    /// Erase of bank 1.
    pub const MER: u32 = 1 << 2;
    /// The position of the sector number.
    pub const SNB: u32 = 3;
    /// The position of the parallelism: 8, 16, 32, 64 bits.
    pub const PSIZE: u32 = 8;
    /// Erase of bank 2.
    pub const MER1: u32 = 1 << 15;
    /// Start an erase.
    pub const STRT: u32 = 1 << 16;
    /// Interrupt at the end of an operation.
    pub const EOPIE: u32 = 1 << 24;
    /// Interrupt at an error.
    pub const ERRIE: u32 = 1 << 25;
    /// Locked.
    pub const LOCK: u32 = 1 << 31;
    /// The bits of the register.
    pub const ALL: u32 = 0x8301_83FF;
}
