//! The options of `run`. The caller guarantees that they are consistent.

use std::net::SocketAddr;
use std::path::PathBuf;

use protocol_core::controller::BitRate;

use crate::control::Speed;
use crate::gateway::BusUrl;
use hal_sim::devices::{NamedDevice, NamedLink};

/// The options of `run`.
#[derive(Clone, Debug, PartialEq)]
pub struct RunOptions {
    /// The devices, in their order on the bus, with unique names.
    pub devices: Vec<NamedDevice>,
    /// The links.
    pub links: Vec<NamedLink>,
    /// The addresses of the bus; at least one.
    pub buses: Vec<BusUrl>,
    /// Whether beacons announce the buses.
    pub beacon: bool,
    /// Whether a multicast bus exchanges frames with other machines.
    pub allow_remote: bool,
    /// Whether communication faults may affect a bus with real devices.
    pub allow_real_bus: bool,
    /// The bit rate of the bus; `None` selects the rate of the first device.
    pub bit_rate: Option<BitRate>,
    /// The folder of the state files, if any.
    pub state: Option<PathBuf>,
    /// The speed of virtual time.
    pub speed: Speed,
    /// The address of the control interface, if any.
    pub http: Option<SocketAddr>,
    /// The log, if any.
    pub log: Option<LogOptions>,
    /// Whether clients receive error frames.
    pub error_frames: bool,
    /// The use of colour in the trace.
    pub color: ColorChoice,
    /// Whether the human-readable trace shows unchanged repeats of cyclic frames.
    pub verbose: bool,
    /// The seed of all random values.
    pub seed: u64,
}

/// The use of colour, which also selects the human-readable layout of the trace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ColorChoice {
    /// The layout on a terminal only, with colour unless the environment disables colour.
    #[default]
    Auto,
    /// The layout everywhere, even in a pipe, with colour.
    Always,
    /// The layout on a terminal only, without colour.
    Never,
}

/// The log of `run`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogOptions {
    /// The file.
    pub path: PathBuf,
    /// Whether an existing log may be overwritten.
    pub overwrite: bool,
}
