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
//! speed     how virtual time passes against wall time
//! trace/    what happened on the bus, as other tools read it
//! explain/  what a frame means, in words
//! describe/ the products for other tools: EDS and DBC
//! gateway/  clients of the bus that live outside: socketcand, SocketCAN
//! control/  state, faults and time over HTTP
//! run/      the world paced by the wall clock, with its clients, its trace and its memory
//! cli/      the command line
//! ```
#![forbid(unsafe_code)]

pub mod bus;
pub mod cli;
pub mod control;
pub mod describe;
pub mod explain;
pub mod gateway;
pub mod kind;
pub mod memory;
pub mod run;
pub mod speed;
pub mod trace;
pub mod use_case;
pub mod world;

pub use bus::{BusError, Port, WireEvent};
pub use memory::Memory;
pub use world::{ControllerId, Event, EventKind, NodeId, TapId, World};
