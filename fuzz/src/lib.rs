//! Attacks with any bytes: on the devices behind their ports and memories, and on every reader of what strangers write.
//!
//! An attack is a function over bytes that panics when a promise is broken. `cargo fuzz` looks for such bytes
//! (`cargo fuzz run scenario`); `cargo test --package fuzz` plays the cases of `cases/` with any toolchain, and
//! `cargo run --package fuzz --bin scenario FILE...` plays the ones that are given.
#![forbid(unsafe_code)]

mod control;
mod devices;
mod files;
mod gateways;
mod keyboard;
mod room;
mod scenario;
mod simulator;

pub use control::control;
pub use devices::{devices, flash};
pub use files::files;
pub use gateways::gateways;
pub use scenario::scenario;

/// An attack: panics when its bytes break a promise.
pub type Attack = fn(&[u8]);

/// Every attack with its name: that of its target in `targets/` and of its folder in `cases/`.
pub const ATTACKS: &[(&str, Attack)] = &[
    ("control", control),
    ("devices", devices),
    ("files", files),
    ("flash", flash),
    ("gateways", gateways),
    ("scenario", scenario),
];

/// The program of a target: given to `cargo fuzz`, it runs the attack with what that one makes up; else with the content
/// of the files on the command line.
#[macro_export]
macro_rules! target {
    ($attack:ident) => {
        #[cfg(fuzzing)]
        libfuzzer_sys::fuzz_target!(|bytes: &[u8]| fuzz::$attack(bytes));

        #[cfg(not(fuzzing))]
        fn main() -> std::io::Result<()> {
            for file in std::env::args_os().skip(1) {
                fuzz::$attack(&std::fs::read(file)?);
            }
            Ok(())
        }
    };
}
