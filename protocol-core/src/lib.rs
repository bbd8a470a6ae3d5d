//! A sans-IO protocol core that simulates Danfoss PVE valves and HYDAC HAT angle sensors on CANopen and ISOBUS.
//!
//! The crate uses no allocator, clock, I/O or `unsafe`. It computes in integers, and no input from the bus makes it
//! panic.
//!
//! # Layers
//!
//! A module imports only modules below it. At the bottom, [`wire`] converts between bytes and messages. Above it are
//! the product-independent services: [`canopen`], [`isobus`], and [`uds`], which both protocols use. Beside them are
//! the protocol-independent models: [`actuator`] of the valve and [`encoder`] of the angle sensor. [`device`] combines
//! services and models into products, which implement the trait [`Device`](device::Device). At the top, [`pump`] moves
//! frames between a CAN controller and a device.
//!
//! ```text
//! pump        moves frames between a CAN controller and a device
//! device/     the products, and their common trait Device
//! canopen/    the CANopen services              uds         the UDS lite server
//! isobus/     the J1939 and ISO 11783 services  answers     the answer queue of both nodes
//! actuator/   the protocol-independent valve    encoder     the protocol-independent angle sensor
//! memory/     records and their encoding
//! wire/       messages, one file each
//! frame, time, controller, outcome              common types
//! ```
//!
//! # A device on a bus
//!
//! Frames, time and inputs go in; frames and effects come out.
//!
//! ```
//! use protocol_core::device::{AnyDevice, Inputs, Kind, Setup, StartCause, pve};
//! use protocol_core::memory::Image;
//! use protocol_core::time::Instant;
//!
//! let now = Instant::from_secs(1);
//! let kind = Kind::Pve(pve::Kind::PveaCanopen);
//! let mut valve = AnyDevice::power_on(Setup::new(kind), &Image::empty(), StartCause::PowerOn, now);
//! let valve = valve.as_dyn_mut();
//! valve.sense(&Inputs::healthy(kind), now);
//! assert_eq!(valve.next_frame(now).unwrap().to_string(), "720: 00"); // boot-up
//! valve.all_sent(now);
//! assert_eq!(valve.next_frame(now).unwrap().to_string(), "0A0: 00 00 00 00 00 00 00 00"); // EMCY: no error
//! valve.all_sent(now);
//! assert!(valve.handle(&"620: 40 17 10 00 00 00 00 00".parse().unwrap(), now)); // SDO: reads the heartbeat time
//! assert_eq!(valve.next_frame(now).unwrap().to_string(), "5A0: 4B 17 10 00 00 00 00 00");
//! ```
//!
//! The repository's `docs/behaviour.md` specifies the devices. "SPEC 4.2" in a comment is section 4.2 of that page.
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
