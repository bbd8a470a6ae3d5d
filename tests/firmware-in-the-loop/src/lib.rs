//! The unmodified firmware images in an emulated NUCLEO-F429ZI or NUCLEO-F446RE, on the simulated bus.
//!
//! ```text
//! image     the ELF file          symbols  what is in it, by crate     stack   how deep its stack gets
//! bxcan     the CAN controller    flash    its interface and memory    part    the STM32 put together
//! machine   a board under power   warm     ... over resets             broken  the image broken on purpose
//! boards    boards on a bus       content  their flash content     rig     the image with a master, or in a scenario
//! board     what differs between the boards
//! ```
//!
//! The tests of the image are in `tests/firmware`, those of the models beside the models. What a test finds in the
//! emulator holds on silicon as far as the models go: each says at its head what it leaves out.
#![deny(unsafe_code)]

pub mod board;
pub mod boards;
pub mod broken;
pub mod bxcan;
pub mod content;
pub mod flash;
pub mod image;
pub mod machine;
pub mod part;
pub mod rig;
pub mod stack;
pub mod symbols;
pub mod warm;
