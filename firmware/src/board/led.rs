//! The LED of the device, shown on the LEDs of the board.

use core::cell::Cell;

use critical_section::Mutex;
use embassy_time::{Duration, Timer};
use protocol_core::actuator::Led;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::{Device, Inputs, ProductInputs};

use super::nucleo::Leds;
use super::wake_up::{Event, notify};

/// The duration of a step of the LED pattern. Three steps are half a period of 1.5 Hz.
const STEP: Duration = Duration::from_millis(111);
/// The number of steps in half a period: 333 ms on, 333 ms off.
const HALF_PERIOD: u8 = 3;
/// The number of steps in the entire pattern.
pub(super) const STEPS: u8 = 18;

/// Returns the LED state of a device. A sensor has no LED, so its state is derived from its inputs.
pub(super) fn led_of(device: &dyn Device, inputs: &Inputs) -> Led {
    if let Some(outputs) = device.outputs().valve() {
        return outputs.led;
    }
    let measuring_error = matches!(inputs.product, ProductInputs::Encoder(shaft) if shaft.measuring_error);
    if inputs.bus == BusErrorMode::BusOff {
        Led::RED
    } else if inputs.internal_fault || measuring_error {
        Led::RED_FLASHING
    } else if device.node_id().is_none() {
        Led::YELLOW
    } else {
        Led::GREEN
    }
}

/// The state that the LEDs show. Before the first state it is `None`, and the LEDs are off.
pub(super) struct Lights(Mutex<Cell<Option<Led>>>);

impl Lights {
    /// Creates the state of LEDs that are off.
    pub(super) const fn new() -> Self {
        Self(Mutex::new(Cell::new(None)))
    }

    /// Shows a state, beginning with the next step.
    pub(super) fn show(&self, led: Led) {
        critical_section::with(|cs| self.0.borrow(cs).set(Some(led)));
    }

    fn shown(&self) -> Option<Led> {
        critical_section::with(|cs| self.0.borrow(cs).get())
    }
}

/// Returns whether an LED in this state is on in a step.
pub(super) const fn is_on(led: Led, step: u8) -> bool {
    !led.flashing || (step / HALF_PERIOD).is_multiple_of(2)
}

#[embassy_executor::task]
pub(super) async fn run(mut leds: Leds, lights: &'static Lights) -> ! {
    let mut step = 0;
    loop {
        // The device task, which has a higher priority, has updated the lights when this call returns.
        notify(Event::Leds);
        if let Some(led) = lights.shown() {
            leds.show(led, step);
        }
        step = (step + 1) % STEPS;
        Timer::after(STEP).await;
    }
}
