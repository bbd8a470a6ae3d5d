//! The watchdog resets the processor when the device's task does not run, or when a request to the memory is overdue.

use embassy_stm32::pac::DBGMCU;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Duration, Instant};

use super::link::LONGEST_SETTLE;
use super::nucleo::{STANDSTILL, WATCHDOG_US};
use super::storage::Client;

/// The longest time between two feedings by a device's task that waits for nothing else.
pub(super) const FEED: Duration = Duration::from_millis(100);

/// The frequency of the oscillator (LSI) by which the watchdog's time is set, and the highest one (DS9405, DS10693), in
/// kHz.
const TYPICAL_LSI_KHZ: u64 = 32;
const FASTEST_LSI_KHZ: u64 = 47;

/// The watchdog's time by the fastest oscillator.
const SHORTEST: Duration = Duration::from_micros(WATCHDOG_US as u64 * TYPICAL_LSI_KHZ / FASTEST_LSI_KHZ);
const _: () = assert!(SHORTEST.as_micros() > FEED.as_micros() + LONGEST_SETTLE.as_micros() + STANDSTILL.as_micros());

/// The watchdog, which runs.
pub(super) struct Watchdog(IndependentWatchdog<'static, IWDG>);

impl Watchdog {
    /// Starts the watchdog. To be called once, before anything that can wait for ever: for the clock, for the CAN
    /// controller.
    pub(super) fn start() -> Self {
        // Or it would reset the processor at a breakpoint.
        DBGMCU.apb1fzr().modify(|frozen| frozen.set_iwdg(true));
        // SAFETY: nobody else uses it, here or later.
        let mut watchdog = IndependentWatchdog::new(unsafe { IWDG::steal() }, WATCHDOG_US);
        watchdog.unleash();
        Self(watchdog)
    }

    /// Gives the device's task the whole time again, unless the memory hangs.
    pub(super) fn feed(&mut self, memory: &Client, now: Instant) {
        if !memory.hangs(now) {
            self.0.pet();
        }
    }
}
