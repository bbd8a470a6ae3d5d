//! The user button task. Each press injects the next fault.

use embassy_stm32::gpio::Input;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Timer};

use super::nucleo::PRESSED;
use super::wake_up::{Event, notify};

/// The signal of a button press.
pub(super) type Presses = Signal<CriticalSectionRawMutex, ()>;

/// The polling period of the button.
const LOOK: Duration = Duration::from_millis(10);
/// The number of consecutive polls with a new level that confirm a press or release.
const STEADY: u8 = 3;

#[embassy_executor::task]
pub(super) async fn run(button: Input<'static>, presses: &'static Presses) -> ! {
    let (mut pressed, mut looks) = (false, 0);
    loop {
        Timer::after(LOOK).await;
        looks = if (button.get_level() == PRESSED) == pressed { 0 } else { looks + 1 };
        if looks < STEADY {
            continue;
        }
        (pressed, looks) = (!pressed, 0);
        if pressed {
            presses.signal(());
            notify(Event::Controls);
        }
    }
}
