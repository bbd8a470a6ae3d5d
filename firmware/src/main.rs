//! The stand-in device on an STM32 board (NUCLEO-F429ZI, any 3.3 V CAN transceiver on PD0 and PD1).
//!
//! ```text
//! board/clock    the clock tree          board/can      the CAN controller
//! board/device   the device's task       board/flash    its memory
//! board/led      red and green           board/console  USART3: what the device senses, changed by hand
//! board/reset    why the processor starts, and what a panic does
//! ```
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

/// The host builds, lints and tests the whole workspace: there the image is an empty program.
#[cfg(not(target_os = "none"))]
fn main() {}
