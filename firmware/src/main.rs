//! The simulated device on an STM32 board: a NUCLEO-F429ZI or, with the feature `nucleo-f446re`, a NUCLEO-F446RE, and
//! any 3.3 V CAN transceiver.
//!
//! ```text
//! board            the peripherals and tasks
//! board/nucleo_…   one per board: pins, watchdog, LEDs
//! board/device     the device's task, highest priority      board/wake_up    the events that wake it
//! board/link       joining and leaving the bus              board/can        the CAN controller
//! board/local_controls  console and button, for that task   board/console    the console's task
//! board/storage    the memory's task                        board/flash      the flash sectors of the memory
//! board/led        the valve's LED                          board/serial     the console's serial port
//! board/clock      the clock tree                           board/button     fault injection by the user button
//! board/watchdog   the watchdog                             board/reset      the cause of a start, and panics
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

/// Flashes the image: the host program of this package, built with the entire workspace.
#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    flash_board::run()
}
