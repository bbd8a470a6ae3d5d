//! The options of `set` and `status`.

use std::net::SocketAddr;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::UsageError;
use super::options::DEFAULT_HTTP;
use crate::gateway::joinable;
use crate::remote::{PlantWord, SetOptions, StatusOptions};

/// The arguments of `set`.
#[derive(Args, Debug)]
pub(super) struct SetArgs {
    /// The name of the device
    #[arg(value_name = "DEVICE", value_parser = NonEmptyStringValueParser::new())]
    device: String,

    /// A plant word and its value, as on the console or in PATCH /devices/NAME/plant: supply_mv=8000 spool=stuck
    /// lever=off; several words change at the same instant, or none changes
    #[arg(value_name = "WORD=VALUE", required = true)]
    words: Vec<PlantWord>,

    #[command(flatten)]
    simulator: SimulatorArgs,
}

/// The arguments of `status`.
#[derive(Args, Debug)]
pub(super) struct StatusArgs {
    /// The name of the device; without it, all devices are shown
    #[arg(value_name = "DEVICE", value_parser = NonEmptyStringValueParser::new())]
    device: Option<String>,

    /// Print the JSON of GET /devices or GET /devices/NAME
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    simulator: SimulatorArgs,
}

/// The address of the simulator.
#[derive(Args, Debug)]
struct SimulatorArgs {
    /// The control interface of the simulator, as in its ready line
    #[arg(long, value_name = "ADDR:PORT", value_parser = address, default_value_t = DEFAULT_HTTP)]
    http: SocketAddr,
}

impl TryFrom<SetArgs> for SetOptions {
    type Error = UsageError;

    fn try_from(args: SetArgs) -> Result<Self, UsageError> {
        let words = args.words;
        for (place, PlantWord { name, .. }) in words.iter().enumerate() {
            if words.iter().take(place).any(|earlier| earlier.name == *name) {
                return Err(UsageError(format!("set: duplicate word {name}")));
            }
        }
        Ok(Self { http: args.simulator.http, device: args.device, words })
    }
}

impl From<StatusArgs> for StatusOptions {
    fn from(args: StatusArgs) -> Self {
        Self { http: args.simulator.http, device: args.device, json: args.json }
    }
}

/// Parses the address of a simulator. An unspecified address (0.0.0.0) becomes loopback.
fn address(text: &str) -> Result<SocketAddr, String> {
    let address: Option<SocketAddr> = text.parse().ok();
    let address = address.filter(|address| address.port() != 0).map(joinable);
    address.ok_or_else(|| format!("must be ADDR:PORT, as in {DEFAULT_HTTP}"))
}
