//! The arguments of `run`, and their conversion to checked options.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::UsageError;
use crate::campaign::Which;
use crate::control::Speed;
use crate::gateway::BusUrl;
use crate::run::{DEFAULT_HTTP, RunOptions, seed};
use hal_sim::devices::{self, DeviceSpec, NamedDevice, NamedLink};

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
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]", default_value = "pvea-canopen", hide_default_value = true)]
    #[arg(help_heading = "Devices", verbatim_doc_comment)]
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

    #[command(flatten)]
    options: RunOptions,

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
        let options = args.options;
        let is_remote = |address: &SocketAddr| !address.ip().is_loopback();
        if let Some(address) = options.http().filter(is_remote)
            && !options.allow_remote
        {
            return Err(UsageError(format!(
                "--http {address}: other machines could reach this address; use a loopback address, as in {DEFAULT_HTTP}, \
                 or add --allow-remote"
            )));
        }
        if options.no_http && options.speed == Speed::STEP {
            return Err(UsageError("--speed step needs the control interface; remove --no-http".to_owned()));
        }
        let devices = on_one_bus(args.device, args.allow_clash)?;
        let links = checked_links(&devices, args.link)?;
        check_buses(&options.buses, options.speed)?;
        Ok(Self { devices, links, ..options })
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
