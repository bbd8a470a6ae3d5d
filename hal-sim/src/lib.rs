//! A deterministic simulation of CAN valves and angle sensors on a bus, in virtual time.
//!
//! # Layers
//!
//! [`bus`] and [`memory`] form the lowest layer, the simulated hardware: CAN controllers on one bus, and a flash with
//! its record store. [`world`] runs devices on this hardware event by event, each with its controller and its plant.
//! [`devices`] configures the devices. [`log`] defines the records of frames, and [`explain`] explains frames.
//!
//! ```text
//! world/    devices, bus and plant in virtual time, event by event
//! devices/  devices and links in text form
//! explain/  explanations of frames
//! log/      frames and error frames with timestamps, and the line formats of `candump`
//! memory/   a NOR flash in RAM with a record store, and the file that backs the flash
//! bus/      a CAN bus and its ports: frame lengths, arbitration, acknowledgement, error confinement
//! text      escaping of user input in messages
//! ```
//!
//! Features add the layers above the world:
//!
//! ```text
//! simulation  simulation/  a world with commands to named devices, and its history of events
//! campaign    campaign/    each fault at each instant of a scenario, with verdicts
//! scenario    scenario/    scenarios from TOML files
//! recording   recording/   bus recordings in the file formats of other tools
//!             decode       explains a recording
//!             replay/      compares a recording of a device with its simulation
//! describe    describe/    product descriptions for other tools: EDS and DBC
//! state       state/       the state of a device and its plant as data, and conditions on the state
//! trace       trace/       human-readable lines for bus events
//! ```
//!
//! The library never waits, prints, starts a thread or reads a clock: the caller of [`World`] advances virtual time.
//! Two runs with the same seed and the same calls are identical.
//!
//! # Firmware under test
//!
//! Code that is generic over [`embedded_can::nb::Can`] can use a [`Client`] of a world as its CAN controller. Time is
//! virtual: a test of several seconds runs in milliseconds.
//!
//! ```
//! use embedded_can::{Frame as _, StandardId, nb::Can};
//! use hal_sim::{BitRate, Duration, Frame, ValveKind, World};
//!
//! let mut world = World::new(BitRate::Kbit250, 1);
//! let valve = world.add("valve", ValveKind::PveaCanopen);
//! let mut can = world.client("controller");
//! world.power(valve, true);
//! world.run_for(Duration::from_millis(100));
//!
//! let mut send = |id, data: &[u8]| can.transmit(&Frame::new(StandardId::new(id).unwrap(), data).unwrap()).unwrap();
//! send(0x000, &[0x01, 0x20]); // NMT: start node 0x20
//! for _ in 0..10 {
//!     send(0x220, &[0x0F, 0x00, 0x00, 0x20]); // RPDO: active, set-point 0x2000
//!     world.run_for(Duration::from_millis(100));
//! }
//! assert_eq!(world.view(valve).unwrap().position, 0x2000);
//! ```
//! [`World::set_plant`] changes the plant of a device, and [`World::fault`] adds a communication fault.
//! [`World::disturb`] destroys frames, [`World::force_bus_off`] forces a controller bus-off, and [`World::power`]
//! switches a device on or off. [`World::link`] mounts an angle sensor on the boom that the valve moves.
#![forbid(unsafe_code)]

pub mod bus;
#[cfg(feature = "campaign")]
pub mod campaign;
#[cfg(feature = "recording")]
pub mod decode;
#[cfg(feature = "describe")]
pub mod describe;
pub mod devices;
pub mod explain;
pub mod log;
pub mod memory;
#[cfg(feature = "recording")]
pub mod recording;
#[cfg(feature = "recording")]
pub mod replay;
#[cfg(feature = "scenario")]
pub mod scenario;
#[cfg(feature = "simulation")]
pub mod simulation;
#[cfg(feature = "state")]
pub mod state;
pub mod text;
#[cfg(feature = "trace")]
pub mod trace;
pub mod world;

/// Compiles and runs the examples of `docs/rust.md`.
#[cfg(all(doctest, feature = "simulation"))]
#[doc = include_str!("../../docs/rust.md")]
mod page {}

pub use protocol_core::controller::BitRate;
pub use protocol_core::device::hat::Kind as SensorKind;
pub use protocol_core::device::pve::Kind as ValveKind;
pub use protocol_core::device::{Kind, Setup};
pub use protocol_core::frame::Frame;
pub use protocol_core::time::{Duration, Instant};

pub use bus::{BusError, Port, WireEvent};
pub use memory::Memory;
pub use world::{Change, Client, ClientPortId, ControllerId, Event, EventKind, NodeId, World};
