//! The watchdog, which resets the processor if the device task does not run or if a memory result is overdue.

use embassy_stm32::pac::DBGMCU;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Duration, Instant};

use super::link::LONGEST_SETTLE;
use super::nucleo::{STANDSTILL, WATCHDOG_US};
use super::storage::Client;

/// The maximum time between two feedings by an idle device task.
pub(super) const FEED: Duration = Duration::from_millis(100);

/// The nominal and the highest frequency of the watchdog oscillator (LSI), in kHz (DS9405, DS10693). The time-out of
/// the watchdog is defined at the nominal frequency.
const TYPICAL_LSI_KHZ: u64 = 32;
const FASTEST_LSI_KHZ: u64 = 47;

/// The time-out of the watchdog with the fastest oscillator.
const SHORTEST: Duration = Duration::from_micros(WATCHDOG_US as u64 * TYPICAL_LSI_KHZ / FASTEST_LSI_KHZ);
const _: () = assert!(SHORTEST.as_micros() > FEED.as_micros() + LONGEST_SETTLE.as_micros() + STANDSTILL.as_micros());

/// The running watchdog.
pub(super) struct Watchdog(IndependentWatchdog<'static, IWDG>);

impl Watchdog {
    /// Starts the watchdog. It is started once, before any code that can wait forever for the clock or the CAN
    /// controller.
    pub(super) fn start() -> Self {
        // Without this bit the watchdog would reset the processor at a breakpoint.
        DBGMCU.apb1fzr().modify(|frozen| frozen.set_iwdg(true));
        // SAFETY: there is no other user of the peripheral, now or later.
        let mut watchdog = IndependentWatchdog::new(unsafe { IWDG::steal() }, WATCHDOG_US);
        watchdog.unleash();
        Self(watchdog)
    }

    /// Restarts the watchdog timer, unless a result from the memory task is overdue.
    pub(super) fn feed(&mut self, memory: &Client, now: Instant) {
        if !memory.hangs(now) {
            self.0.pet();
        }
    }
}
