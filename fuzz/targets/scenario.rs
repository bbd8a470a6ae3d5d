//! `cargo fuzz run scenario`.
#![cfg_attr(fuzzing, no_main)]

fuzz::target!(scenario);
