//! The options of `run`: as clap reads them, and as the simulator uses them, checked against each other.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::PathBuf;

use clap::{Args, ValueHint};
use protocol_core::controller::BitRate;
use protocol_core::device::pve;

use super::UsageError;
use crate::gateway::BusUrl;
use crate::run::{ColorChoice, LogOptions, RunOptions};
use crate::speed::Speed;
use hal_sim::Kind;
use hal_sim::devices::{self, DeviceSpec, LinkSpec, NamedDevice, NamedLink};

/// The seed of a run that was given none: two runs with the same seed and the same input are the same.
pub(super) const DEFAULT_SEED: u64 = 1;

/// Where the control interface is reachable when nobody says.
pub(super) const DEFAULT_HTTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 8408));

/// What runs when no device is given.
const DEFAULT_KIND: Kind = Kind::Pve(pve::Kind::PveaCanopen);

/// The options of `run`, as they were written.
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
    ///   on CANopen the node ID, 1–127, by default 0x20, of an angle sensor 1
    ///   on ISOBUS the address, 0x80–0x8F, by default 0x80
    ///
    /// The keys:
    ///   name=NAME  1–32 of a–z, 0–9 and '-'; by default the kind, then kind-2 …
    ///   serial=N   decimal or 0x; by default the next free one; part of the NAME on ISOBUS
    ///   bit-rate=N by default that of the bus; of a valve on CANopen 125k, 250k or 500k, and
    ///              250k alone on ISOBUS; of an angle sensor as --bit-rate
    ///   stroke-ms=N, return-ms=N
    ///              of a valve: 10–5000 ms, in which its spool goes from neutral to full
    ///              stroke, by default 250, and back by springs, by default 150
    ///   blank      CANopen only: no node ID, waits for LSS
    ///
    /// With --state a memory that exists decides; ID, serial and bit-rate fill a new one only.
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]", help_heading = "Devices", verbatim_doc_comment)]
    device: Vec<DeviceSpec>,

    /// The shaft of SENSOR follows the spool of VALVE, as a boom that the valve moves; repeatable
    ///
    /// VALVE and SENSOR are names of devices. The keys:
    ///   rate=N  1/100 degree a second at full stroke, signed, by default 3000
    ///   min=N   the lower end stop, inclusive, 1/100 degree, by default 0
    ///   max=N   the upper end stop, by default 9000
    #[arg(long, value_name = "VALVE=SENSOR[,KEY=VALUE…]", help_heading = "Devices", verbatim_doc_comment)]
    link: Vec<LinkSpec>,

    /// Accept devices with the same node ID, or the same address
    #[arg(long, help_heading = "Devices")]
    allow_clash: bool,

    /// Keep each device's memory in DIR/NAME.nvm; without it the memory is lost at exit
    #[arg(long, value_name = "DIR", value_hint = ValueHint::DirPath, help_heading = "Devices")]
    state: Option<PathBuf>,

    /// Where the bus is reachable; repeatable: all of them are one bus [default: socketcand://127.0.0.1:29536/pve0]
    ///
    /// URL is one of
    ///   socketcand://HOST:PORT/NAME  served over TCP, port 0 takes a free one
    ///   slcan://HOST:PORT            an adapter on a serial line, over TCP
    ///   slcan+pty:PATH               the same on a pseudo-terminal, with a link at PATH; Unix
    ///   socketcan:IFACE              an interface of Linux
    ///   udp-multicast://GROUP:PORT   python-can's udp_multicast, on this machine unless --allow-remote
    #[arg(long, value_name = "URL", help_heading = "Bus", verbatim_doc_comment)]
    bus: Vec<BusUrl>,

    /// Announce the bus by UDP to port 42000, so that python-can and SavvyCAN find it
    #[arg(long, help_heading = "Bus")]
    beacon: bool,

    /// The rate of the bus, in bit/s, or as in 250k and 1M [default: the rate of the first device: of a valve 250k, of an angle sensor 500k]
    #[arg(long, value_name = "N", value_parser = bit_rate, help_heading = "Bus")]
    bit_rate: Option<BitRate>,

    /// Virtual time against wall time: a number above 0; or step: time moves only when the control interface tells it
    /// to, and what clients send waits for that
    #[arg(long, value_name = "FACTOR|step", value_parser = speed, default_value = "1", help_heading = "Time")]
    speed: Speed,

    /// The seed of everything random: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed, default_value_t = DEFAULT_SEED, help_heading = "Time")]
    seed: u64,

    /// Write every frame to FILE: .asc as ASC, .pcapng as pcapng, all others in the format of candump -L
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath, help_heading = "Output")]
    log: Option<PathBuf>,

    /// Write to the file of --log even if it has something in it, which is lost
    #[arg(long, requires = "log", help_heading = "Output")]
    log_overwrite: bool,

    /// Send error frames to clients, too: the first one, and each change of an error mode
    #[arg(long, help_heading = "Output")]
    error_frames: bool,

    /// Colour in the trace: auto, as the terminal and NO_COLOR have it; always, which lays the trace out as on a
    /// terminal into a pipe, too; never
    #[arg(long, value_name = "WHEN", default_value = "auto", hide_possible_values = true, help_heading = "Output")]
    color: ColorChoice,

    /// Show every cyclic frame on a terminal, also one that comes again as it was
    #[arg(long, help_heading = "Output")]
    verbose: bool,

    /// Where the control interface is reachable, port 0 takes a free one [default: 127.0.0.1:8408]
    #[arg(long, value_name = "ADDR:PORT", value_parser = http, conflicts_with = "no_http", help_heading = "Control")]
    http: Option<SocketAddr>,

    /// Serve no control interface
    #[arg(long, help_heading = "Control")]
    no_http: bool,

    /// Let --http be an address that other machines reach, whoever does can switch everything; and let a bus of
    /// udp-multicast reach them
    #[arg(long, help_heading = "Control")]
    allow_remote: bool,
}

impl TryFrom<RunArgs> for RunOptions {
    type Error = UsageError;

    fn try_from(args: RunArgs) -> Result<Self, UsageError> {
        let http = (!args.no_http).then(|| args.http.unwrap_or(DEFAULT_HTTP));
        if let Some(address) = http.filter(|address| !address.ip().is_loopback() && !args.allow_remote) {
            return Err(UsageError(format!(
                "--http {address}: other machines could reach it; accepted: an address of loopback, as in {DEFAULT_HTTP}, or \
                 --allow-remote"
            )));
        }
        if http.is_none() && args.speed == Speed::Step {
            return Err(UsageError("--speed step: the control interface moves time; leave --no-http out".to_owned()));
        }
        let specs = if args.device.is_empty() { vec![DeviceSpec::new(DEFAULT_KIND)] } else { args.device };
        let devices = on_one_bus(specs, args.allow_clash)?;
        let links = between(&devices, args.link)?;
        let buses = if args.bus.is_empty() { vec![BusUrl::default()] } else { args.bus };
        check_buses(&buses, args.speed)?;
        Ok(Self {
            devices,
            links,
            buses,
            beacon: args.beacon,
            allow_remote: args.allow_remote,
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

/// Returns the devices of one bus, each with a name and a serial number of its own, and a node ID unless they may
/// clash.
pub(super) fn on_one_bus(specs: Vec<DeviceSpec>, may_clash: bool) -> Result<Vec<NamedDevice>, UsageError> {
    let devices = devices::named(specs).map_err(|error| UsageError(format!("--device: {error} name=")))?;
    if !may_clash {
        devices::refuse_clashes(&devices)
            .map_err(|error| UsageError(format!("--device: {error} with @ID, or --allow-clash")))?;
    }
    Ok(devices)
}

/// Returns the links between these devices.
pub(super) fn between(devices: &[NamedDevice], links: Vec<LinkSpec>) -> Result<Vec<NamedLink>, UsageError> {
    devices::links(devices, links).map_err(|error| UsageError(format!("--link: {error}")))
}

/// Checks the buses: an interface of the kernel lives in wall time; a bus that others have is joined once.
fn check_buses(buses: &[BusUrl], speed: Speed) -> Result<(), UsageError> {
    for (position, bus) in buses.iter().enumerate() {
        if bus.address().is_real_time() && speed != Speed::Factor(1.0) {
            return Err(UsageError(format!("--speed {speed} with --bus {bus}: an interface runs at --speed 1 only")));
        }
        if bus.address().is_shared() && buses.iter().take(position).any(|other| other == bus) {
            return Err(UsageError(format!("--bus {bus} is given twice; give each of its kind once")));
        }
    }
    Ok(())
}

fn bit_rate(text: &str) -> Result<BitRate, String> {
    devices::bit_rate(text).ok_or_else(|| {
        let rates: Vec<String> = BitRate::ALL.iter().rev().map(|rate| rate.bits_per_second().to_string()).collect();
        format!("no bit rate of CiA 301; accepted: {}", rates.join(", "))
    })
}

pub(super) fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("accepted: a whole number, 0–{}", u64::MAX))
}

fn speed(text: &str) -> Result<Speed, String> {
    if text == "step" {
        return Ok(Speed::Step);
    }
    let factor = text.parse::<f64>().ok().filter(|factor| factor.is_finite() && *factor > 0.0);
    factor.map(Speed::Factor).ok_or_else(|| "accepted: a number above 0, as in 1, 0.5 or 100, or step".to_owned())
}

fn http(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| format!("accepted: ADDR:PORT, as in {DEFAULT_HTTP}, port 0 takes a free one"))
}
