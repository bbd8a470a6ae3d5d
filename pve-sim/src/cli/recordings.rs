//! The options of `decode` and `replay`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};
use protocol_core::time::Duration;

use super::UsageError;
use super::options::{checked_links, on_one_bus};
use crate::run::{DEFAULT_SEED, seed};
use hal_sim::decode::DecodeOptions;
use hal_sim::devices::{self, DeviceSpec, NamedLink};
use hal_sim::replay::ReplayOptions;

/// The default tolerance of `replay`, in milliseconds: the largest start-up difference between two devices on one
/// supply.
const TOLERANCE_MS: u32 = 5;

/// The arguments of `decode`.
#[derive(Args, Debug)]
pub(super) struct DecodeArgs {
    /// The recording, or - for stdin; its format is detected: candump -L, screen output of candump, ASC or pcapng
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// A device on the bus, as for run; repeatable. Without this option, devices are recognised by their frames
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]")]
    device: Vec<DeviceSpec>,
}

/// The arguments of `replay`.
#[derive(Args, Debug)]
pub(super) struct ReplayArgs {
    /// The recording; its format is detected: candump -L, screen output of candump with times, ASC or pcapng
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// A simulated device that replaces a recorded device, as for run; repeatable
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]", required = true)]
    device: Vec<DeviceSpec>,

    /// Let the spool of VALVE turn the shaft of SENSOR, as for run; repeatable
    #[arg(long, value_name = "VALVE=SENSOR[,KEY=VALUE…]")]
    link: Vec<NamedLink>,

    /// The tolerance of frame times, in milliseconds; a position may differ by the movement in that time
    #[arg(long, value_name = "N", default_value_t = TOLERANCE_MS, value_parser = clap::value_parser!(u32).range(..=60_000))]
    tolerance_ms: u32,

    /// Begin with the first boot-up or address claim of a device; earlier frames are ignored
    #[arg(long)]
    from_boot_up: bool,

    /// The seed of all random values, as for run: 0–18446744073709551615
    #[arg(long, value_name = "N", value_parser = seed, default_value_t = DEFAULT_SEED)]
    seed: u64,
}

impl TryFrom<DecodeArgs> for DecodeOptions {
    type Error = UsageError;

    fn try_from(args: DecodeArgs) -> Result<Self, UsageError> {
        // `decode` simulates no device, so equal node IDs do not clash.
        Ok(Self { file: args.file, devices: on_one_bus(args.device, true)? })
    }
}

impl TryFrom<ReplayArgs> for ReplayOptions {
    type Error = UsageError;

    fn try_from(args: ReplayArgs) -> Result<Self, UsageError> {
        if args.file == Path::new("-") {
            return Err(UsageError("replay: stdin cannot be read more than once; use a file".to_owned()));
        }
        let mut devices = on_one_bus(args.device, false)?;
        devices::share_bit_rate(&mut devices, None);
        let links = checked_links(&devices, args.link)?;
        let tolerance = Duration::from_millis(args.tolerance_ms.into());
        let ReplayArgs { file, from_boot_up, seed, .. } = args;
        Ok(Self { file, devices, links, tolerance, from_boot_up, seed })
    }
}
