//! The program `pve-sim`: the simulation of [`hal_sim`] in real time, for every CAN tool.
//!
//! # Layers
//!
//! [`cli`] turns a command line into a [`Request`](cli::Request), which `main` executes. For `run`, [`run`] paces the
//! world by the wall clock on a thread of its own. Clients live on other threads: [`gateway`] serves the clients of the
//! bus, [`http`] those of the control interface. Their messages reach the world through [`inbox`], and [`control`]
//! answers them there. The other commands have no clients: [`batch`] runs scenarios, [`campaign`] runs campaigns,
//! [`remote`] sends requests to a running simulator.
//!
//! ```text
//! cli/       the command line
//! run/       the world paced by the wall clock, with its clients, its trace and its memory
//! http/      state, faults and time over HTTP, and the panel
//! gateway/   clients of the bus: socketcand, SocketCAN, slcan, udp_multicast
//! inbox/     the messages between clients and the world
//! control/   the control interface on the world's thread
//! remote/    the commands set and status: requests to a running simulator
//! batch/     scenarios of a command line on all cores, and their results for CI
//! campaign/  the rows of a campaign on all cores, their results and reports
//! use_case   the built-in scenarios
//! state_file the memory of a device in a file
//! cores      tasks on several threads, with their results in order
//! output     stdout and the errors of the commands
//! ```
//!
//! This library exists for the tests of the program; other Rust programs should use [`hal_sim`].
//!
//! ```
//! use pve_sim::cli::{self, Request};
//!
//! let Ok(Request::Print(eds)) = cli::parse(["pve-sim", "eds", "pvea-canopen"]) else { panic!("wrong usage") };
//! assert!(eds.contains("ParameterName=Device control word"));
//! assert!(cli::parse(["pve-sim", "eds", "pvea-isobus"]).is_err(), "a kind on ISOBUS has a DBC");
//! ```
#![forbid(unsafe_code)]

pub mod batch;
pub mod campaign;
pub mod cli;
pub mod control;
mod cores;
pub mod gateway;
pub mod http;
pub mod inbox;
pub mod output;
pub mod remote;
pub mod run;
pub mod state_file;
pub mod use_case;
