//! The unmodified firmware images in an emulated NUCLEO-F429ZI or NUCLEO-F446RE, on the simulated bus.
//!
//! ```text
//! image    ELF file of an image        symbols  symbols of an image, by crate
//! board    properties of the boards    content  contents of the flash of a board
//! bxcan    CAN controller              flash    flash interface and memory
//! part     the STM32                   machine  board under power
//! warm     processor over resets       stack    depth of the stack
//! boards   boards on a bus             rig      image with a master, or in a scenario
//! broken   image broken on purpose
//! ```
//!
//! The tests of the image are in `tests/firmware`, and the tests of a model are beside the model. A result in the
//! emulator holds on silicon as far as the models do: the head of each model lists what it lacks.
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
