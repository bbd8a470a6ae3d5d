//! The STM32F429ZI and the STM32F446RE. `rigless` has the models of clocks, power, GPIO, timers, UART, DMA, watchdog
//! and debug, which they share with the STM32F427. This crate adds CAN1, the flash interface and the sectors of the
//! memory. Other peripherals are missing: an access to one fails the test.
//!
//! Of the additions of the STM32F446 there is only DCKCFGR2, a register that stores its value. It selects the clocks of
//! missing peripherals.

mod can;
mod console;
mod flash;
mod rcc;

use std::num::NonZeroU64;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::cpu::armv7m::{self, Dwt};
use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32f427::generated as tables;
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::dma::{Dma, Wire};
use rigless::soc::stm32f427::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc as stock;
use rigless::soc::stm32f427::peripherals::tim::{Counter, General, Tim};
use rigless::soc::stm32f427::peripherals::usart::{Kind, RECEIVE_REQUEST, TRANSMIT_REQUEST, Usart};
use rigless::soc::{
    Access, Bus, Clock, Cpu, Endian, Error, Gate, Peripheral, ReadAction, RegisterSpec, Width, Window, WriteModify,
};
use rigless::time::VirtualNanos;

pub use can::Can1;
pub use console::{Damage, Flag, Lines, Terminal};
pub use flash::SharedFlash;

use crate::board::{Board, Console};
use crate::warm::CoreView;
use can::CanDevice;
use flash::{FlashInterface, MemorySectors};
use rcc::Clocks;

/// The value of USART_SR with an empty transmitter (RM0090 30.6.1, where a digit too many is printed).
const USART_SR: u64 = 0xC0;
/// The second register of the dedicated clocks (RM0390 6.3.27).
const DCKCFGR2: Peripheral =
    Peripheral { name: "DCKCFGR2", base: 0x4002_3894, size: 4, interrupts: &[], registers: &[DEDICATED_CLOCKS] };
const DEDICATED_CLOCKS: RegisterSpec = RegisterSpec {
    name: "DCKCFGR2",
    offset: 0,
    width: Width::W32,
    reset: 0,
    access: Access::ReadWrite,
    read: ReadAction::None,
    write: WriteModify::None,
    fields: &[],
};
/// The requests to DMA1 of the serial ports that a console can use (RM0090 table 43, RM0390 table 28).
static DMA1_REQUESTS: [Wire; 4] = [
    Wire { instance: "USART2", request: RECEIVE_REQUEST, channel: 4, streams: &[5] },
    Wire { instance: "USART2", request: TRANSMIT_REQUEST, channel: 4, streams: &[6] },
    Wire { instance: "USART3", request: RECEIVE_REQUEST, channel: 4, streams: &[1] },
    Wire { instance: "USART3", request: TRANSMIT_REQUEST, channel: 4, streams: &[3] },
];
const SUPPLY_MV: u32 = 3300;
/// The clock output of the ST-LINK, which the NUCLEO feeds to OSC_IN, in Hz.
const HSE_HZ: u64 = 8_000_000;
const NO_LSE: u64 = 0;

/// The ports, each with its reset values of MODER, OSPEEDR and PUPDR (RM0090 8.4).
const PORTS: [(Peripheral, &str, &str, [u64; 3]); 9] = [
    (tables::GPIOA, "GPIOAEN", "GPIOARST", [0xA800_0000, 0x0C00_0000, 0x6400_0000]),
    (tables::GPIOB, "GPIOBEN", "GPIOBRST", [0x280, 0xC0, 0x100]),
    (tables::GPIOC, "GPIOCEN", "GPIOCRST", [0; 3]),
    (tables::GPIOD, "GPIODEN", "GPIODRST", [0; 3]),
    (tables::GPIOE, "GPIOEEN", "GPIOERST", [0; 3]),
    (tables::GPIOF, "GPIOFEN", "GPIOFRST", [0; 3]),
    (tables::GPIOG, "GPIOGEN", "GPIOGRST", [0; 3]),
    (tables::GPIOH, "GPIOHEN", "GPIOHRST", [0; 3]),
    (tables::GPIOI, "GPIOIEN", "GPIOIRST", [0; 3]),
];

/// A port of a [`Part`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Port {
    A,
    B,
    C,
    D,
}

/// The connections of the part, which outlive its resets and power cuts.
#[derive(Clone, Debug, Default)]
pub struct Connections {
    /// CAN1, to the bus.
    pub can: Can1,
    /// The flash, which keeps its content.
    pub flash: SharedFlash,
    /// The console.
    pub terminal: Terminal,
    /// The view of the core by a debugger.
    pub core: CoreView,
    /// The oscillators.
    pub oscillators: Oscillators,
}

/// The oscillators of a board, at the start of the part.
#[derive(Clone, Debug, Default)]
pub struct Oscillators(Arc<Mutex<Rates>>);

/// The rates of [`Oscillators`].
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    /// The clock output of the ST-LINK at OSC_IN, in Hz. Without it the external oscillator never becomes ready.
    pub external: Option<u64>,
    /// The oscillator of the watchdog, in Hz: 17,000 to 47,000 (DS9405, DS10693).
    pub watchdog: u64,
}

impl Default for Rates {
    fn default() -> Self {
        Self { external: Some(HSE_HZ), watchdog: 32_000 }
    }
}

impl Oscillators {
    /// Locks the rates, for reading and changing.
    pub fn lock(&self) -> MutexGuard<'_, Rates> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The part of a board.
#[derive(Debug)]
pub struct Part {
    board: &'static Board,
    rcc: Clocks,
    pwr: Pwr,
    gpio: [Gpio; PORTS.len()],
    tim5: Tim<General>,
    console: Usart,
    dma1: Dma,
    iwdg: Iwdg,
    dbg: Dbg,
    dwt: Dwt,
    flash: FlashInterface,
    memory: MemorySectors,
    can: CanDevice,
    bus: Bus,
    slots: Slots,
    connections: Connections,
    /// The pins that are driven from outside.
    driven: Vec<(Port, u8, bool)>,
    /// The number of resets. Each tears an operation of the flash in another way.
    resets: u64,
}

#[derive(Debug, Clone, Copy)]
struct Slots {
    rcc: usize,
    pwr: usize,
    gpio: [usize; PORTS.len()],
    tim5: usize,
    console: usize,
    dma1: usize,
    iwdg: usize,
    dbg: usize,
    dwt: usize,
    flash: usize,
    memory: usize,
    can: usize,
}

impl Part {
    /// Creates the part at power-on.
    ///
    /// # Errors
    /// Returns an error for a contradictory description of the part.
    pub fn new(board: &'static Board, connections: Connections) -> Result<Self, Error> {
        let tim5 = Tim::with_clock(stock::HSI_HZ, Counter::Wide);
        let mut bus = describe(board, &tim5)?;
        let size = NonZeroU64::new(board.layout.size as u64).expect("the memory is not empty");
        let memory = bus.add_window(Window::new("memory", board.layout.base, size))?;
        let mut gpio = [usize::MAX; PORTS.len()];
        for (slot, (port, ..)) in gpio.iter_mut().zip(&PORTS[..board.ports]) {
            *slot = bus.slot(port.name)?;
        }
        let slots = Slots {
            rcc: bus.slot("RCC")?,
            pwr: bus.slot("PWR")?,
            gpio,
            tim5: bus.slot("TIM5")?,
            console: bus.slot(board.console.name())?,
            dma1: bus.slot("DMA1")?,
            iwdg: bus.slot("IWDG")?,
            dbg: bus.slot("DBG")?,
            dwt: bus.slot(armv7m::DWT)?,
            flash: bus.slot("FLASH")?,
            memory,
            can: bus.slot("CAN1")?,
        };
        let mut console = Usart::with_clock(Kind::Usart, stock::HSI_HZ);
        console.attach(connections.terminal.clone());
        let (button, pin) = board.button;
        let rates = *connections.oscillators.lock();
        let mut part = Self {
            board,
            rcc: Clocks::new(connections.can.clone(), rates.external.is_some()),
            pwr: Pwr::new(),
            gpio: std::array::from_fn(|_| Gpio::default()),
            tim5,
            console,
            dma1: Dma::new(&DMA1_REQUESTS, &[], false),
            iwdg: Iwdg::new(),
            dbg: Dbg,
            dwt: Dwt::with_clock(stock::HSI_HZ),
            flash: FlashInterface::new(connections.flash.clone()),
            memory: MemorySectors::new(connections.flash.clone(), bus.slots()[memory].peripheral().registers),
            can: CanDevice::new(connections.can.clone()),
            bus,
            slots,
            connections,
            // A resistor on the board drives the pin of the button.
            driven: vec![(button, pin, !board.pressed)],
            resets: 0,
        };
        part.rcc.rcc.attach_crystals(rates.external.unwrap_or_default(), NO_LSE);
        part.rcc.rcc.calibrate_lsi(rates.watchdog);
        part.pwr.set_supply(SUPPLY_MV, part.bus.slot_mut(slots.pwr).registers_mut());
        part.check()?;
        part.drive(button, pin, !board.pressed, VirtualNanos(0));
        Ok(part)
    }

    /// Drives a pin from outside.
    pub fn drive(&mut self, port: Port, pin: u8, high: bool, now: VirtualNanos) {
        let Some(number) = Pin::new(pin) else { return };
        self.driven.retain(|(other, of, _)| (*other, *of) != (port, pin));
        self.driven.push((port, pin, high));
        let (registers, mut context) = self.bus.drive(now, self.slots.gpio[port as usize]);
        self.gpio[port as usize].drive(number, Some(high.into()), registers, &mut context);
    }

    /// Sets the supply voltage.
    pub fn supply(&mut self, millivolts: u32) {
        self.pwr.set_supply(millivolts, self.bus.slot_mut(self.slots.pwr).registers_mut());
    }

    /// Cuts the supply or gives it back, at the next event.
    pub fn power(&mut self, on: bool, now: VirtualNanos) {
        self.bus.drive(now, self.slots.pwr).1.request_power(on);
    }

    /// Returns whether the firmware drives a pin high.
    #[must_use]
    pub fn is_high(&self, port: Port, pin: u8) -> bool {
        let registers = self.bus.slots()[self.slots.gpio[port as usize]].registers();
        registers.get(tables::gpioa::Register::Odr) >> pin & 1 == 1
    }
}

fn describe(board: &Board, tim5: &Tim<General>) -> Result<Bus, Error> {
    let console = board.console;
    let port_table = ErasedDevice::layout(&Gpio::default());
    let mut peripherals = vec![
        tables::RCC,
        tables::PWR,
        tables::FLASH,
        tables::IWDG,
        tables::CAN1,
        tables::DMA1,
        tables::SYSCFG,
        tables::EXTI,
        tables::DBG,
        console.table(),
        Peripheral { registers: ErasedDevice::layout(tim5), ..tables::TIM5 },
        armv7m::PERIPHERAL,
    ];
    if board.has_dckcfgr2 {
        peripherals[0].size = DCKCFGR2.base - tables::RCC.base;
        peripherals.push(DCKCFGR2);
    }
    peripherals.extend(PORTS[..board.ports].iter().map(|(port, ..)| Peripheral { registers: port_table, ..*port }));
    let cpu = Cpu::new(board.part, true, board.interrupt_lines, Endian::Little);
    let mut bus = Bus::builder(cpu, board.memory, peripherals)
        .reset("DBG", "DBGMCU_IDCODE", board.idcode)
        .reset(console.name(), "SR", USART_SR)
        .reset("TIM5", "ARR", Counter::Wide.mask())
        .write_modify("TIM5", "SR", WriteModify::ZeroToClear)
        .gate("PWR", Gate::by("RCC", "APB1ENR", "PWREN"))
        .gate("CAN1", Gate::by("RCC", "APB1ENR", "CAN1EN"))
        .reset_by("CAN1", Gate::by("RCC", "APB1RSTR", "CAN1RST"))
        .gate(console.name(), Gate::by("RCC", "APB1ENR", console.enable()))
        .reset_by(console.name(), Gate::by("RCC", "APB1RSTR", console.reset()))
        .clocked_by(console.name(), Clock::output("RCC", stock::PCLK1))
        .gate("DMA1", Gate::by("RCC", "AHB1ENR", "DMA1EN"))
        .reset_by("DMA1", Gate::by("RCC", "AHB1RSTR", "DMA1RST"))
        .reads_requests("DMA1")
        .gate("TIM5", Gate::by("RCC", "APB1ENR", "TIM5EN"))
        .reset_by("TIM5", Gate::by("RCC", "APB1RSTR", "TIM5RST"))
        .clocked_by("TIM5", Clock::output("RCC", stock::APB1_TIMERS))
        .gate_writes("RCC", &["BDCR"], Gate::by("PWR", "CR", "DBP"))
        .reads_requests("RCC")
        .clocked_by(armv7m::DWT, Clock::output("RCC", stock::HCLK))
        .clocked_by("IWDG", Clock::output("RCC", stock::IWDG_CLK));
    for (port, enable, reset, values) in &PORTS[..board.ports] {
        bus = bus
            .gate(port.name, Gate::by("RCC", "AHB1ENR", enable))
            .reset_by(port.name, Gate::by("RCC", "AHB1RSTR", reset));
        for (register, value) in ["MODER", "OSPEEDR", "PUPDR"].into_iter().zip(values) {
            bus = bus.reset(port.name, register, *value);
        }
    }
    bus.build()
}

impl Console {
    const fn name(self) -> &'static str {
        self.table().name
    }

    const fn table(self) -> Peripheral {
        match self {
            Self::Usart2 => tables::USART2,
            Self::Usart3 => tables::USART3,
        }
    }

    const fn enable(self) -> &'static str {
        match self {
            Self::Usart2 => "USART2EN",
            Self::Usart3 => "USART3EN",
        }
    }

    const fn reset(self) -> &'static str {
        match self {
            Self::Usart2 => "UART2RST",
            Self::Usart3 => "UART3RST",
        }
    }
}

impl Mcu for Part {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let slots = self.slots;
        if slot == slots.can {
            self.connections.can.lock().clock_hz = self.rcc.rcc.pclk1(self.bus.slots()[slots.rcc].registers());
        }
        if slot == slots.console {
            self.connections.terminal.damage(self.console.errors_mut());
        }
        if slot == slots.tim5 {
            // `rigless` 0.4.0 notes a compare match when EGR.UG finds the stopped counter equal to a compare register.
            // Silicon does not, and the clock of embassy would start 65536 ticks ahead.
            use tables::tim2::Register;
            let registers = self.bus.slot_mut(slot).registers_mut();
            if registers.get(Register::Cr1) & 1 == 0 {
                let status = registers.get(Register::Sr);
                registers.set(Register::Sr, status & !0x1E);
            }
        }
        let Self { rcc, pwr, gpio, tim5, console, dma1, iwdg, dbg, dwt, flash, memory, can, bus, .. } = self;
        let model: Option<&mut dyn ErasedDevice> = match slot {
            _ if slot == slots.can => Some(can),
            _ if slot == slots.memory => Some(memory),
            _ if slot == slots.flash => Some(flash),
            _ if slot == slots.tim5 => Some(tim5),
            _ if slot == slots.console => Some(console),
            _ if slot == slots.dma1 => Some(dma1),
            _ if slot == slots.rcc => Some(rcc),
            _ if slot == slots.pwr => Some(pwr),
            _ if slot == slots.iwdg => Some(iwdg),
            _ if slot == slots.dbg => Some(dbg),
            _ if slot == slots.dwt => Some(dwt),
            _ => match slots.gpio.iter().position(|port| *port == slot) {
                Some(port) => Some(&mut gpio[port]),
                None => None,
            },
        };
        (bus, model)
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        let flags = self.bus.slots()[self.slots.rcc].registers().get(tables::rcc::Register::Csr);
        self.connections.flash.lock().reset(at.0, self.resets);
        Device::reset(&mut self.can);
        let mut fresh = Self::new(self.board, self.connections.clone()).expect("a part that was assembled once");
        // A power-up also resets the flags of the last reset.
        if cause != ResetCause::PowerOn {
            let Self { rcc, bus, slots, .. } = &mut fresh;
            rcc.rcc.restarted(cause, flags, bus.slot_mut(slots.rcc).registers_mut());
        }
        for (port, pin, high) in &self.driven {
            fresh.drive(*port, *pin, *high, at);
        }
        fresh.resets = self.resets + 1;
        *self = fresh;
    }

    fn poll(&mut self, now: VirtualNanos) {
        let (registers, mut context) = self.bus.drive(now, self.slots.can);
        Device::poll(&mut self.can, registers, &mut context);
        let (registers, mut context) = self.bus.drive(now, self.slots.flash);
        Device::poll(&mut self.flash, registers, &mut context);
        let (registers, mut context) = self.bus.drive(now, self.slots.console);
        Device::poll(&mut self.console, registers, &mut context);
    }
}
