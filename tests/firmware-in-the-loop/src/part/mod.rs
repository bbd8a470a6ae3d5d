//! The STM32F429ZI: from `rigless` the models of what it shares with the STM32F427 (clocks, power, GPIO, timers, UART,
//! watchdog, debug), from here CAN1, the flash interface and bank 2. What the firmware has no use for is not there: an
//! access to it fails the test.

mod can;
mod console;
mod flash;
mod rcc;

use std::num::NonZeroU64;

use rigless::cpu::armv7m::{self, Dwt};
use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32f427::generated as tables;
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc as stock;
use rigless::soc::stm32f427::peripherals::tim::{Counter, General, Tim};
use rigless::soc::stm32f427::peripherals::usart::{Kind, Usart};
use rigless::soc::{Bus, Clock, Cpu, Endian, Error, Gate, Peripheral, Region, Window, WriteModify};
use rigless::time::VirtualNanos;

pub use can::Can1;
pub use console::{Lines, Terminal};
pub use flash::SharedFlash;

use crate::flash::{BANK2, BANK2_SIZE};
use crate::warm::CoreView;
use can::CanDevice;
use flash::{Bank2, FlashInterface};
use rcc::Clocks;

/// Interrupt lines of the STM32F429 (RM0090 table 63).
const INTERRUPT_LINES: u16 = 91;
const CPU: Cpu = Cpu::new("STM32F429", true, INTERRUPT_LINES, Endian::Little);

static MEMORY: [Region; 4] = [
    // Programmed by nobody but tests that break the image.
    Region::flash("bank 1", 0x0800_0000, 1 << 20).programmed_by("FLASH"),
    Region::ram("ccm", 0x1000_0000, 64 << 10),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 192 << 10),
];
/// What of it forgets without a supply.
pub const RAM: [std::ops::Range<u64>; 2] = [0x1000_0000..0x1001_0000, 0x2000_0000..0x2003_0000];
/// The region that the processor boots from.
pub const BOOT: &str = "bank 1";

/// DBGMCU_IDCODE of revision 3 and later: before it, reads of bank 2 depend on PA12.
const IDCODE: u64 = 0x2003_6419;
/// USART_SR with an empty transmitter (RM0090 30.6.1, where a digit too many is printed).
const USART_SR: u64 = 0xC0;
const SUPPLY_MV: u32 = 3300;
/// The ST-LINK's clock output, which the NUCLEO feeds to OSC_IN.
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

/// A port of [`Stm32f429`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Port {
    A,
    B,
    C,
    D,
}

/// What is connected to the part from outside, and outlives it: resets and power cuts.
#[derive(Clone, Debug, Default)]
pub struct Connections {
    /// CAN1, to the bus.
    pub can: Can1,
    /// The flash: it keeps what it holds.
    pub flash: SharedFlash,
    /// The console on USART3.
    pub terminal: Terminal,
    /// A debugger's look at the core.
    pub core: CoreView,
}

/// The part.
#[derive(Debug)]
pub struct Stm32f429 {
    rcc: Clocks,
    pwr: Pwr,
    gpio: [Gpio; PORTS.len()],
    tim5: Tim<General>,
    usart3: Usart,
    iwdg: Iwdg,
    dbg: Dbg,
    dwt: Dwt,
    flash: FlashInterface,
    bank2: Bank2,
    can: CanDevice,
    bus: Bus,
    slots: Slots,
    connections: Connections,
    /// What pins are driven from outside.
    driven: Vec<(Port, u8, bool)>,
    /// How often it was reset: a torn flash operation is torn in another way each time.
    resets: u64,
}

#[derive(Debug, Clone, Copy)]
struct Slots {
    rcc: usize,
    pwr: usize,
    gpio: [usize; PORTS.len()],
    tim5: usize,
    usart3: usize,
    iwdg: usize,
    dbg: usize,
    dwt: usize,
    flash: usize,
    bank2: usize,
    can: usize,
}

impl Stm32f429 {
    /// The part at power-on.
    ///
    /// # Errors
    /// When the description of the part contradicts itself.
    pub fn new(connections: Connections) -> Result<Self, Error> {
        let tim5 = Tim::with_clock(stock::HSI_HZ, Counter::Wide);
        let mut bus = describe(&tim5)?;
        let size = NonZeroU64::new(BANK2_SIZE as u64).expect("bank 2 is not empty");
        let bank2 = bus.add_window(Window::new("bank 2", BANK2, size))?;
        let mut gpio = [0; PORTS.len()];
        for (slot, (port, ..)) in gpio.iter_mut().zip(&PORTS) {
            *slot = bus.slot(port.name)?;
        }
        let slots = Slots {
            rcc: bus.slot("RCC")?,
            pwr: bus.slot("PWR")?,
            gpio,
            tim5: bus.slot("TIM5")?,
            usart3: bus.slot("USART3")?,
            iwdg: bus.slot("IWDG")?,
            dbg: bus.slot("DBG")?,
            dwt: bus.slot(armv7m::DWT)?,
            flash: bus.slot("FLASH")?,
            bank2,
            can: bus.slot("CAN1")?,
        };
        let mut usart3 = Usart::with_clock(Kind::Usart, stock::HSI_HZ);
        usart3.attach(connections.terminal.clone());
        let mut part = Self {
            rcc: Clocks::new(connections.can.clone()),
            pwr: Pwr::new(),
            gpio: std::array::from_fn(|_| Gpio::default()),
            tim5,
            usart3,
            iwdg: Iwdg::new(),
            dbg: Dbg,
            dwt: Dwt::with_clock(stock::HSI_HZ),
            flash: FlashInterface::new(connections.flash.clone()),
            bank2: Bank2::new(connections.flash.clone(), bus.slots()[bank2].peripheral().registers),
            can: CanDevice::new(connections.can.clone()),
            bus,
            slots,
            connections,
            driven: Vec::new(),
            resets: 0,
        };
        part.rcc.rcc.attach_crystals(HSE_HZ, NO_LSE);
        part.pwr.set_supply(SUPPLY_MV, part.bus.slot_mut(slots.pwr).registers_mut());
        part.check()?;
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

    /// Cuts the supply, or gives it back: with the next thing that happens.
    pub fn power(&mut self, on: bool, now: VirtualNanos) {
        self.bus.drive(now, self.slots.pwr).1.request_power(on);
    }

    /// Whether the firmware drives a pin high.
    #[must_use]
    pub fn is_high(&self, port: Port, pin: u8) -> bool {
        let registers = self.bus.slots()[self.slots.gpio[port as usize]].registers();
        registers.get(tables::gpioa::Register::Odr) >> pin & 1 == 1
    }
}

fn describe(tim5: &Tim<General>) -> Result<Bus, Error> {
    let port_table = ErasedDevice::layout(&Gpio::default());
    let mut peripherals = vec![
        tables::RCC,
        tables::PWR,
        tables::FLASH,
        tables::IWDG,
        tables::CAN1,
        tables::SYSCFG,
        tables::EXTI,
        tables::DBG,
        tables::USART3,
        Peripheral { registers: ErasedDevice::layout(tim5), ..tables::TIM5 },
        armv7m::PERIPHERAL,
    ];
    peripherals.extend(PORTS.iter().map(|(port, ..)| Peripheral { registers: port_table, ..*port }));
    let mut bus = Bus::builder(CPU, &MEMORY, peripherals)
        .reset("DBG", "DBGMCU_IDCODE", IDCODE)
        .reset("USART3", "SR", USART_SR)
        .reset("TIM5", "ARR", Counter::Wide.mask())
        .write_modify("TIM5", "SR", WriteModify::ZeroToClear)
        .gate("PWR", Gate::by("RCC", "APB1ENR", "PWREN"))
        .gate("CAN1", Gate::by("RCC", "APB1ENR", "CAN1EN"))
        .reset_by("CAN1", Gate::by("RCC", "APB1RSTR", "CAN1RST"))
        .gate("USART3", Gate::by("RCC", "APB1ENR", "USART3EN"))
        .reset_by("USART3", Gate::by("RCC", "APB1RSTR", "UART3RST"))
        .clocked_by("USART3", Clock::output("RCC", stock::PCLK1))
        .gate("TIM5", Gate::by("RCC", "APB1ENR", "TIM5EN"))
        .reset_by("TIM5", Gate::by("RCC", "APB1RSTR", "TIM5RST"))
        .clocked_by("TIM5", Clock::output("RCC", stock::APB1_TIMERS))
        .gate_writes("RCC", &["BDCR"], Gate::by("PWR", "CR", "DBP"))
        .reads_requests("RCC")
        .clocked_by(armv7m::DWT, Clock::output("RCC", stock::HCLK))
        .clocked_by("IWDG", Clock::output("RCC", stock::IWDG_CLK));
    for (port, enable, reset, values) in &PORTS {
        bus = bus
            .gate(port.name, Gate::by("RCC", "AHB1ENR", enable))
            .reset_by(port.name, Gate::by("RCC", "AHB1RSTR", reset));
        for (register, value) in ["MODER", "OSPEEDR", "PUPDR"].into_iter().zip(values) {
            bus = bus.reset(port.name, register, *value);
        }
    }
    bus.build()
}

impl Mcu for Stm32f429 {
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
        if slot == slots.tim5 {
            // `rigless` 0.4.0 notes a compare match when EGR.UG finds the counter, stopped, equal to a compare register;
            // silicon does not, and embassy's clock would start 65536 ticks ahead.
            use tables::tim2::Register;
            let registers = self.bus.slot_mut(slot).registers_mut();
            if registers.get(Register::Cr1) & 1 == 0 {
                let status = registers.get(Register::Sr);
                registers.set(Register::Sr, status & !0x1E);
            }
        }
        let Self { rcc, pwr, gpio, tim5, usart3, iwdg, dbg, dwt, flash, bank2, can, bus, .. } = self;
        let model: Option<&mut dyn ErasedDevice> = match slot {
            _ if slot == slots.can => Some(can),
            _ if slot == slots.bank2 => Some(bank2),
            _ if slot == slots.flash => Some(flash),
            _ if slot == slots.tim5 => Some(tim5),
            _ if slot == slots.usart3 => Some(usart3),
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
        let mut fresh = Self::new(self.connections.clone()).expect("a part that was assembled once");
        // What comes with the power is as new, its flags of the last reset included.
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
        let (registers, mut context) = self.bus.drive(now, self.slots.usart3);
        Device::poll(&mut self.usart3, registers, &mut context);
    }
}
