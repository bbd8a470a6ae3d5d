//! The boards that an image is built for: what differs between them, as their manuals print it.

use std::ops::Range;

use rigless::soc::Region;

use crate::flash::Layout;
use crate::part::Port;

/// A board, with the part on it.
#[derive(Debug)]
pub struct Board {
    /// Its name.
    pub name: &'static str,
    /// The part's name.
    pub part: &'static str,
    /// The variable that names the ELF file of its image; `./run` sets it.
    pub(crate) variable: &'static str,
    /// The folder that cargo builds its image into.
    pub profile: &'static str,
    /// Where the image may be.
    pub flash: Range<u64>,
    /// The RAM that it uses.
    pub ram: Range<u64>,
    /// Plain memory: that of the image, and the RAM. The image is programmed by nobody but tests that break it.
    pub(crate) memory: &'static [Region],
    /// The region that the processor boots from.
    pub(crate) boot: &'static str,
    /// Interrupt lines.
    pub(crate) interrupt_lines: u16,
    /// DBGMCU_IDCODE.
    pub(crate) idcode: u64,
    /// Whether it selects dedicated clocks in a second register.
    pub(crate) has_dckcfgr2: bool,
    /// How many ports it has, from A on.
    pub(crate) ports: usize,
    /// The serial port of the console.
    pub(crate) console: Console,
    /// The sectors that hold the memory.
    pub(crate) layout: Layout,
    /// The pins of the LEDs.
    pub leds: &'static [(Port, u8)],
    /// The pin of the button.
    pub button: (Port, u8),
    /// Its level while it is pressed.
    pub pressed: bool,
}

/// A serial port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Console {
    Usart2,
    Usart3,
}

/// The NUCLEO-F429ZI (UM1974, RM0090, DS9405): two flash banks. Its LEDs: red, green.
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
    // Revision 3 and later: before it, reads of bank 2 depend on PA12.
    idcode: 0x2003_6419,
    has_dckcfgr2: false,
    ports: 9,
    console: Console::Usart3,
    layout: Layout::TWO_BANKS,
    leds: &[(Port::B, 14), (Port::B, 0)],
    button: (Port::C, 13),
    pressed: true,
};

/// The NUCLEO-F446RE (UM1724, RM0390, DS10693): one flash bank, of which sectors 1 and 2 are the memory. One LED.
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
