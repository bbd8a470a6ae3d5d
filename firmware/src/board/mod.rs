//! The board: its peripherals and tasks.

mod can;
mod clock;
mod console;
mod device;
mod flash;
mod led;
mod reset;

use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_stm32::wdg::IndependentWatchdog;

/// The device's task has so long, in microseconds, before the watchdog resets the processor. Erasing a sector takes the
/// flash half a second at the most, and the processor waits.
const WATCHDOG_US: u32 = 2_000_000;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let peripherals = embassy_stm32::init(clock::config());
    let cause = reset::cause();
    // Silicon before revision 3 reads bank 2 wrongly while this pin toggles: hold it low.
    core::mem::forget(Output::new(peripherals.PA12, Level::Low, Speed::Low));
    let can = can::Can1::new(peripherals.PD0, peripherals.PD1);
    let bank = Flash::new_blocking(peripherals.FLASH).into_blocking_regions().bank2_region1;
    let watchdog = IndependentWatchdog::new(peripherals.IWDG, WATCHDOG_US);
    let red = Output::new(peripherals.PB14, Level::Low, Speed::Low);
    let green = Output::new(peripherals.PB0, Level::Low, Speed::Low);
    let console = console::open(peripherals.USART3, peripherals.PD9, peripherals.PD8);
    // Each task is spawned once: there is room for it.
    if let Ok(task) = led::run(red, green) {
        spawner.spawn(task);
    }
    if let Ok(task) = console::run(console) {
        spawner.spawn(task);
    }
    if let Ok(task) = device::run(can, flash::Bank::new(bank), watchdog, cause) {
        spawner.spawn(task);
    }
}
