//! `cargo fuzz run flash`.
#![cfg_attr(fuzzing, no_main)]

fuzz::target!(flash);
