//! The boards that an image is built for, with the properties in which they differ.

use std::ops::Range;

use rigless::soc::Region;

use crate::flash::Layout;
use crate::part::Port;

/// A board with its part.
#[derive(Debug)]
pub struct Board {
    /// The name of the board.
    pub name: &'static str,
    /// The name of the part.
    pub part: &'static str,
    /// The environment variable that names the ELF file of the image. `./run` sets it.
    pub(crate) variable: &'static str,
    /// The folder into which cargo builds the image.
    pub profile: &'static str,
    /// The flash that the image may use.
    pub flash: Range<u64>,
    /// The RAM that the image uses.
    pub ram: Range<u64>,
    /// The plain memory: that of the image, and the RAM. Only tests that break the image program it.
    pub(crate) memory: &'static [Region],
    /// The region from which the processor boots.
    pub(crate) boot: &'static str,
    /// The number of interrupt lines.
    pub(crate) interrupt_lines: u16,
    /// The value of DBGMCU_IDCODE.
    pub(crate) idcode: u64,
    /// Whether a second register selects dedicated clocks.
    pub(crate) has_dckcfgr2: bool,
    /// The number of ports, from A on.
    pub(crate) ports: usize,
    /// The serial port of the console.
    pub(crate) console: Console,
    /// The sectors of the memory.
    pub(crate) layout: Layout,
    /// The pins of the LEDs.
    pub leds: &'static [(Port, u8)],
    /// The pin of the button.
    pub button: (Port, u8),
    /// The level of the pressed button.
    pub pressed: bool,
}

/// The serial port of a console.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Console {
    Usart2,
    Usart3,
}

/// The NUCLEO-F429ZI (UM1974, RM0090, DS9405), with two flash banks, a red and a green LED.
pub static NUCLEO_F429ZI: Board = Board {
    name: "NUCLEO-F429ZI",
    part: "STM32F429ZI",
    variable: "FIRMWARE_ELF",
    profile: "firmware",
    flash: 0x0800_0000..0x0810_0000,
    ram: 0x2000_0000..0x2003_0000,
    memory: &[
        Region::flash("bank 1", 0x0800_0000, 1 << 20).programmed_by("FLASH"),
        Region::ram("ccm", 0x1000_0000, 64 << 10),
        Region::system("system", 0x1FFF_0000, 32 << 10),
        Region::ram("sram", 0x2000_0000, 192 << 10),
    ],
    boot: "bank 1",
    interrupt_lines: 91,
    // The revision is 3 or later. Before it, reads of bank 2 depend on PA12.
    idcode: 0x2003_6419,
    has_dckcfgr2: false,
    ports: 9,
    console: Console::Usart3,
    layout: Layout::TWO_BANKS,
    leds: &[(Port::B, 14), (Port::B, 0)],
    button: (Port::C, 13),
    pressed: true,
};

/// The NUCLEO-F446RE (UM1724, RM0390, DS10693), with one LED and one flash bank, whose sectors 1 and 2 are the memory.
pub static NUCLEO_F446RE: Board = Board {
    name: "NUCLEO-F446RE",
    part: "STM32F446RE",
    variable: "FIRMWARE_F446RE_ELF",
    profile: "firmware-f446re",
    flash: 0x0800_0000..0x0808_0000,
    ram: 0x2000_0000..0x2002_0000,
    memory: &[
        Region::flash("sector 0", 0x0800_0000, 16 << 10).programmed_by("FLASH"),
        Region::flash("sectors 3 to 7", 0x0800_C000, 464 << 10).programmed_by("FLASH"),
        Region::system("system", 0x1FFF_0000, 32 << 10),
        Region::ram("sram", 0x2000_0000, 128 << 10),
    ],
    boot: "sector 0",
    interrupt_lines: 97,
    idcode: 0x1000_6421,
    has_dckcfgr2: true,
    ports: 8,
    console: Console::Usart2,
    layout: Layout::ONE_BANK,
    leds: &[(Port::A, 5)],
    button: (Port::C, 13),
    pressed: false,
};
