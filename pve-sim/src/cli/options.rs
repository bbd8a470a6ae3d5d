//! The arguments of `run`, and their conversion to checked options.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::PathBuf;

use clap::{Args, ValueHint};
use protocol_core::controller::BitRate;
use protocol_core::device::pve;

use super::UsageError;
use crate::campaign::Which;
use crate::control::Speed;
use crate::gateway::BusUrl;
use crate::run::{ColorChoice, LogOptions, RunOptions};
use hal_sim::Kind;
use hal_sim::devices::{self, DeviceSpec, NamedDevice, NamedLink};

/// The default seed: two runs with the same seed and input are identical.
pub(super) const DEFAULT_SEED: u64 = 1;

/// The default address of the control interface.
pub(super) const DEFAULT_HTTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 8408));

/// The kind of the default device.
const DEFAULT_KIND: Kind = Kind::Pve(pve::Kind::PveaCanopen);

/// The arguments of `run`.
#[derive(Args, Debug)]
pub struct RunArgs {
    /// A device on the bus; repeatable [default: pvea-canopen@0x20]
    ///
    /// KIND is one of
    ///   pvea-canopen  proportional valve on CANopen
    ///   pveo-canopen  on/off valve on CANopen
    ///   pvea-isobus   proportional valve on ISOBUS
    ///   pveo-isobus   on/off valve on ISOBUS
    ///   hat1000       angle sensor on CANopen
    ///   hat3000       angle sensor on CANopen
    ///
    /// ID, decimal or 0x, is
    ///   on CANopen the node ID, 1–127, by default 0x20 for a valve and 1 for an angle sensor
    ///   on ISOBUS the address, 0x80–0x8F, by default 0x80
    ///
    /// The keys:
    ///   name=NAME  1–32 characters of a–z, 0–9 and '-'; by default the kind, then kind-2 …
    ///   serial=N   decimal or 0x; by default the next free number; part of the NAME on ISOBUS
    ///   bit-rate=N by default the rate of the bus; a valve accepts 125k, 250k and 500k (only
    ///              250k on ISOBUS), an angle sensor any rate of --bit-rate
    ///   stroke-ms=N, return-ms=N
    ///              valves only, 10–5000 ms: the time of the spool from neutral to full stroke,
    ///              by default 250; the time of the springs for its return, by default 150
    ///   boot-ms=N  0–60000 ms from power-up to the start of the program, by default 0
    ///   answer-ms=N or A..B
    ///              0–60000 ms, the delay of each answer (SDO, LSS, UDS, J1939), by default 0
    ///   cycle-ms=N 0–1000 ms, the cycle time of the device's program, by default 0
    ///   brown-out-mv=N
    ///              valves only: the supply below which the valve is off; by default never off
    ///   noise=N, dead-band=N
    ///              valves 0–16384: how far the spool trembles, and the set-point changes that it
    ///              ignores; angle sensors 0–9000 1/100 degree: the noise of the measurement, and
    ///              the play of the shaft; by default 0
    ///   oil        valves only: cold oil slows the spool down
    ///   blank      CANopen only: a device without a node ID, for configuration by LSS
    ///
    /// With --state, an existing memory takes precedence over ID, serial and bit-rate.
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]", help_heading = "Devices", verbatim_doc_comment)]
    device: Vec<DeviceSpec>,

    /// Let the spool of VALVE turn the shaft of SENSOR, as on a boom; repeatable
    ///
    /// VALVE and SENSOR are names of devices. The keys:
    ///   rate=N  1/100 degree per second at full stroke, signed, by default 3000
    ///   min=N   the lower end stop, inclusive, 1/100 degree, by default 0
    ///   max=N   the upper end stop, by default 9000
    ///   noise=N      percent by which the speed deviates, 0–100, by default 0
    ///   dead-band=N  the position of the spool up to which nothing flows, 0–16384, by default 0
    #[arg(long, value_name = "VALVE=SENSOR[,KEY=VALUE…]", help_heading = "Devices", verbatim_doc_comment)]
    link: Vec<NamedLink>,

    /// Accept devices with the same node ID, or the same address
    #[arg(long, help_heading = "Devices")]
    allow_clash: bool,

    /// Keep the memory of each device in DIR/NAME.nvm; without this option, the memory is lost at exit
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, help_heading = "Devices")]
    state: Option<PathBuf>,

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
    #[arg(long, value_name = "URL", help_heading = "Bus", verbatim_doc_comment)]
    bus: Vec<BusUrl>,

    /// Announce socketcand buses by UDP to port 42000, so that python-can and SavvyCAN can find them
    #[arg(long, help_heading = "Bus")]
    beacon: bool,

    /// Allow communication faults with --bus socketcan:, where they can affect real devices; without this option, only
    /// simulated devices can lose frames
    #[arg(long, help_heading = "Bus")]
    allow_real_bus: bool,

    /// The bit rate of the bus in bit/s, or with k or M, as in 250k [default: the rate of the first device, by default
    /// 250k for a valve and 500k for an angle sensor]
    #[arg(long, value_name = "N", value_parser = bit_rate, help_heading = "Bus")]
    bit_rate: Option<BitRate>,

    /// The speed of virtual time: a factor of wall time above 0, or step: only the control interface advances time, and
    /// the frames of clients wait for the next advance
    #[arg(long, value_name = "FACTOR|step", value_parser = speed, default_value = "1", help_heading = "Time")]
    speed: Speed,

    /// The seed of all random values: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed, default_value_t = DEFAULT_SEED, help_heading = "Time")]
    seed: u64,

    /// Write every frame to FILE, in the format of its extension: .asc (ASC), .pcapng (pcapng), any other (candump -L)
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Output")]
    log: Option<PathBuf>,

    /// Overwrite the --log file if it is not empty
    #[arg(long, requires = "log", help_heading = "Output")]
    log_overwrite: bool,

    /// Send error frames to clients: the first one of each destroyed frame, and one for each change of an error mode
    #[arg(long, help_heading = "Output")]
    error_frames: bool,

    /// Colour in the trace: auto (depends on the terminal and NO_COLOR), always (also uses the terminal layout in a
    /// pipe) or never
    #[arg(long, value_name = "WHEN", default_value = "auto", hide_possible_values = true, help_heading = "Output")]
    color: ColorChoice,

    /// Show every cyclic frame on a terminal, including unchanged repeats
    #[arg(long, help_heading = "Output")]
    verbose: bool,

    /// The address of the control interface; port 0 selects a free port [default: 127.0.0.1:8408]
    #[arg(long, value_name = "ADDR:PORT", value_parser = http, conflicts_with = "no_http", help_heading = "Control")]
    http: Option<SocketAddr>,

    /// Disable the control interface
    #[arg(long, help_heading = "Control")]
    no_http: bool,

    /// Allow an --http address that other machines can reach, which gives them full control, and allow a udp-multicast
    /// bus to reach other machines
    #[arg(long, help_heading = "Control")]
    allow_remote: bool,

    #[command(flatten)]
    pub(super) cell: CellArgs,
}

/// The cell of a campaign to judge. The scenario of the campaign defines the devices.
#[derive(Args, Clone, Debug)]
pub(super) struct CellArgs {
    /// Run the devices of a campaign's scenario, inject the fault of a cell and judge the controller: docs/campaigns.md
    #[arg(long, value_name = "PLAN.toml", hide = true, requires = "cell", conflicts_with_all = ["device", "link", "bit_rate", "state", "seed", "allow_clash", "no_http"])]
    pub(super) plan: Option<PathBuf>,

    /// The cell: its number, or ROW@MICROSECONDS
    #[arg(long, value_name = "CELL", hide = true, requires = "plan")]
    pub(super) cell: Option<Which>,

    /// Replace the seeds of the plan with one seed
    #[arg(long, value_name = "N", value_parser = seed, hide = true, requires = "plan")]
    pub(super) plan_seed: Option<u64>,
}

impl TryFrom<RunArgs> for RunOptions {
    type Error = UsageError;

    fn try_from(args: RunArgs) -> Result<Self, UsageError> {
        let http = (!args.no_http).then(|| args.http.unwrap_or(DEFAULT_HTTP));
        if let Some(address) = http.filter(|address| !address.ip().is_loopback() && !args.allow_remote) {
            return Err(UsageError(format!(
                "--http {address}: other machines could reach this address; use a loopback address, as in {DEFAULT_HTTP}, \
                 or add --allow-remote"
            )));
        }
        if http.is_none() && args.speed == Speed::Step {
            return Err(UsageError("--speed step needs the control interface; remove --no-http".to_owned()));
        }
        let specs = if args.device.is_empty() { vec![DeviceSpec::new(DEFAULT_KIND)] } else { args.device };
        let devices = on_one_bus(specs, args.allow_clash)?;
        let links = checked_links(&devices, args.link)?;
        let buses = if args.bus.is_empty() { vec![BusUrl::default()] } else { args.bus };
        check_buses(&buses, args.speed)?;
        Ok(Self {
            devices,
            links,
            buses,
            beacon: args.beacon,
            allow_remote: args.allow_remote,
            allow_real_bus: args.allow_real_bus,
            bit_rate: args.bit_rate,
            state: args.state,
            speed: args.speed,
            http,
            log: args.log.map(|path| LogOptions { path, overwrite: args.log_overwrite }),
            error_frames: args.error_frames,
            color: args.color,
            verbose: args.verbose,
            seed: args.seed,
        })
    }
}

/// Assigns unique names and serial numbers to the devices of one bus; requires unique node IDs unless `may_clash`.
pub(super) fn on_one_bus(specs: Vec<DeviceSpec>, may_clash: bool) -> Result<Vec<NamedDevice>, UsageError> {
    let devices = devices::named(specs).map_err(|error| UsageError(format!("--device: {error} name=")))?;
    if !may_clash {
        devices::refuse_clashes(&devices)
            .map_err(|error| UsageError(format!("--device: {error} with @ID, or use --allow-clash")))?;
    }
    Ok(devices)
}

/// Validates the links between these devices.
pub(super) fn checked_links(devices: &[NamedDevice], links: Vec<NamedLink>) -> Result<Vec<NamedLink>, UsageError> {
    devices::refuse_bad_links(devices, &links).map_err(|error| UsageError(format!("--link: {error}")))?;
    Ok(links)
}

/// Refuses a kernel interface without wall time, and a shared bus that is joined twice.
fn check_buses(buses: &[BusUrl], speed: Speed) -> Result<(), UsageError> {
    for (position, bus) in buses.iter().enumerate() {
        if bus.is_interface() && speed != Speed::Factor(1.0) {
            return Err(UsageError(format!("--speed {speed} with --bus {bus}: this interface needs --speed 1")));
        }
        if bus.is_shared() && buses.iter().take(position).any(|other| other == bus) {
            return Err(UsageError(format!("duplicate --bus {bus}")));
        }
    }
    Ok(())
}

fn bit_rate(text: &str) -> Result<BitRate, String> {
    devices::bit_rate(text).ok_or_else(|| {
        let rates: Vec<String> = BitRate::ALL.iter().rev().map(|rate| rate.bits_per_second().to_string()).collect();
        format!("not a bit rate of CiA 301; accepted: {}", rates.join(", "))
    })
}

pub(super) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("must be a whole number, 0–{}", u64::MAX))
}

fn speed(text: &str) -> Result<Speed, String> {
    if text == "step" {
        return Ok(Speed::Step);
    }
    let factor = text.parse::<f64>().ok().filter(|factor| factor.is_finite() && *factor > 0.0);
    factor.map(Speed::Factor).ok_or_else(|| "must be a number above 0, as in 1, 0.5 or 100, or step".to_owned())
}

fn http(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| format!("must be ADDR:PORT, as in {DEFAULT_HTTP}; port 0 selects a free one"))
}
