//! The options of `decode` and `replay`.

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};
use protocol_core::time::Duration;

use super::UsageError;
use super::options::{between, on_one_bus};
use hal_sim::decode::DecodeOptions;
use hal_sim::devices::{self, DeviceSpec, LinkSpec};
use hal_sim::replay::ReplayOptions;

/// The tolerance of `replay` when nobody says, in milliseconds: the longest that the start of two devices on one supply
/// is apart.
const TOLERANCE_MS: u32 = 5;

/// The options of `decode`, as they were written.
#[derive(Args, Debug)]
pub(super) struct DecodeArgs {
    /// The recording: candump -L, the screen of candump, ASC or pcapng, by what is in it; - is stdin
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// A device that is known to be on the bus, as for run; repeatable. Without it, the frames tell
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]")]
    device: Vec<DeviceSpec>,
}

/// The options of `replay`, as they were written.
#[derive(Args, Debug)]
pub(super) struct ReplayArgs {
    /// The recording: candump -L, the screen of candump with times, ASC or pcapng, by what is in it
    #[arg(value_name = "FILE", value_hint = ValueHint::FilePath)]
    file: PathBuf,

    /// A stand-in that takes the place of a device in the recording, as for run; repeatable
    #[arg(long, value_name = "KIND[@ID][,KEY=VALUE…]", required = true)]
    device: Vec<DeviceSpec>,

    /// The shaft of SENSOR follows the spool of VALVE, as for run; repeatable
    #[arg(long, value_name = "VALVE=SENSOR[,KEY=VALUE…]")]
    link: Vec<LinkSpec>,

    /// How much earlier or later a frame may come, in milliseconds; a position may differ by what is travelled in that
    /// time
    #[arg(long, value_name = "N", default_value_t = TOLERANCE_MS, value_parser = clap::value_parser!(u32).range(..=60_000))]
    tolerance_ms: u32,

    /// Begin with the first boot-up, or address claim, of a device, and leave out all that is before
    #[arg(long)]
    from_boot_up: bool,
}

impl TryFrom<DecodeArgs> for DecodeOptions {
    type Error = UsageError;

    fn try_from(args: DecodeArgs) -> Result<Self, UsageError> {
        // Nobody sends here: twins do not clash.
        Ok(Self { file: args.file, devices: on_one_bus(args.device, true)? })
    }
}

impl TryFrom<ReplayArgs> for ReplayOptions {
    type Error = UsageError;

    fn try_from(args: ReplayArgs) -> Result<Self, UsageError> {
        if args.file == Path::new("-") {
            return Err(UsageError("replay: stdin is read once, a replay more than once; accepted: a file".to_owned()));
        }
        let mut devices = on_one_bus(args.device, false)?;
        devices::share_bit_rate(&mut devices, None);
        let links = between(&devices, args.link)?;
        let tolerance = Duration::from_millis(args.tolerance_ms.into());
        Ok(Self { file: args.file, devices, links, tolerance, from_boot_up: args.from_boot_up })
    }
}
