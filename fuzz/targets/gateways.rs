//! `cargo fuzz run gateways`.
#![cfg_attr(fuzzing, no_main)]

fuzz::target!(gateways);
