//! The stand-in's firmware image, unmodified, in an emulated NUCLEO-F429ZI on the simulated bus.
//!
//! ```text
//! image     the ELF file          symbols  what is in it, by crate     stack   how deep its stack gets
//! bxcan     the CAN controller    flash    bank 2 and its interface    part    the STM32F429ZI put together
//! machine   a board under power   warm     ... over resets             broken  the image broken on purpose
//! rig       boards on a bus       content  what their flash holds      bench   the bench of the use cases
//! ```
//!
//! The tests of the image are in `tests/firmware`, those of the models beside the models. What a test finds in the
//! emulator holds on silicon as far as the models go: each says at its head what it leaves out.
#![deny(unsafe_code)]

pub mod bench;
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
