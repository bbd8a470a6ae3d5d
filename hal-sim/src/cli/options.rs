//! The options of `run`: as clap reads them, and as the simulator uses them, checked against each other.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::PathBuf;

use clap::{Args, ValueHint};
use protocol_core::controller::BitRate;
use protocol_core::device::pve;

use super::UsageError;
use super::device::DeviceSpec;
use super::link::{self, LinkSpec};
use crate::gateway::BusUrl;
use crate::kind::{Kind, Simulated};
use crate::run::{ColorChoice, LogOptions, NamedDevice, RunOptions};
use crate::speed::Speed;

/// The seed of a run that was given none: two runs with the same seed and the same input are the same.
const DEFAULT_SEED: u64 = 1;

/// Where the control interface is reachable when nobody says.
const DEFAULT_HTTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 8408));

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
    ///   bit-rate=N of a valve 125k, 250k, 500k, by default 250k; of an angle sensor as --bit-rate, by default 500k
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

    /// Where the bus is reachable: socketcand://HOST:PORT/NAME, port 0 takes a free one; socketcan:IFACE, an interface of
    /// Linux; repeatable [default: socketcand://127.0.0.1:29536/pve0]
    #[arg(long, value_name = "URL", help_heading = "Bus")]
    bus: Vec<BusUrl>,

    /// Announce the bus by UDP to port 42000, so that python-can and SavvyCAN find it
    #[arg(long, help_heading = "Bus")]
    beacon: bool,

    /// The rate of the bus, in bit/s, or as in 250k and 1M [default: the rate of the first device]
    #[arg(long, value_name = "N", value_parser = bit_rate, help_heading = "Bus")]
    bit_rate: Option<BitRate>,

    /// Virtual time against wall time: a number above 0; or step: time moves only when the control interface tells it to,
    /// and what clients send waits for that
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

    /// Colour in the trace: auto, as the terminal and NO_COLOR have it; always, which lays the trace out as on a terminal
    /// into a pipe, too; never
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

    /// Let --http be an address that other machines reach: whoever does can switch everything
    #[arg(long, conflicts_with = "no_http", help_heading = "Control")]
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
        let links = link::between(&devices, args.link)?;
        let buses = if args.bus.is_empty() { vec![BusUrl::default_server()] } else { args.bus };
        check_interfaces(&buses, args.speed)?;
        Ok(Self {
            devices,
            links,
            buses,
            beacon: args.beacon,
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

/// The devices of one bus, each with a name and a serial number of its own, and a node ID unless they may clash.
pub(super) fn on_one_bus(specs: Vec<DeviceSpec>, may_clash: bool) -> Result<Vec<NamedDevice>, UsageError> {
    let mut devices = named(specs)?;
    number(&mut devices);
    if !may_clash {
        refuse_clashes(&devices)?;
    }
    Ok(devices)
}

/// Gives a name to each device that has none: its kind, then kind-2, kind-3 …, as far as they are free.
fn named(specs: Vec<DeviceSpec>) -> Result<Vec<NamedDevice>, UsageError> {
    let mut taken: Vec<String> = Vec::new();
    for name in specs.iter().filter_map(|spec| spec.name.as_ref()) {
        if taken.contains(name) {
            return Err(UsageError(format!(
                "--device: the name '{name}' is given twice; give each device its own name="
            )));
        }
        taken.push(name.clone());
    }
    let free = |kind: Kind, taken: &[String]| {
        (1_u32..)
            .map(|n| if n == 1 { kind.name().to_owned() } else { format!("{kind}-{n}") })
            .find(|name| !taken.contains(name))
            .unwrap_or_default()
    };
    let devices = specs.into_iter().map(|spec| {
        let name = spec.name.unwrap_or_else(|| {
            let name = free(spec.kind, &taken);
            taken.push(name.clone());
            name
        });
        NamedDevice { name, kind: spec.kind, birth: spec.birth }
    });
    Ok(devices.collect())
}

/// Gives each device without a serial number the next free one, from the kind's default on. Explicit numbers are taken
/// first.
fn number(devices: &mut [NamedDevice]) {
    let mut taken: Vec<_> =
        devices.iter().filter_map(|device| Some(device.kind.known_by(device.birth.serial?))).collect();
    for NamedDevice { kind, birth, .. } in devices {
        let first = kind.default_serial();
        let candidates = || (first..=u32::MAX).chain(0..first);
        let serial = birth.serial.or_else(|| candidates().find(|serial| !taken.contains(&kind.known_by(*serial))));
        taken.extend(serial.map(|serial| kind.known_by(serial)));
        birth.serial = serial;
    }
}

fn refuse_clashes(devices: &[NamedDevice]) -> Result<(), UsageError> {
    for (position, device) in devices.iter().enumerate() {
        let Some(id) = device.birth.node_id else { continue };
        let earlier = devices.iter().take(position).find(|other| other.birth.node_id == Some(id));
        if let Some(earlier) = earlier {
            return Err(UsageError(format!(
                "--device: {} and {} both have {} 0x{id:02X}; give each its own with @ID, or --allow-clash",
                earlier.name,
                device.name,
                device.kind.id_name()
            )));
        }
    }
    Ok(())
}

/// An interface of the kernel lives in wall time; one that is given twice would send every frame round for ever.
fn check_interfaces(buses: &[BusUrl], speed: Speed) -> Result<(), UsageError> {
    for (position, bus) in buses.iter().enumerate().filter(|(_, bus)| bus.is_real_time()) {
        if speed != Speed::Factor(1.0) {
            return Err(UsageError(format!("--speed {speed} with --bus {bus}: an interface runs at --speed 1 only")));
        }
        if buses.iter().take(position).any(|other| other == bus) {
            return Err(UsageError(format!("--bus {bus} is given twice; give each interface once")));
        }
    }
    Ok(())
}

fn bit_rate(text: &str) -> Result<BitRate, String> {
    super::device::bit_rate(text).ok_or_else(|| {
        let rates: Vec<String> = BitRate::ALL.iter().rev().map(|rate| rate.bits_per_second().to_string()).collect();
        format!("no bit rate of CiA 301; accepted: {}", rates.join(", "))
    })
}

fn seed(text: &str) -> Result<u64, String> {
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
