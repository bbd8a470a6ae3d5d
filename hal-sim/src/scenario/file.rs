//! The file of a scenario as it is written: keys and values, each with its line, not yet checked against each other.

use protocol_core::time::Duration;
use serde::Deserialize;
use toml::Spanned;
use utoipa::ToSchema;

use super::ReadError;
use crate::state::{BusChange, Disturb, PlantChange, PowerChange, StateCondition, given};

/// A scenario: devices on a bus, and what happens to them and has to come of it, step by step in virtual time.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Scenario)]
pub(super) struct ScenarioFile {
    /// What the scenario shows.
    #[serde(default)]
    pub(super) title: String,
    /// The devices on the bus. They are switched on together, at 0 ms.
    #[serde(default)]
    #[schema(value_type = Vec<DeviceEntry>, required, example = json!(["pvea-canopen@0x20"]))]
    pub(super) devices: Vec<Spanned<toml::Value>>,
    /// Shafts that follow a valve, each as in --link: VALVE=SENSOR[,rate=…][,min=…][,max=…].
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub(super) links: Vec<Spanned<String>>,
    /// The bit rate of the bus, in bit/s; by default that of the first device.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<u32>)]
    pub(super) bit_rate: Option<Spanned<u32>>,
    /// Accepts devices with the same node ID, or the same address.
    #[serde(default)]
    pub(super) allow_clash: bool,
    /// What happens, from top to bottom.
    #[serde(default)]
    #[schema(value_type = Vec<StepTable>, required)]
    pub(super) steps: Vec<Spanned<StepTable>>,
}

/// A device on the bus.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(
    untagged,
    expecting = "accepted: a device as in \"pvea-canopen@0x20\", or { device = \"pvea-canopen@0x20\", heard = false }"
)]
#[schema(as = Device)]
pub(super) enum DeviceEntry {
    /// As in --device: KIND[@ID][,KEY=VALUE…], with name, serial, bit-rate, stroke-ms, return-ms, blank.
    Text(String),
    /// The same with what the scenario asks of it.
    Table(DeviceTable),
}

/// A device on the bus, and what the scenario asks of it.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = DeviceTable)]
pub(super) struct DeviceTable {
    /// As in --device: KIND[@ID][,KEY=VALUE…], with name, serial, bit-rate, stroke-ms, return-ms, blank.
    pub(super) device: String,
    /// Whether the device has to run at the bit rate of the bus; true by default.
    #[serde(default, deserialize_with = "given")]
    pub(super) heard: Option<bool>,
}

impl DeviceEntry {
    /// Reads an entry: the text, and whether the device has to be heard.
    ///
    /// # Errors
    /// What is accepted.
    pub(super) fn read(value: toml::Value) -> Result<(String, bool), String> {
        Self::deserialize(json(value)).map_err(|error| reason(&error.to_string())).map(|entry| match entry {
            Self::Text(device) => (device, true),
            Self::Table(DeviceTable { device, heard }) => (device, heard.unwrap_or(true)),
        })
    }
}

/// A step: when it begins, one thing that is done, and one that is expected; each of them can be left out. A step
/// begins when the one before is over.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Step)]
pub(super) struct StepTable {
    /// What the step is for; shown when it fails.
    #[serde(default, deserialize_with = "given")]
    pub(super) note: Option<String>,
    /// The step begins at this virtual time, in milliseconds since the devices were switched on.
    #[serde(default, deserialize_with = "given")]
    pub(super) at_ms: Option<u32>,
    /// The step begins so many milliseconds after the one before.
    #[serde(default, deserialize_with = "given")]
    pub(super) after_ms: Option<u32>,
    /// The name of the device that plant, power or a state is about; needed with several devices on the bus.
    #[serde(default, deserialize_with = "given")]
    pub(super) device: Option<String>,
    /// Sends a frame, as in "220#0F00 0020".
    #[serde(default, deserialize_with = "given")]
    pub(super) send: Option<String>,
    /// Sends the frame again and again with this period, in the place of an earlier cyclic frame of the same
    /// identifier.
    #[serde(default, deserialize_with = "given")]
    pub(super) every_ms: Option<u32>,
    /// Ends the cyclic frame of an identifier, as in "220", which there has to be; or of "all".
    #[serde(default, deserialize_with = "given")]
    pub(super) stop: Option<String>,
    /// Changes what acts on the device from outside.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<PlantChange>)]
    pub(super) plant: Option<toml::Table>,
    /// Switches the device, or resets its processor.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<PowerChange>)]
    pub(super) power: Option<toml::Table>,
    /// Changes the bit rate of the bus and of the one who sends the frames: the master that changes its rate.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<BusChange>)]
    pub(super) bus: Option<toml::Table>,
    /// Destroys the next attempts to send a frame by a bit error each.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<Disturb>)]
    pub(super) disturb: Option<toml::Table>,
    /// A frame of a device, several frames one after the other, or a state of the device, that has to come.
    #[serde(default, deserialize_with = "given")]
    pub(super) expect: Option<Expected>,
    /// The frames may come in any order.
    #[serde(default, deserialize_with = "given")]
    pub(super) any_order: Option<bool>,
    /// How long the step waits for what it expects, in milliseconds; 1000 by default.
    #[serde(default, deserialize_with = "given")]
    pub(super) within_ms: Option<u32>,
    /// A frame of a device, several of them, or a state of the device, that must not come from now on, while the next
    /// steps go on.
    #[serde(default, deserialize_with = "given")]
    pub(super) never: Option<Expected>,
    /// How long it must not come, in milliseconds; up to the end of the scenario by default.
    #[serde(default, deserialize_with = "given")]
    pub(super) for_ms: Option<u32>,
}

/// What is expected.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(
    untagged,
    expecting = "accepted: a frame as in \"1A0#0F00 0020\", a list of frames, or a state as in { dsm = \"active\" }"
)]
#[schema(as = Expected)]
pub(super) enum Expected {
    /// A frame, as in "1A0#0F00 0020": ? is any hex digit, .. at the end any bytes, an identifier alone any data.
    Frame(String),
    /// Several frames.
    Frames(Vec<String>),
    /// A state: any subset of its keys.
    #[schema(value_type = StateCondition)]
    State(toml::Table),
}

/// How long a step waits for what it expects, when it does not say.
pub(super) const PATIENCE: Duration = Duration::from_secs(1);

/// Reads the text of a scenario.
///
/// # Errors
/// [`ReadError`] with the line of what is not accepted.
pub(super) fn read(text: &str) -> Result<ScenarioFile, ReadError> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| line_of(text, span.start));
        ReadError { line: Some(line), reason: reason(error.message()) }
    })
}

/// Returns the number of the line of a place in a text.
pub(super) fn line_of(text: &str, place: usize) -> usize {
    1 + text.bytes().take(place).filter(|byte| *byte == b'\n').count()
}

/// Reads a table by the types of the control interface: what is null there is "none" here.
///
/// # Errors
/// What is not accepted.
pub(super) fn table<T: for<'de> Deserialize<'de>>(table: toml::Table) -> Result<T, String> {
    T::deserialize(json(toml::Value::Table(table))).map_err(|error| reason(&error.to_string()))
}

/// Returns a value as JSON.
pub(super) fn json(value: toml::Value) -> serde_json::Value {
    match value {
        toml::Value::String(text) if text == "none" => serde_json::Value::Null,
        toml::Value::String(text) => text.into(),
        toml::Value::Integer(number) => number.into(),
        toml::Value::Float(number) => number.into(),
        toml::Value::Boolean(is) => is.into(),
        toml::Value::Datetime(time) => time.to_string().into(),
        toml::Value::Array(values) => values.into_iter().map(json).collect(),
        toml::Value::Table(table) => table.into_iter().map(|(key, value)| (key, json(value))).collect(),
    }
}

/// Returns the words of a reader in one line, with what is accepted, and the key that was perhaps meant.
fn reason(message: &str) -> String {
    let message = message.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ");
    for (found, what) in [("unknown field `", "unknown key"), ("unknown variant `", "unknown value")] {
        let Some((word, known)) = message.strip_prefix(found).and_then(|rest| rest.split_once("`, expected ")) else {
            continue;
        };
        let known: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
        let near = known.iter().map(|known| (strsim::jaro_winkler(word, known), known));
        let near = near.filter(|(likeness, _)| *likeness > 0.75).max_by(|one, other| one.0.total_cmp(&other.0));
        let tip = near.map_or_else(String::new, |(_, near)| format!("; did you mean '{near}'?"));
        return format!("{what} '{word}'{tip}; accepted: {}", known.join(", "));
    }
    // The message names a type of Rust, which TOML does not have.
    match message.split_once(", expected ") {
        Some((what, "u32")) => format!("{what}; accepted: a whole number from 0 to {}", u32::MAX),
        _ => message,
    }
}
