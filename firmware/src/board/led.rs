//! The LEDs of the board: red and green; both are yellow.

use core::sync::atomic::{AtomicU8, Ordering};

use embassy_stm32::gpio::{Level, Output};
use embassy_time::{Duration, Timer};
use protocol_core::actuator::{Color, Led};
use protocol_core::controller::BusErrorMode;
use protocol_core::device::{Device, ProductSenses, Senses};

use super::attention::{Caller, call};

/// 1.5 Hz: 333 ms on, 333 ms off.
const HALF_PERIOD: Duration = Duration::from_millis(333);

const RED: u8 = 0b001;
const GREEN: u8 = 0b010;
const FLASHING: u8 = 0b100;

/// Returns what the LEDs show of a device: the LED of a valve. A sensor has none: they show what the board knows of it.
pub(super) fn led_of(device: &dyn Device, senses: &Senses) -> Led {
    if let Some(outputs) = device.outputs().valve() {
        return outputs.led;
    }
    let measuring_error = matches!(senses.product, ProductSenses::Encoder(shaft) if shaft.measuring_error);
    if senses.bus == BusErrorMode::BusOff {
        Led::RED
    } else if senses.internal_fault || measuring_error {
        Led::RED_FLASHING
    } else if device.node_id().is_none() {
        Led::YELLOW
    } else {
        Led::GREEN
    }
}

/// What the LEDs show.
pub(super) struct Lights(AtomicU8);

impl Lights {
    /// Dark.
    pub(super) const fn new() -> Self {
        Self(AtomicU8::new(0))
    }

    /// Shows this from the next half period on.
    pub(super) fn show(&self, led: Led) {
        let color = match led.color {
            Color::Red => RED,
            Color::Green => GREEN,
            Color::Yellow => RED | GREEN,
        };
        self.0.store(if led.flashing { color | FLASHING } else { color }, Ordering::Relaxed);
    }
}

#[embassy_executor::task]
pub(super) async fn run(mut red: Output<'static>, mut green: Output<'static>, lights: &'static Lights) {
    let mut lit = false;
    loop {
        // The device's task is above this one: it has answered when this is done.
        call(Caller::Leds);
        lit = !lit;
        let shown = lights.0.load(Ordering::Relaxed);
        let on = lit || shown & FLASHING == 0;
        red.set_level(Level::from(on && shown & RED != 0));
        green.set_level(Level::from(on && shown & GREEN != 0));
        Timer::after(HALF_PERIOD).await;
    }
}
