//! The file format of a scenario: keys and values with their lines, not yet checked for consistency.

use protocol_core::time::Duration;
use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use utoipa::ToSchema;

use super::ReadError;
use crate::state::schema::{Place, Schemas};
use crate::state::{
    BitsPerSecond, BusChange, Disturb, FaultRequest, Identifier, IdentifierOrAll, PlantChange, PowerChange,
    StateCondition,
};

/// A scenario: devices on a bus, and the actions and expectations of a test, step by step in virtual time.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Scenario)]
pub(super) struct ScenarioFile {
    /// The title of the scenario.
    #[serde(default)]
    pub(super) title: String,
    /// The devices on the bus. They are switched on together, at 0 ms.
    #[serde(default)]
    #[schema(value_type = Vec<DeviceEntry>, required, example = json!(["pvea-canopen@0x20"]))]
    pub(super) devices: Vec<Spanned<DeviceEntry>>,
    /// Links by which the shaft of a sensor follows a valve, each as in --link:
    /// VALVE=SENSOR[,rate=…][,min=…][,max=…].
    #[serde(default)]
    #[schema(value_type = Vec<String>)]
    pub(super) links: Vec<Spanned<String>>,
    /// The bit rate of the bus, in bit/s; by default that of the first device.
    #[schema(value_type = Option<BitsPerSecond>)]
    pub(super) bit_rate: Option<u32>,
    /// True to accept devices with the same node ID or address.
    #[serde(default)]
    pub(super) allow_clash: bool,
    /// True if the steps must expect every frame of the devices, in order. By default, unexpected frames are accepted.
    #[serde(default)]
    pub(super) strict: bool,
    /// Rules that act independently of the steps.
    #[serde(default)]
    #[schema(value_type = Vec<ReactionTable>)]
    pub(super) reactions: Vec<Spanned<ReactionTable>>,
    /// The steps, in order.
    #[serde(default)]
    #[schema(value_type = Vec<StepTable>, required)]
    pub(super) steps: Vec<Spanned<StepTable>>,
}

/// A device on the bus.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(untagged)]
#[schema(as = Device)]
pub(super) enum DeviceEntry {
    /// A device as in --device: KIND[@ID][,KEY=VALUE…], with name, serial, bit-rate, stroke-ms, return-ms, boot-ms,
    /// answer-ms, cycle-ms, brown-out-mv, noise, dead-band, oil, blank.
    Text(String),
    /// The same text, with requirements of the scenario.
    Table(DeviceTable),
}

/// A device on the bus, with requirements of the scenario.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = DeviceTable)]
pub(super) struct DeviceTable {
    /// A device as in --device: KIND[@ID][,KEY=VALUE…], with name, serial, bit-rate, stroke-ms, return-ms, boot-ms,
    /// answer-ms, cycle-ms, brown-out-mv, noise, dead-band, oil, blank.
    pub(super) device: String,
    /// False if the bit rate of the device may differ from that of the bus; true by default.
    pub(super) heard: Option<bool>,
}

/// A step: a start time, at most one action and at most one expectation. By default, a step begins when the previous
/// step ends.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Step)]
pub(super) struct StepTable {
    /// The purpose of the step; shown when it fails.
    pub(super) note: Option<String>,
    /// The start of the step, in milliseconds of virtual time since the devices were switched on.
    #[schema(minimum = 0, maximum = 4294967295_i64)]
    pub(super) at_ms: Option<u32>,
    /// The delay of the step after the end of the previous step, in milliseconds.
    #[schema(minimum = 0, maximum = 4294967295_i64)]
    pub(super) after_ms: Option<u32>,
    /// The name of the device for plant, power or a state; required with several devices on the bus.
    pub(super) device: Option<String>,
    /// Sends a frame, as in "220#0F00 0020".
    pub(super) send: Option<String>,
    /// The period of the frame of `send`, in milliseconds; replaces an earlier cyclic frame with the same identifier.
    /// Without `send`, in a strict scenario: the period at which the expected frame must come again, until a step
    /// expects or stops its identifier.
    #[schema(minimum = 1, maximum = 4294967295_i64)]
    pub(super) every_ms: Option<u32>,
    /// Stops the active cyclic frame with an identifier, as in "220", or all cyclic frames with "all". In a strict
    /// scenario, stop also ends the expectation of a cyclic frame.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub(super) stop: Option<Identifier>,
    /// Changes the plant of the device.
    #[schema(value_type = Option<PlantChange>)]
    pub(super) plant: Option<toml::Table>,
    /// Switches the power of the device, or resets its processor.
    pub(super) power: Option<PowerChange>,
    /// Changes the bit rate of the bus, including that of the scenario's frame sender.
    pub(super) bus: Option<BusChange>,
    /// Destroys the next transmission attempts with bit errors.
    pub(super) disturb: Option<Disturb>,
    /// Adds a communication fault. The scenario fails if the fault affects no frame.
    pub(super) fault: Option<FaultRequest>,
    /// Ends a communication fault by its name, or "all".
    pub(super) end: Option<String>,
    /// Expects a frame of a device, several frames in order, or a state of the device.
    pub(super) expect: Option<Expected>,
    /// True if the expected frames may come in any order.
    pub(super) any_order: Option<bool>,
    /// Expected or forbidden frames that end after this virtual time count, in milliseconds, also those that the
    /// scenario itself sends.
    #[schema(minimum = 0, maximum = 4294967295_i64)]
    pub(super) since_ms: Option<u32>,
    /// The time limit of the expectation, in milliseconds; 1000 by default.
    #[schema(minimum = 0, maximum = 4294967295_i64)]
    pub(super) within_ms: Option<u32>,
    /// Forbids a frame of a device, several frames, or a state of the device during the following steps.
    pub(super) never: Option<Expected>,
    /// The duration of `never`, in milliseconds; by default until the end of the scenario.
    #[schema(minimum = 0, maximum = 4294967295_i64)]
    pub(super) for_ms: Option<u32>,
}

/// A rule that acts independently of the steps. Its trigger is `on` or `missing`, its action `send` or `stop`. By
/// default, the rule acts once.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Reaction)]
pub(super) struct ReactionTable {
    /// Acts at the end of a frame of a device, as in "0A0#1234 ..".
    pub(super) on: Option<String>,
    /// Acts when no such frame of a device has come for `for_ms`. The first such frame starts the supervision.
    pub(super) missing: Option<String>,
    /// The time without the frame, in milliseconds; required with `missing`.
    #[schema(minimum = 1, maximum = 4294967295_i64)]
    pub(super) for_ms: Option<u32>,
    /// Sends a frame, as in "000#0220".
    pub(super) send: Option<String>,
    /// The period of the frame of `send`, in milliseconds; replaces an earlier cyclic frame with the same identifier.
    #[schema(minimum = 1, maximum = 4294967295_i64)]
    pub(super) every_ms: Option<u32>,
    /// Stops an active cyclic frame by its identifier, as in "220", or all cyclic frames with "all".
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub(super) stop: Option<Identifier>,
    /// The virtual time before which the rule ignores frames, in milliseconds; 0 by default.
    #[schema(minimum = 0, maximum = 4294967295_i64)]
    pub(super) from_ms: Option<u32>,
    /// True if the rule acts each time. By default, the rule acts once.
    #[serde(default)]
    pub(super) again: bool,
}

/// Expected or forbidden frames, or a state.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(untagged)]
#[schema(as = Expected)]
pub(crate) enum Expected {
    /// A frame, as in "1A0#0F00 0020". "?" matches any hex digit, ".." at the end any bytes, and an identifier alone
    /// any frame.
    Frame(String),
    /// Several frames.
    Frames(Vec<String>),
    /// A state: any subset of the keys of a device state.
    #[schema(value_type = StateCondition)]
    State(toml::Table),
}

/// The default time limit of an expectation.
pub(super) const PATIENCE: Duration = Duration::from_secs(1);

/// Parses the text of a scenario.
///
/// # Errors
/// [`ReadError`] with the line of the error.
pub(super) fn read(text: &str) -> Result<ScenarioFile, ReadError> {
    // If devices or steps are missing, a later check reports them with an example.
    let schemas = Schemas::of::<ScenarioFile>();
    parse(text, (schemas, "Scenario", &["steps", "reactions"]), |path| path.is_empty())
}

/// Parses a text and validates it against the named schema, except at excused paths. Messages omit the index of an item
/// of `lists`, because the line number locates the item.
///
/// # Errors
/// [`ReadError`] with the line of the error.
pub(crate) fn parse<T: for<'de> Deserialize<'de>>(
    text: &str,
    (schemas, name, lists): (&Schemas, &str, &[&str]),
    is_excused: impl FnOnce(&[Place]) -> bool,
) -> Result<T, ReadError> {
    let refuse = |error: toml::de::Error| {
        let line = error.span().map_or(1, |span| line_of(text, span.start));
        let lines = error.message().lines().map(str::trim).filter(|line| !line.is_empty());
        ReadError { line: Some(line), reason: lines.collect::<Vec<_>>().join("; ") }
    };
    let document = toml::from_str(text).map(|table| json(toml::Value::Table(table), false)).map_err(refuse)?;
    match schemas.check(name, &document, NONE) {
        Err(mismatch) if !is_excused(&mismatch.path) => {
            let item = match mismatch.path.as_slice() {
                [Place::Key(list), Place::Item(item), ..] if lists.contains(&&**list) => format!("{list}[{item}]"),
                _ => String::new(),
            };
            let inner = mismatch.reason.strip_prefix(&item).filter(|_| !item.is_empty());
            let inner = inner.and_then(|rest| rest.strip_prefix('.').or_else(|| rest.strip_prefix(": ")));
            let reason = inner.unwrap_or(&mismatch.reason).to_owned();
            Err(ReadError { line: Some(line_at(text, &mismatch.path)), reason })
        }
        _ => toml::from_str(text).map_err(refuse),
    }
}

/// Returns the line number of the value at a path; 1 if the text contains no part of the path.
pub(crate) fn line_at(text: &str, path: &[Place]) -> usize {
    let place = DeTable::parse(text).ok().and_then(|table| place_of(table.get_ref(), path));
    place.map_or(1, |place| line_of(text, place))
}

/// Returns the text offset of the value at a path, or of the deepest existing part of the path.
fn place_of(table: &DeTable<'_>, path: &[Place]) -> Option<usize> {
    let (first, mut rest) = path.split_first()?;
    let Place::Key(key) = first else { return None };
    let (key, mut value) = table.iter().find(|(known, _)| *known.get_ref() == key.as_str())?;
    let mut place = key.span().start;
    loop {
        match (value.get_ref(), rest) {
            (DeValue::Table(table), [Place::Key(_), ..]) => return place_of(table, rest).or(Some(place)),
            (DeValue::Array(items), [Place::Item(item), further @ ..]) => {
                let Some(item) = items.get(*item) else { return Some(place) };
                (value, rest, place) = (item, further, item.span().start);
            }
            _ => return Some(place),
        }
    }
}

/// Returns the line number of an offset in a text.
pub(super) fn line_of(text: &str, place: usize) -> usize {
    1 + text.bytes().take(place).filter(|byte| *byte == b'\n').count()
}

/// The word that stands for null in the tables of a plant or a state.
pub(crate) const NONE: &str = "\"none\"";

/// Deserialises a table to a type of the control interface, in which "none" stands for null.
///
/// # Errors
/// The reason why the table is invalid.
pub(crate) fn table<T: for<'de> Deserialize<'de>>(table: toml::Table) -> Result<T, String> {
    T::deserialize(json(toml::Value::Table(table), true)).map_err(|error| error.to_string())
}

/// Converts a value to JSON. If `has_none`, and in the tables of a plant or a state, "none" becomes null.
fn json(value: toml::Value, has_none: bool) -> serde_json::Value {
    match value {
        toml::Value::String(text) if has_none && text == "none" => serde_json::Value::Null,
        toml::Value::String(text) => text.into(),
        toml::Value::Integer(number) => number.into(),
        toml::Value::Float(number) => number.into(),
        toml::Value::Boolean(is) => is.into(),
        toml::Value::Datetime(time) => time.to_string().into(),
        toml::Value::Array(values) => values.into_iter().map(|value| json(value, has_none)).collect(),
        toml::Value::Table(table) => {
            let member = |(key, value): (String, toml::Value)| {
                let has_none = has_none || value.is_table() && matches!(&*key, "plant" | "expect" | "never");
                (key, json(value, has_none))
            };
            table.into_iter().map(member).collect()
        }
    }
}
