//! `cargo fuzz run devices`.
#![cfg_attr(fuzzing, no_main)]

fuzz::target!(devices);
