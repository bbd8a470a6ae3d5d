//! The plant of a device and its changes, for JSON.

use protocol_core::device::plant::{Change, Product};
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::openapi::{Object, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::words::{Words, schema_of_plant};
use crate::world::{NodeId, PlantError, World};

/// The plant of a device: the value of each word of its product.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct PlantState(Words);

/// The schemas of the plants: name, product and description.
const PLANTS: [(&str, Product, &str); 2] = [
    ("ValvePlant", Product::Valve, "The plant of a valve."),
    ("EncoderPlant", Product::Encoder, "The plant of an angle sensor."),
];

impl PartialSchema for PlantState {
    fn schema() -> RefOr<Schema> {
        let plants = PLANTS.map(|(name, ..)| json!({ "$ref": format!("#/components/schemas/{name}") }));
        utoipa_schema(json!({ "description": "The plant of a device.", "oneOf": plants }))
    }
}

impl ToSchema for PlantState {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.extend(PLANTS.map(|(name, product, description)| {
            (name.to_owned(), utoipa_schema(schema_of_plant(product, description)))
        }));
    }
}

fn utoipa_schema(schema: serde_json::Value) -> RefOr<Schema> {
    serde_json::from_value(schema).unwrap_or_else(|_| Object::new().into())
}

/// A change of the plant: any subset of its fields.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
pub struct PlantChange {
    #[serde(flatten)]
    #[schema(ignore)]
    words: Words,
    /// The duration of the change, in milliseconds, after which the earlier values are restored; permanent by default.
    #[schema(minimum = 1, maximum = 86400000)]
    pub for_ms: Option<u32>,
    /// A profile: a numeric plant word that changes over time.
    pub profile: Option<Profile>,
}

/// A numeric plant word that changes over time.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// The plant word, such as `supply_mv`.
    pub word: String,
    /// The points, each a time in milliseconds from now and a value; or the name of a predefined profile.
    pub points: Points,
    /// True: each value is kept until the next point. False, the default: values between two points are interpolated
    /// every millisecond.
    #[serde(default)]
    pub steps: bool,
}

/// The points of a profile.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(untagged, expecting = "points must be a list of [MILLISECONDS, VALUE], or \"cranking\"")]
pub enum Points {
    /// A predefined profile.
    Ready(ReadyProfile),
    /// Pairs of a time in milliseconds and a value.
    List(Vec<[i64; 2]>),
}

/// A predefined profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ReadyProfile {
    /// The supply voltage, in mV, of a 24 V machine while its engine is cranked.
    Cranking,
}

/// The supply voltage of a 24 V machine while its engine is cranked, shaped as in ISO 16750-2: times in ms, values in
/// mV (A).
pub const CRANKING: [[i64; 2]; 4] = [[0, 24_000], [50, 6_000], [120, 9_000], [900, 24_000]];

impl Profile {
    /// The maximum duration of a profile in milliseconds: one day.
    pub const MAX_MS: u64 = 24 * 60 * 60 * 1000;

    /// Returns the points of the profile.
    #[must_use]
    pub fn points(&self) -> Vec<[i64; 2]> {
        match &self.points {
            Points::Ready(ReadyProfile::Cranking) => CRANKING.to_vec(),
            Points::List(points) => points.clone(),
        }
    }
}

impl PlantState {
    /// Returns the current plant of a device.
    pub fn of(node: NodeId, world: &World) -> Self {
        let is_damaged = Some(world.memory(node).is_spoilt());
        Self(Words { changes: world.plant(node).collect(), is_damaged })
    }

    /// Returns the plant with the shaft angle set to 0, for comparisons: the angle of a rotating shaft changes
    /// continuously.
    pub fn at_rest(&self) -> Self {
        let mut words = self.0.clone();
        for change in &mut words.changes {
            if let Change::AngleCdeg(angle) = change {
                *angle = 0;
            }
        }
        Self(words)
    }
}

impl PlantChange {
    /// Applies all changes to a device, or none.
    ///
    /// # Errors
    /// [`PlantError`] for the first refused change; nothing has changed.
    pub fn make(&self, node: NodeId, world: &mut World) -> Result<(), PlantError> {
        world.set_plants(node, self.changes())?;
        if let Some(is_damaged) = self.words.is_damaged {
            world.memory_mut(node).set_spoilt(is_damaged);
        }
        Ok(())
    }

    /// Returns the changes of the plant words, in the order of the words.
    #[must_use]
    pub fn changes(&self) -> &[Change] {
        &self.words.changes
    }

    /// Returns the plant words that the change sets.
    pub(crate) fn words(&self) -> Vec<&'static str> {
        self.changes().iter().map(|change| change.word().name).collect()
    }

    /// Returns the change that restores the values of the same words in `state`.
    pub(crate) fn earlier(&self, PlantState(state): &PlantState) -> Self {
        let is_set = |earlier: &&Change| self.changes().iter().any(|change| change.word() == earlier.word());
        let changes = state.changes.iter().filter(is_set).copied().collect();
        let is_damaged = state.is_damaged.filter(|_| self.words.is_damaged.is_some());
        Self { words: Words { changes, is_damaged }, ..Self::default() }
    }
}

impl From<Change> for PlantChange {
    fn from(change: Change) -> Self {
        let is_damaged = matches!(change, Change::MemoryFails(_)).then_some(false);
        Self { words: Words { changes: vec![change], is_damaged }, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use protocol_core::controller::BitRate;
    use protocol_core::device::plant::{Product, Values, WORDS, Word};
    use serde_json::json;

    use super::*;
    use crate::state::json_of;
    use crate::state::schema::Schemas;
    use crate::{SensorKind, ValveKind};

    /// Every value of a word, as text.
    fn values(word: &Word) -> Vec<String> {
        let healthy = word.healthy().expect(word.name).to_string();
        let mut values = vec![healthy];
        values.extend(word.values.range().into_iter().flat_map(|(min, max)| [min, max].map(|value| value.to_string())));
        match word.values {
            Values::Words(words) => values.extend(words.iter().map(ToString::to_string)),
            Values::NumberOrRange { .. } => values.push("5..20".to_owned()),
            Values::Number { .. } | Values::NumberOrOff { .. } => {}
        }
        values
    }

    /// Otherwise a change with `for_ms` could not restore the earlier value of the word.
    #[test]
    fn each_value_of_a_word_is_set_by_json_and_stands_in_the_state() {
        let mut world = World::new(BitRate::Kbit250, 1);
        let valve = world.add("valve", ValveKind::PveaCanopen);
        let sensor = world.add("sensor", SensorKind::Hat1000);
        for (product, node) in [(Product::Valve, valve), (Product::Encoder, sensor)] {
            let healthy = PlantState::of(node, &world);
            for word in product.words() {
                for value in values(word) {
                    let change = Change::parse(word.name, &value).expect(word.name);
                    let given = json!({ word.name: json_of(change) });
                    let given: PlantChange = serde_json::from_value(given).expect(word.name);
                    assert_eq!(given, PlantChange::from(change), "{word} {value}");
                    assert_eq!(given.words(), [word.name]);
                    given.make(node, &mut world).expect(word.name);
                    let state = PlantState::of(node, &world);
                    let json = json!({ word.name: json!(state)[word.name] });
                    assert_eq!(serde_json::from_value::<PlantChange>(json).ok(), Some(given.clone()), "{word} {value}");
                    given.earlier(&healthy).make(node, &mut world).expect(word.name);
                    assert_eq!(PlantState::of(node, &world), healthy, "{word} {value}");
                }
            }
        }
    }

    #[test]
    fn a_damaged_memory_is_a_value_of_json_alone() {
        let mut world = World::new(BitRate::Kbit250, 1);
        let valve = world.add("valve", ValveKind::PveaCanopen);
        for (value, is_damaged, fails) in [("damaged", true, false), ("write-fails", false, true), ("ok", false, false)]
        {
            let change: PlantChange = serde_json::from_value(json!({ "memory": value })).expect("a change");
            change.make(valve, &mut world).expect("a valve");
            let memory = world.memory(valve);
            assert_eq!((memory.is_spoilt(), memory.write_fails()), (is_damaged, fails));
            assert_eq!(json!(PlantState::of(valve, &world))["memory"], value);
        }
        for wrong in
            [json!({"memory": true}), json!({"spool": {"fault": 1}}), json!({"angle": 1}), json!({"oil": "on"})]
        {
            assert!(serde_json::from_value::<PlantChange>(wrong.clone()).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_members_of_a_change_are_the_words_of_the_plant() {
        let schemas = Schemas::of::<PlantChange>();
        let bent =
            schemas.check("PlantChange", &json!({ "spool": "broken" }), "null").map_err(|mismatch| mismatch.reason);
        assert!(bent.is_err_and(|told| told.starts_with("spool: unknown value 'broken'; accepted: ok, stuck, ")));
        let members = schemas.by_name()["PlantChange"]["properties"].as_object().expect("members");
        let words: BTreeSet<&str> = WORDS.iter().map(|word| word.name).collect();
        let in_time = ["for_ms", "profile"];
        let members_of_words = members.keys().map(String::as_str).filter(|key| !in_time.contains(key));
        assert_eq!(members_of_words.collect::<BTreeSet<_>>(), words);
        for word in &WORDS {
            let refusal = |value| {
                schemas.check("PlantChange", &json!({ word.name: value }), "null").map_err(|mismatch| mismatch.reason)
            };
            let range = word.values.range().filter(|_| word.name != "answer_ms");
            let Some((min, max)) = range else {
                let told = refusal(json!("bent")).expect_err(word.name);
                let values = match word.name {
                    "answer_ms" => "a whole number from 0 to 60000, or a list of 2 items".to_owned(),
                    _ => word.values.to_string().replace("on, off", "true or false"),
                };
                assert!(told.contains(&format!("accepted: {values}")), "{told}");
                continue;
            };
            assert_eq!((refusal(min.into()), refusal(max.into())), (Ok(()), Ok(())), "{word}");
            for beyond in [i64::from(min) - 1, i64::from(max) + 1] {
                let told = refusal(beyond.into()).expect_err(word.name);
                assert!(told.contains(&format!("a whole number from {min} to {max}")), "{told}");
            }
            let description = members[word.name]["description"].as_str().unwrap_or_default();
            assert!(max == i32::MAX || description.contains(&max.to_string()), "{word}: {description}");
        }
    }
}
