//! CAN hydraulic valves and angle sensors without hardware: a sans-IO protocol core for CANopen and ISOBUS.
//!
//! The crate uses no allocator, no clock, no I/O and no `unsafe`. It computes in integers, and no input from the bus
//! makes it panic.
//!
//! # Layers
//!
//! Imports run downwards. At the bottom, [`wire`] converts between bytes and meaning, in total functions without state.
//! Above it stand the services, which know no product: [`canopen`], [`isobus`], and [`uds`], which both protocols
//! share. Beside them stand the machines, which know no protocol: [`actuator`] is the valve, [`encoder`] the angle
//! sensor. [`device`] composes the products from services and machines, behind the trait [`Device`](device::Device). At
//! the top, [`pump`] moves frames between a CAN controller and a device.
//!
//! ```text
//! pump        moves frames between a CAN controller and a device
//! device/     the products, and Device, the trait that all of them implement
//! canopen/    the services of CANopen           uds         the identifier server
//! isobus/     those of J1939 and ISO 11783      answers     the queue of answers that both nodes have
//! actuator/   the valve without a protocol      encoder     the angle sensor without one
//! memory/     records and their encoding
//! wire/       messages: one file each
//! frame, time, controller, outcome              the types that all of them share
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
//! let mut valve = AnyDevice::power_on(Setup::<Kind>::new(kind), &Image::empty(), StartCause::PowerOn, now);
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
//! The repository's `docs/behaviour.md` says what the devices do, with every table; "SPEC 4.2" in a comment is its
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
