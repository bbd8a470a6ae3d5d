//! The NUCLEO-F429ZI (UM1974), with two LEDs and a second flash bank for the memory.

use embassy_stm32::flash::{Flash, InterruptHandler};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::pac::gpio::vals::Pupdr;
use embassy_stm32::pac::{self, GPIOA, Interrupt};
use embassy_stm32::peripherals::{DMA1_CH1, DMA1_CH3};
use embassy_stm32::{Peripherals, bind_interrupts, dma, interrupt};
use embassy_time::Duration;
use protocol_core::actuator::{Color, Led};

use super::can::Can1;
use super::flash::Sectors;
use super::led::is_on;
use super::serial::{self, Port};
use super::{CAN_PRIORITY, Nucleo};

/// The UART of the console, with its interrupt and the interrupts of its DMA streams.
pub(super) const UART: pac::usart::Usart = pac::USART3;
pub(super) const SERIAL: Interrupt = Interrupt::USART3;
pub(super) const RECEIVE: Interrupt = Interrupt::DMA1_STREAM1;
pub(super) const TRANSMIT: Interrupt = Interrupt::DMA1_STREAM3;

/// The time after which the watchdog resets the processor, in microseconds.
pub(super) const WATCHDOG_US: u32 = 500_000;

/// The maximum time for which the processor stalls: none, because it runs from bank 1 while bank 2 is erased.
pub(super) const STANDSTILL: Duration = Duration::MIN;

/// The level of the pressed button.
pub(super) const PRESSED: Level = Level::High;

/// The start of the memory in the flash: bank 2.
pub(super) const MEMORY: u32 = 0x10_0000;

bind_interrupts!(struct Interrupts {
    FLASH => InterruptHandler;
    DMA1_STREAM1 => dma::InterruptHandler<DMA1_CH1>;
    DMA1_STREAM3 => dma::InterruptHandler<DMA1_CH3>;
});

#[interrupt]
fn USART3() {
    serial::on_interrupt();
}

/// Opens the peripherals of the board.
pub(super) fn open(board: Peripherals) -> Nucleo {
    // Silicon before revision 3 reads bank 2 incorrectly unless this pin is a push-pull output at low level (ES0206).
    // The flash driver checks this, and also requires the pull-down.
    core::mem::forget(Output::new(board.PA12, Level::Low, Speed::Low));
    GPIOA.pupdr().modify(|pulls| pulls.set_pupdr(12, Pupdr::PULL_DOWN));
    Nucleo {
        can: Can1::new(board.PD0, board.PD1, CAN_PRIORITY),
        sectors: Sectors(Flash::new(board.FLASH, Interrupts)),
        console: Port::open(board.USART3, (board.PD9, board.PD8), (board.DMA1_CH1, board.DMA1_CH3), Interrupts),
        button: Input::new(board.PC13, Pull::Down),
        leds: Leds {
            red: Output::new(board.PB14, Level::Low, Speed::Low),
            green: Output::new(board.PB0, Level::Low, Speed::Low),
        },
    }
}

/// The LEDs LD3 (red) and LD1 (green). Both together are yellow.
pub(super) struct Leds {
    red: Output<'static>,
    green: Output<'static>,
}

impl Leds {
    /// Shows an LED state in a step of its pattern.
    pub(super) fn show(&mut self, led: Led, step: u8) {
        let on = is_on(led, step);
        self.red.set_level(Level::from(on && led.color != Color::Green));
        self.green.set_level(Level::from(on && led.color != Color::Red));
    }
}
