//! The stand-in device on an STM32 board: a NUCLEO-F429ZI or, by the feature `nucleo-f446re`, a NUCLEO-F446RE, with any
//! 3.3 V CAN transceiver.
//!
//! ```text
//! board            the wiring: which task has what
//! board/nucleo_…   one board each: its pins, watchdog, LEDs
//! board/device     the device's task, above all others      board/wake_up    the events that wake it
//! board/link       on the bus and off it                    board/can        the CAN controller
//! board/local_controls  console and button, for that task   board/console    the console's task
//! board/storage    the memory's task                        board/flash      the sectors it has
//! board/led        the valve's LED                          board/serial     their characters
//! board/clock      the clock tree                           board/button     faults by hand
//! board/watchdog   the watchdog's time                      board/reset      why the processor starts
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

/// Flashes the image: on the host, where the whole workspace is built, this is the program of the package.
#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    flash_board::run()
}
