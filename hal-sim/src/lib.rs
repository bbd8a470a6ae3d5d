//! The host's hardware for the stand-in devices, as a library: a deterministic world in virtual time.
//!
//! ```text
//! bus/      a CAN bus: frame lengths, arbitration, acknowledgement, error confinement; and the ports on it
//! memory/   a NOR flash in RAM, the record store on it, and the file that keeps it
//! use_case/ the use cases of the manuals, frame by frame
//! world/    devices, bus and plant in virtual time, event by event
//! ```
//!
//! Nothing in those waits, locks, prints or looks at a clock: whoever drives the [`World`] decides how
//! virtual time passes. Two runs with one seed and the same calls are the same to the last bit. Around them lies what
//! `pve-sim` makes of it:
//!
//! ```text
//! kind      the products, by name
//! devices/  which of them are on the bus, as they are written
//! speed     how virtual time passes against wall time
//! trace/    what happened on the bus, as other tools read it, and laid out for people
//! explain/  what a frame means, in words
//! describe/ the products for other tools: EDS and DBC
//! state/    a device's state, what acts on it, and conditions on both, in words
//! sender    frames sent on command, once or again and again
//! gateway/  clients of the bus that live outside: socketcand, SocketCAN, slcan, udp_multicast
//! recording/ the bus in a file, in the formats of other tools
//! decode    a recording, explained
//! replay/   a recording of a device against its stand-in
//! control/  state, faults and time over HTTP
//! scenario/ scenarios from files, in virtual time
//! run/      the world paced by the wall clock, with its clients, its trace and its memory
//! cli/      the command line
//! output   stdout of the commands
//! ```
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
//! [`World::set_plant`] breaks the valve, [`World::disturb`] and [`World::force_bus_off`] the bus, [`World::power`]
//! cuts the supply, [`World::link`] puts an angle sensor on the boom that the valve moves.
#![forbid(unsafe_code)]

pub mod bus;
pub mod cli;
pub mod control;
pub mod decode;
pub mod describe;
pub mod devices;
pub mod explain;
pub mod gateway;
pub mod kind;
pub mod memory;
pub mod output;
pub mod recording;
pub mod replay;
pub mod run;
pub mod scenario;
mod sender;
pub mod speed;
pub mod state;
pub mod trace;
pub mod use_case;
pub mod world;

pub use protocol_core::controller::BitRate;
pub use protocol_core::device::hat::Kind as SensorKind;
pub use protocol_core::device::pve::Kind as ValveKind;
pub use protocol_core::device::{Kind, Setup};
pub use protocol_core::frame::Frame;
pub use protocol_core::time::{Duration, Instant};

pub use bus::{BusError, Port, WireEvent};
pub use memory::Memory;
pub use world::{Client, ControllerId, Event, EventKind, NodeId, Plant, TapId, World};
