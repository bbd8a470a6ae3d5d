//! The board: its peripherals and tasks.
//!
//! | priority | what |
//! | --- | --- |
//! | [`CAN_PRIORITY`] | the interrupts of the CAN controller: frames into a queue |
//! | [`DEVICE_PRIORITY`] | the device's task, on an executor of its own |
//! | thread | memory, console, LEDs, button |

mod attention;
mod button;
mod can;
mod clock;
mod console;
mod device;
mod flash;
mod led;
mod link;
mod reset;
mod storage;

use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::flash::{Flash, InterruptHandler};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::pac::{self, Interrupt};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, interrupt};

/// The device's task has so long, in microseconds, before the watchdog resets the processor.
const WATCHDOG_US: u32 = 500_000;

const CAN_PRIORITY: Priority = Priority::P4;
const DEVICE_PRIORITY: Priority = Priority::P8;

/// Runs the device's task in the interrupt of a peripheral that is not used.
static DEVICE: InterruptExecutor = InterruptExecutor::new();

#[interrupt]
fn UART5() {
    // SAFETY: this is the handler of the interrupt that the executor is started with, which enables it.
    unsafe { DEVICE.on_interrupt() }
}

bind_interrupts!(struct Interrupts {
    FLASH => InterruptHandler;
});

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let peripherals = embassy_stm32::init(clock::config());
    pac::FLASH.acr().modify(|acr| {
        acr.set_prften(true);
        acr.set_icen(true);
        acr.set_dcen(true);
    });
    let cause = reset::cause();
    // Silicon before revision 3 reads bank 2 wrongly while this pin toggles: hold it low.
    core::mem::forget(Output::new(peripherals.PA12, Level::Low, Speed::Low));
    let can = can::Can1::new(peripherals.PD0, peripherals.PD1, CAN_PRIORITY);
    let watchdog = IndependentWatchdog::new(peripherals.IWDG, WATCHDOG_US);
    let sectors = flash::Sectors(Flash::new(peripherals.FLASH, Interrupts).into_regions().bank2_region1);
    let red = Output::new(peripherals.PB14, Level::Low, Speed::Low);
    let green = Output::new(peripherals.PB0, Level::Low, Speed::Low);
    let button = Input::new(peripherals.PC13, Pull::Down);
    let console = console::open(peripherals.USART3, peripherals.PD9, peripherals.PD8);
    Interrupt::UART5.set_priority(DEVICE_PRIORITY);
    // Each task is spawned once: there is room for it.
    if let Ok(task) = device::run(can, watchdog, cause) {
        DEVICE.start(Interrupt::UART5).spawn(task);
    }
    if let Ok(task) = storage::run(sectors) {
        spawner.spawn(task);
    }
    if let Ok(task) = console::run(console) {
        spawner.spawn(task);
    }
    if let Ok(task) = led::run(red, green) {
        spawner.spawn(task);
    }
    if let Ok(task) = button::run(button) {
        spawner.spawn(task);
    }
}
