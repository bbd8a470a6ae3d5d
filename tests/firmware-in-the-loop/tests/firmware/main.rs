//! The flashed image on the emulated board. `./run` builds it first.

mod use_cases;
