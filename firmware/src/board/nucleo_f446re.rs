//! The NUCLEO-F446RE (UM1724), with one LED and one flash bank for image and memory.
//!
//! During a write or erase of the memory the processor stalls, because it cannot fetch instructions (RM0390 3.4). The
//! peripherals keep running: the CAN controller acknowledges frames and holds three.

use embassy_stm32::flash::{Flash, InterruptHandler};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::pac::{self, Interrupt};
use embassy_stm32::peripherals::{DMA1_CH5, DMA1_CH6};
use embassy_stm32::{Peripherals, bind_interrupts, dma, interrupt};
use embassy_time::{Duration, TICK_HZ};
use protocol_core::actuator::{Color, Led};

use super::can::Can1;
use super::flash::{LONGEST_ERASE, Sectors};
use super::led::{STEPS, is_on};
use super::serial::{self, Port};
use super::{CAN_PRIORITY, Nucleo};

/// The UART of the console, with its interrupt and the interrupts of its DMA streams.
pub(super) const UART: pac::usart::Usart = pac::USART2;
pub(super) const SERIAL: Interrupt = Interrupt::USART2;
pub(super) const RECEIVE: Interrupt = Interrupt::DMA1_STREAM5;
pub(super) const TRANSMIT: Interrupt = Interrupt::DMA1_STREAM6;

/// The time after which the watchdog resets the processor, in microseconds.
pub(super) const WATCHDOG_US: u32 = 1_000_000;

/// The maximum time for which the processor stalls: the erase of a sector.
pub(super) const STANDSTILL: Duration = LONGEST_ERASE;

/// The ticks between two interrupts of the 16-bit clock. The clock would lose time if two interrupts came during one
/// erase.
const CLOCK_HALF: u64 = 0x8000;
const _: () = assert!(CLOCK_HALF * 1000 > STANDSTILL.as_millis() * TICK_HZ);

/// The level of the pressed button.
pub(super) const PRESSED: Level = Level::Low;

/// The start of the memory in the flash: sector 1. Sector 0 holds the vectors.
pub(super) const MEMORY: u32 = 0x4000;

bind_interrupts!(struct Interrupts {
    FLASH => InterruptHandler;
    DMA1_STREAM5 => dma::InterruptHandler<DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<DMA1_CH6>;
});

#[interrupt]
fn USART2() {
    serial::on_interrupt();
}

/// Opens the peripherals of the board.
pub(super) fn open(board: Peripherals) -> Nucleo {
    Nucleo {
        can: Can1::new(board.PB8, board.PB9, CAN_PRIORITY),
        sectors: Sectors(Flash::new(board.FLASH, Interrupts)),
        console: Port::open(board.USART2, (board.PA3, board.PA2), (board.DMA1_CH5, board.DMA1_CH6), Interrupts),
        button: Input::new(board.PC13, Pull::Up),
        leds: Leds(Output::new(board.PA5, Level::Low, Speed::Low)),
    }
}

/// The LED LD2, which is green. It shows each colour by a rhythm.
pub(super) struct Leds(Output<'static>);

/// The rhythm of two short flashes per second.
const PAIRS: u32 = 0b000000101_000000101;
/// The rhythm that is alternately dark and lit.
const FLICKER: u32 = 0b010101010_101010101;
const _: () = assert!(STEPS == 18);

impl Leds {
    /// Shows an LED state in a step of its pattern: green unchanged, yellow as a short flash every two seconds,
    /// flashing red as pairs of short flashes, red as a flicker.
    pub(super) fn show(&mut self, led: Led, step: u8) {
        let on = match led.color {
            Color::Green => is_on(led, step),
            Color::Yellow => step == 0,
            Color::Red => (if led.flashing { PAIRS } else { FLICKER }) >> step & 1 != 0,
        };
        self.0.set_level(Level::from(on));
    }
}
