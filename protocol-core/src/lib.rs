//! The stand-in devices without hardware: a sans-IO protocol core for CAN hydraulic valves and angle sensors.
//!
//! No allocator, no clock, no I/O, no `unsafe`; integers only; no input from the bus may panic it. Imports run one way:
//!
//! ```text
//! wire/       bytes ↔ meaning: total functions, no state
//! actuator/   the valve without a protocol                encoder    the angle sensor without one
//! canopen/    services that know no product: CANopen     uds    the identifier server
//! isobus/     the same: J1939 and ISO 11783
//! memory/     records and their encoding              answers  the queue of answers that both nodes have
//! device/     the products, each a composition of the above, and `Device`, their common face
//! pump        moves frames between a CAN controller and a device
//! frame, time, controller, outcome   what all of them share
//! ```
//!
//! What the devices do, with every table, is in the repository's `docs/behaviour.md`; "SPEC 4.2" in a comment is its
//! section 4.2.
#![no_std]
#![forbid(unsafe_code)]
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    clippy::float_arithmetic,
    clippy::unreachable
)]
#![cfg_attr(
    test,
    allow(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

pub mod actuator;
mod answers;
pub mod canopen;
pub mod controller;
pub mod device;
pub mod encoder;
pub mod frame;
pub mod isobus;
pub mod memory;
pub mod outcome;
pub mod pump;
pub mod time;
pub mod uds;
pub mod wire;
