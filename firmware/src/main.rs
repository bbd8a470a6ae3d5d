//! The simulated device on an STM32 board: a NUCLEO-F429ZI or, with the feature `nucleo-f446re`, a NUCLEO-F446RE. The
//! board needs a 3.3 V CAN transceiver.
//!
//! ```text
//! board                 peripherals and tasks
//! board/nucleo_…        pins, watchdog and LEDs of each board
//! board/device          device task
//! board/wake_up         events that wake this task
//! board/link            joining and leaving the bus
//! board/can             CAN controller
//! board/local_controls  console and button, for the device task
//! board/console         console task
//! board/serial          serial port of the console
//! board/button          user button task
//! board/led             LED task
//! board/storage         memory task
//! board/flash           flash sectors of the memory
//! board/clock           clock tree
//! board/watchdog        watchdog
//! board/reset           cause of a start, and panics
//! ```
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(any(feature = "nucleo-f429zi", feature = "nucleo-f446re")))]
compile_error!("no board: enable one of the features nucleo-f429zi and nucleo-f446re");
#[cfg(all(feature = "nucleo-f429zi", feature = "nucleo-f446re"))]
compile_error!("two boards: nucleo-f446re needs --no-default-features");

#[cfg(target_os = "none")]
mod board;

#[cfg(not(target_os = "none"))]
mod flash_board;

/// Flashes the image. This is the program of the package on the host.
#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    flash_board::run()
}
