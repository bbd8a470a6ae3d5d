//! The simulation as a library: CAN valves and angle sensors on a bus, deterministic, in virtual time.
//!
//! # Layers
//!
//! At the bottom stand [`bus`] and [`memory`], the hardware of the host: controllers on one wire, and a flash with its
//! records. [`world`] runs devices on them event by event, each through its controller and with its plant. [`devices`]
//! sets such devices up. [`log`] and [`explain`] look at a bus from outside: what was on it, and what it means.
//!
//! ```text
//! world/    devices, bus and plant in virtual time, event by event
//! devices/  devices as a command line names them, links between them, and whether they are heard
//! explain/  the meaning of frames, in words
//! log/      frames and error frames with their times, as other tools write them
//! memory/   a NOR flash in RAM, the record store on it, and the file that keeps it
//! bus/      a CAN bus: frame lengths, arbitration, acknowledgement, error confinement; and the ports on it
//! text      a text in one line, for messages
//! ```
//!
//! Features add what stands above the world:
//!
//! ```text
//! simulation  simulation/  a world, commands to it by the names of its devices, and what has happened
//! scenario    scenario/    scenarios from TOML files
//! recording   recording/   the bus in a file, in the formats of other tools
//!             decode       a recording, explained
//!             replay/      a recording of a device against its simulation
//! describe    describe/    the products for other tools: EDS and DBC
//! state       state/       a device's state as data, its plant, and conditions on both
//! trace       trace/       the bus laid out for people
//! ```
//!
//! Nothing here waits, prints, starts a thread or reads a clock: the caller of [`World`] lets virtual time pass. Two
//! runs with one seed and the same calls are the same to the last bit.
//!
//! # Firmware under test
//!
//! Code that is generic over [`embedded_can::nb::Can`] takes a [`Client`] of a world for its CAN controller. Time is
//! virtual: a test of seconds takes milliseconds.
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
//!
//! [`World::set_plant`] breaks the valve, [`World::fault`] the communication, [`World::disturb`] and
//! [`World::force_bus_off`] the bus; [`World::power`] cuts the supply, [`World::link`] puts an angle sensor on the boom that
//! the valve moves.
#![forbid(unsafe_code)]

pub mod bus;
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

/// The examples of the page compile and pass.
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
pub use world::{Client, ClientPortId, ControllerId, Event, EventKind, NodeId, Plant, World};
