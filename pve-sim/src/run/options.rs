//! The options of `run`. The caller has checked them against each other.

use std::net::SocketAddr;
use std::path::PathBuf;

use protocol_core::controller::BitRate;

use crate::gateway::BusUrl;
use crate::speed::Speed;
use hal_sim::devices::{NamedDevice, NamedLink};

/// The options of `run`.
#[derive(Clone, Debug, PartialEq)]
pub struct RunOptions {
    /// The devices, in their order on the bus. Each has another name.
    pub devices: Vec<NamedDevice>,
    /// The shafts that follow a valve.
    pub links: Vec<NamedLink>,
    /// Where the bus is served; at least one.
    pub buses: Vec<BusUrl>,
    /// Whether beacons announce the buses.
    pub beacon: bool,
    /// Whether frames pass between this machine and others, where a URL leaves that open.
    pub allow_remote: bool,
    /// The rate of the bus; `None`: that of the first device.
    pub bit_rate: Option<BitRate>,
    /// Where memories are kept; `None`: nowhere.
    pub state: Option<PathBuf>,
    /// How virtual time passes.
    pub speed: Speed,
    /// Where the control interface is served; `None`: nowhere.
    pub http: Option<SocketAddr>,
    /// Where every frame is logged; `None`: nowhere.
    pub log: Option<LogOptions>,
    /// Whether clients get error frames.
    pub error_frames: bool,
    /// Whether the trace has colour.
    pub color: ColorChoice,
    /// Whether a trace for people shows every frame, repeats of cyclic frames among them.
    pub verbose: bool,
    /// The seed of everything random.
    pub seed: u64,
}

/// Whether the trace has colour, and with it whether it is laid out for people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ColorChoice {
    /// Laid out on a terminal, with colour unless the environment asks for none.
    #[default]
    Auto,
    /// Laid out with colour, into a pipe, too.
    Always,
    /// Laid out on a terminal, without colour.
    Never,
}

/// The log of `run`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogOptions {
    /// The file.
    pub path: PathBuf,
    /// Whether what is in it already may be lost.
    pub overwrite: bool,
}
