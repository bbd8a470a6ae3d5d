//! The options of `run`, and their forms on the command line.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::PathBuf;

use clap::{Args, ValueHint};
use protocol_core::controller::BitRate;

use crate::control::Speed;
use crate::gateway::BusUrl;
use hal_sim::devices::{self, NamedDevice, NamedLink};

/// The default seed: two runs with the same seed and input are identical.
pub(crate) const DEFAULT_SEED: u64 = 1;

/// The default address of the control interface.
pub(crate) const DEFAULT_HTTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 8408));

/// The options of `run`. The caller guarantees that they are consistent.
#[derive(Args, Clone, Debug, PartialEq)]
pub struct RunOptions {
    /// The devices, in their order on the bus, with unique names.
    #[arg(skip)]
    pub devices: Vec<NamedDevice>,

    /// The links between the devices.
    #[arg(skip)]
    pub links: Vec<NamedLink>,

    /// Keep the memory of each device in DIR/NAME.nvm; without this option, the memory is lost at exit
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, help_heading = "Devices")]
    pub state: Option<PathBuf>,

    /// A URL at which clients reach the bus; repeatable [default: socketcand://127.0.0.1:29536/pve0]
    ///
    /// URL is one of
    ///   socketcand://HOST:PORT/NAME  a socketcand server on TCP; port 0 selects a free port
    ///   slcan://HOST:PORT            a serial-line adapter on TCP; port 0 selects a free port
    ///   slcan+pty:PATH               a serial-line adapter on a pseudo-terminal, with a symbolic
    ///                                link at PATH; Unix only
    ///   socketcan:IFACE              a CAN interface of Linux
    ///   udp-multicast://GROUP:PORT   a group of python-can's udp_multicast; other machines are
    ///                                reached with --allow-remote only
    #[arg(long = "bus", value_name = "URL", default_values_t = [BusUrl::default()], hide_default_value = true)]
    #[arg(help_heading = "Bus", verbatim_doc_comment)]
    pub buses: Vec<BusUrl>,

    /// Announce socketcand buses by UDP to port 42000, so that python-can and SavvyCAN can find them
    #[arg(long, help_heading = "Bus")]
    pub beacon: bool,

    /// Allow communication faults with --bus socketcan:, where they can affect real devices; without this option, only
    /// simulated devices can lose frames
    #[arg(long, help_heading = "Bus")]
    pub allow_real_bus: bool,

    /// The bit rate of the bus in bit/s, or with k or M, as in 250k [default: the rate of the first device, by default
    /// 250k for a valve and 500k for an angle sensor]
    #[arg(long, value_name = "N", value_parser = bit_rate, help_heading = "Bus")]
    pub bit_rate: Option<BitRate>,

    /// The speed of virtual time: a factor of wall time above 0, or step: only the control interface advances time, and
    /// the frames of clients wait for the next advance
    #[arg(long, value_name = "FACTOR|step", value_parser = speed, default_value = "1", help_heading = "Time")]
    pub speed: Speed,

    /// The seed of all random values: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed, default_value_t = DEFAULT_SEED, help_heading = "Time")]
    pub seed: u64,

    /// The log, if any.
    #[command(flatten)]
    pub log: Option<LogOptions>,

    /// Send error frames to clients: the first one of each destroyed frame, and one for each change of an error mode
    #[arg(long, help_heading = "Output")]
    pub error_frames: bool,

    /// Colour in the trace: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a
    /// pipe) or never
    #[arg(long, value_name = "WHEN", default_value = "auto", hide_possible_values = true, help_heading = "Output")]
    pub color: ColorChoice,

    /// Show every cyclic frame on a terminal, including unchanged repeats
    #[arg(long, help_heading = "Output")]
    pub verbose: bool,

    /// The address of the control interface; port 0 selects a free port [default: 127.0.0.1:8408]
    #[arg(long, value_name = "ADDR:PORT", value_parser = http, conflicts_with = "no_http", help_heading = "Control")]
    #[arg(default_value_t = DEFAULT_HTTP, hide_default_value = true)]
    pub http: SocketAddr,

    /// Disable the control interface
    #[arg(long, help_heading = "Control")]
    pub no_http: bool,

    /// Allow an --http address that other machines can reach, which gives them full control, and allow a udp-multicast
    /// bus to reach other machines
    #[arg(long, help_heading = "Control")]
    pub allow_remote: bool,
}

impl RunOptions {
    /// Returns the address of the control interface, if any.
    #[must_use]
    pub fn http(&self) -> Option<SocketAddr> {
        (!self.no_http).then_some(self.http)
    }
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
#[derive(Args, Clone, Debug, PartialEq, Eq)]
pub struct LogOptions {
    /// Write every frame to FILE, in the format of its extension: .asc (ASC), .pcapng (pcapng), any other (candump -L)
    #[arg(id = "log", long = "log", required = false, value_name = "FILE", value_hint = ValueHint::FilePath)]
    #[arg(help_heading = "Output")]
    pub path: PathBuf,

    /// Overwrite the --log file if it is not empty
    #[arg(id = "log_overwrite", long = "log-overwrite", requires = "log", help_heading = "Output")]
    pub overwrite: bool,
}

fn bit_rate(text: &str) -> Result<BitRate, String> {
    devices::bit_rate(text).ok_or_else(|| {
        let rates: Vec<String> = BitRate::ALL.iter().rev().map(|rate| rate.bits_per_second().to_string()).collect();
        format!("not a bit rate of CiA 301; accepted: {}", rates.join(", "))
    })
}

pub(crate) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("must be a whole number, 0–{}", u64::MAX))
}

fn speed(text: &str) -> Result<Speed, String> {
    if text == "step" {
        return Ok(Speed::STEP);
    }
    let factor = text.parse::<f64>().ok().filter(|factor| factor.is_finite() && *factor > 0.0);
    factor.map(Speed::Factor).ok_or_else(|| "must be a number above 0, as in 1, 0.5 or 100, or step".to_owned())
}

fn http(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| format!("must be ADDR:PORT, as in {DEFAULT_HTTP}; port 0 selects a free one"))
}
