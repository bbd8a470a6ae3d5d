//! The flashed image on the emulated board. `./run` builds it first.

mod bit_rates;
mod bus_off;
mod client;
mod reception;
mod use_cases;
