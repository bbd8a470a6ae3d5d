//! The host side of `cargo flash-board`. It starts probe-rs, which flashes the image and shows its log.

use std::env::args_os;
use std::io::ErrorKind;
use std::process::{Command, ExitCode};

/// The name of the microcontroller, as probe-rs expects it.
const CHIP: &str = if cfg!(feature = "nucleo-f446re") { "STM32F446RETx" } else { "STM32F429ZITx" };

const MISSING: &str = "\
probe-rs was not found in PATH. In docs/board.md, \"probe-rs\" explains how to install it,
and \"Flashing\" explains how to flash without it.";

/// Runs probe-rs, or explains that it is missing.
pub(crate) fn run() -> ExitCode {
    let status = Command::new("probe-rs").args(["run", "--chip", CHIP]).args(args_os().skip(1)).status();
    match status {
        Ok(status) if status.success() => return ExitCode::SUCCESS,
        // probe-rs has printed the reason.
        Ok(_) => {}
        Err(error) if error.kind() == ErrorKind::NotFound => eprintln!("{MISSING}"),
        Err(error) => eprintln!("probe-rs: {error}"),
    }
    ExitCode::FAILURE
}
