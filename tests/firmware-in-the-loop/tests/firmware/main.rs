//! The flashed images on the emulated boards: on the NUCLEO-F429ZI, and in `f446re` what differs on the NUCLEO-F446RE.
//! `./run` builds them first.

mod against_host;
mod angle_sensor;
mod bit_rates;
mod budgets;
mod bus_off;
mod button;
mod client;
mod console;
mod core_alone;
mod damaged_lines;
mod f446re;
mod filters;
mod golden;
mod hands;
mod layout;
mod leds;
mod memory_functions;
mod minimal;
mod overtaking;
mod power_cut;
mod reception;
mod recordings;
mod resets;
mod silicon;
mod storing;
mod use_cases;
