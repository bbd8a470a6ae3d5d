//! The program `pve-sim`: the simulation of [`hal_sim`] in real time, for every CAN tool.
//!
//! ```text
//! cli/       the command line
//! run/       the world paced by the wall clock, with its clients, its trace and its memory
//! http/      state, faults and time over HTTP, and the panel
//! gateway/   clients of the bus that live outside: socketcand, SocketCAN, slcan, udp_multicast
//! inbox/     the messages between clients and the world
//! control/   the control interface at the world's end
//! remote/    a running simulator, asked by the commands set and status
//! batch/     scenarios of a command line, over the cores, and their results for CI
//! use_case   the scenarios that the program carries
//! state_file the memory of a device in a file
//! speed      virtual time against wall time
//! output     stdout of the commands
//! ```
//!
//! A library of its own for the sake of its tests; what a Rust program wants is [`hal_sim`].
#![forbid(unsafe_code)]

pub mod batch;
pub mod cli;
pub mod control;
pub mod gateway;
pub mod http;
pub mod inbox;
pub mod output;
pub mod remote;
pub mod run;
pub mod speed;
pub mod state_file;
pub mod use_case;
