//! The flashed image on the emulated board. `./run` builds it first.

mod angle_sensor;
mod bit_rates;
mod budgets;
mod bus_off;
mod button;
mod client;
mod console;
mod filters;
mod hands;
mod leds;
mod overtaking;
mod power_cut;
mod reception;
mod resets;
mod silicon;
mod storing;
mod use_cases;
