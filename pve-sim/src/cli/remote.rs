//! The arguments of `set` and `status`.

use std::net::SocketAddr;

use clap::Args;
use clap::builder::NonEmptyStringValueParser;

use super::UsageError;
use crate::gateway::joinable;
use crate::remote::PlantWord;
use crate::run::DEFAULT_HTTP;

/// The arguments of `set`.
#[derive(Args, Clone, Debug, PartialEq, Eq)]
pub struct SetArgs {
    /// The name of the device
    #[arg(value_name = "DEVICE", value_parser = NonEmptyStringValueParser::new())]
    pub device: String,

    /// A plant word and its value, as on the console or in PATCH /devices/NAME/plant, for example supply_mv=8000
    /// spool=stuck lever=off; all words change at the same instant, or none does
    #[arg(value_name = "WORD=VALUE", required = true)]
    pub words: Vec<PlantWord>,

    /// The address of the control interface, as in the ready line of the simulator
    #[arg(long, value_name = "ADDR:PORT", value_parser = address, default_value_t = DEFAULT_HTTP)]
    pub http: SocketAddr,
}

/// The arguments of `status`.
#[derive(Args, Clone, Debug, PartialEq, Eq)]
pub struct StatusArgs {
    /// The name of the device; without it, all devices are shown
    #[arg(value_name = "DEVICE", value_parser = NonEmptyStringValueParser::new())]
    pub device: Option<String>,

    /// Print the JSON of GET /devices or GET /devices/NAME
    #[arg(long)]
    pub json: bool,

    /// The address of the control interface, as in the ready line of the simulator
    #[arg(long, value_name = "ADDR:PORT", value_parser = address, default_value_t = DEFAULT_HTTP)]
    pub http: SocketAddr,
}

impl SetArgs {
    /// Returns the arguments unless a word is duplicated.
    pub(super) fn check(self) -> Result<Self, UsageError> {
        for (place, PlantWord { name, .. }) in self.words.iter().enumerate() {
            if self.words.iter().take(place).any(|earlier| earlier.name == *name) {
                return Err(UsageError(format!("set: duplicate word {name}")));
            }
        }
        Ok(self)
    }
}

/// Parses the address of a simulator. An unspecified address (0.0.0.0) becomes loopback.
fn address(text: &str) -> Result<SocketAddr, String> {
    let address: Option<SocketAddr> = text.parse().ok();
    let address = address.filter(|address| address.port() != 0).map(joinable);
    address.ok_or_else(|| format!("must be ADDR:PORT, as in {DEFAULT_HTTP}"))
}
