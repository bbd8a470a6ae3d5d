//! The file format of a plan: keys and values, not yet checked for consistency.

use std::num::NonZeroU32;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use crate::scenario::ReadError;
use crate::scenario::file::{self as scenario_file, Expected};
use crate::scenario::schema::{published, replace_null};
use crate::state::schema::Schemas;
use crate::state::{FaultRequest, Identifier, PlantChange, PowerChange, StateCondition};

/// The plan of a campaign: the faults, the instants at which each fault is injected, and the expected reaction.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = Plan)]
pub(super) struct PlanFile {
    /// The title of the campaign.
    #[serde(default)]
    pub(super) title: String,
    /// The path of the scenario, relative to the plan. The steps of the scenario are the controller. With `controller`,
    /// the steps run only without a fault.
    pub(super) scenario: String,
    /// The seeds of the runs; 1 by default.
    pub(super) seeds: Option<Vec<u64>>,
    /// The faults: ready sets and tables. A list as a value gives one fault for each item.
    #[schema(value_type = Vec<FaultEntry>)]
    pub(super) faults: Vec<toml::Value>,
    /// The instants of the faults.
    pub(super) instants: Instants,
    /// The proof that the controller has detected the fault.
    pub(super) detected: Option<Detected>,
    /// The safe state.
    pub(super) safe: Option<Safe>,
    /// The observation time after the fault, in milliseconds; three times the larger `within_ms` by default.
    #[schema(minimum = 1, maximum = 86400000)]
    pub(super) observe_ms: Option<u32>,
    /// The controller program and its arguments, in which "{bus}" stands for the URL of the bus, and "{speed}" for `speed`. The program runs in the folder of the plan.
    pub(super) controller: Option<Vec<String>>,
    /// The speed of virtual time relative to wall time; 1 by default. Only valid together with `controller`.
    pub(super) speed: Option<f64>,
}

/// An entry of `faults`.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(untagged)]
#[schema(as = FaultEntry)]
#[expect(dead_code, reason = "a schema")]
enum FaultEntry {
    /// A ready set.
    Ready(ReadySet),
    /// One fault. With lists as values, one fault for each combination of their items.
    Own(FaultTable),
}

/// A ready set of faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum ReadySet {
    /// The device faults of each valve: supply, temperature, spool, lever, internal fault, memory, bus-off, power and
    /// watchdog reset.
    AllOfPve,
    /// The eight communication errors of IEC 61784-3, on each identifier sent throughout the run without a fault.
    Communication,
}

/// A fault: a change of the plant or of the power of a device, or a communication fault.
#[derive(Debug, Deserialize, ToSchema)]
#[schema(as = FaultTable)]
#[expect(dead_code, reason = "a schema, to which `schemas` adds the keys of communication faults")]
struct FaultTable {
    /// Changes the plant of the device.
    plant: Option<PlantChange>,
    /// Switches the power of the device, or resets its processor.
    power: Option<PowerChange>,
    /// The name of the device for plant or power; required with several devices on the bus.
    device: Option<String>,
    /// A reference for the reports, such as a clause of ISO 13849-2.
    reference: Option<String>,
}

/// The instants of the faults.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Instants {
    /// The first instant, in milliseconds of virtual time.
    #[schema(minimum = 0, maximum = 86400000)]
    pub(super) from_ms: u32,
    /// The last instant, in milliseconds of virtual time.
    #[schema(minimum = 0, maximum = 86400000)]
    pub(super) to_ms: u32,
    /// The interval between consecutive instants, in milliseconds.
    #[schema(value_type = Option<u32>, minimum = 1, maximum = 86400000)]
    pub(super) step_ms: Option<NonZeroU32>,
    /// Instants at the ends of frames, instead of `step_ms`.
    pub(super) at: Option<At>,
}

/// Instants taken from the run without a fault.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
pub(super) enum At {
    /// The end of each frame.
    #[serde(rename = "each frame")]
    EachFrame,
}

/// The proof that the controller has detected the fault: either `expect` or `stops`.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Detected {
    /// A frame of any sender, several frames in order, or a state of a device.
    pub(super) expect: Option<Expected>,
    /// The identifier of a frame, as in "220". The absence of this frame for `for_ms` is the proof.
    pub(super) stops: Option<Identifier>,
    /// The time without the frame, in milliseconds; required with `stops`.
    #[schema(minimum = 1, maximum = 86400000)]
    pub(super) for_ms: Option<u32>,
    /// The name of the device for a state; required with several devices on the bus.
    pub(super) device: Option<String>,
    /// The limit for the detection, in milliseconds after the fault.
    #[schema(minimum = 0, maximum = 86400000)]
    pub(super) within_ms: u32,
}

/// The safe state of a device.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Safe {
    /// The state: any subset of the keys of a device state.
    #[schema(value_type = StateCondition)]
    pub(super) expect: toml::Table,
    /// The name of the device; required with several devices on the bus.
    pub(super) device: Option<String>,
    /// The time for which the state must hold without interruption, in milliseconds; by default until the end of the
    /// observation.
    #[schema(minimum = 1, maximum = 86400000)]
    pub(super) for_ms: Option<u32>,
    /// The limit for the start of the safe state, in milliseconds after the fault.
    #[schema(minimum = 0, maximum = 86400000)]
    pub(super) within_ms: u32,
}

/// Parses the text of a plan.
///
/// # Errors
/// [`ReadError`] with the line of the error.
pub(super) fn read(text: &str) -> Result<PlanFile, ReadError> {
    scenario_file::parse(text, (&SCHEMAS, "Plan", &["faults"]), |_| false)
}

/// The schemas against which a plan is checked.
static SCHEMAS: LazyLock<Schemas> = LazyLock::new(|| {
    let mut definitions = definitions();
    vary(&mut definitions);
    definitions.into()
});

/// Returns the JSON schema of plans, in draft 2020-12.
#[must_use]
pub fn schema() -> String {
    let mut definitions = definitions();
    replace_null(&mut definitions);
    vary(&mut definitions);
    published("Plan", "Campaign plan of pve-sim", definitions)
}

/// Returns the schemas of a plan by name. The schema of a fault also has the keys of a communication fault.
fn definitions() -> Map<String, Value> {
    let mut definitions = Schemas::of::<PlanFile>().by_name().clone();
    definitions.extend(Schemas::of::<FaultRequest>().by_name().clone());
    let message = definitions.remove("CommunicationFault").unwrap_or_default();
    let message = message["properties"].as_object().cloned().unwrap_or_default();
    if let Some(members) = definitions.get_mut("FaultTable").and_then(|table| table["properties"].as_object_mut()) {
        members.extend(message.into_iter().map(|(key, mut member)| {
            if key == "for_ms" {
                let text = "The duration of the fault, in milliseconds; by default until the end of the observation.";
                member["description"] = text.into();
            }
            (key, member)
        }));
    }
    definitions
}

/// Makes the schemas accept a list of values for each key of faults and plant changes, except `plant` and `reference`.
fn vary(definitions: &mut Map<String, Value>) {
    for name in ["FaultTable", "PlantChange"] {
        let Some(members) = definitions.get_mut(name).and_then(|table| table["properties"].as_object_mut()) else {
            continue;
        };
        for (_, member) in members.iter_mut().filter(|(key, _)| !matches!(&***key, "plant" | "reference")) {
            let description = member.as_object_mut().and_then(|fields| fields.remove("description"));
            let one = member.take();
            *member = json!({ "anyOf": [one, { "type": "array", "items": one, "minItems": 1 }] });
            if let Some(description) = description {
                member["description"] = description;
            }
        }
    }
}
