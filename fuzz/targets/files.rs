//! `cargo fuzz run files`.
#![cfg_attr(fuzzing, no_main)]

fuzz::target!(files);
