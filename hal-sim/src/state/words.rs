//! The plant words as JSON: their values, and the schemas of these values. Both are derived from the word table in the
//! core.

use std::fmt;

use protocol_core::actuator::SpoolFault;
use protocol_core::device::plant::{Change, Product, Value, Values, WORDS, Word};
use serde::de::{self, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value as Json, json};

const SPOOL: &str = "spool";
const MEMORY: &str = "memory";
/// A value of `memory` that the console lacks: the memory is unreadable at the next start.
const DAMAGED: &str = "damaged";
const ON: &str = "on";
const OFF: &str = "off";
const OK: &str = "ok";
const SWITCH: Values = Values::Words(&[ON, OFF]);

/// Plant words with their values, in the order of [`WORDS`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Words {
    pub(super) changes: Vec<Change>,
    /// True if the memory is unreadable at the next start; `None` if the memory is not among the words.
    pub(super) is_damaged: Option<bool>,
}

impl<'de> Deserialize<'de> for Words {
    fn deserialize<D: Deserializer<'de>>(words: D) -> Result<Self, D::Error> {
        struct Members;

        impl<'de> Visitor<'de> for Members {
            type Value = Words;

            fn expecting(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
                text.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Words, A::Error> {
                let mut words = Words::default();
                while let Some((name, value)) = members.next_entry::<String, Json>()? {
                    words.add(&name, &value)?;
                }
                words.changes.sort_by_key(|change| WORDS.iter().position(|word| word == change.word()));
                Ok(words)
            }
        }

        words.deserialize_map(Members)
    }
}

impl Words {
    fn add<E: de::Error>(&mut self, name: &str, value: &Json) -> Result<(), E> {
        let word = WORDS.iter().find(|word| word.name == name);
        let word = word.ok_or_else(|| E::custom(format_args!("unknown key '{name}'")))?;
        if self.changes.iter().any(|change| change.word() == word) {
            return Err(E::duplicate_field(word.name));
        }
        let is_damaged = word.name == MEMORY && *value == DAMAGED;
        let change = if is_damaged { Some(Change::MemoryFails(false)) } else { change(word, value) };
        self.changes.push(change.ok_or_else(|| E::custom(format_args!("invalid value of {name}")))?);
        if word.name == MEMORY {
            self.is_damaged = Some(is_damaged);
        }
        Ok(())
    }
}

impl Serialize for Words {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.changes.iter().map(|change| {
            let value = match change {
                Change::Spool(SpoolFault::None) => json!({ "fault": null }),
                Change::Spool(_) => json!({ "fault": json_of(*change) }),
                Change::MemoryFails(_) if self.is_damaged == Some(true) => DAMAGED.into(),
                _ => json_of(*change),
            };
            (change.word().name, value)
        }))
    }
}

/// Converts a JSON value to the change of a word, without a check of the range. `None` if the value is malformed.
fn change(word: &Word, value: &Json) -> Option<Change> {
    let text = match (word.values, value) {
        (SWITCH, Json::Bool(on)) => if *on { ON } else { OFF }.to_owned(),
        (SWITCH, _) => return None,
        (Values::Words(_), Json::String(text)) => text.clone(),
        (Values::Words(_), Json::Object(spool)) if word.name == SPOOL => match spool.get("fault")? {
            Json::Null => OK.to_owned(),
            fault => fault.as_str()?.to_owned(),
        },
        (Values::NumberOrOff { .. }, Json::Null) => OFF.to_owned(),
        (Values::NumberOrRange { .. }, Json::Array(limits)) => match limits.as_slice() {
            [from, to] => format!("{from}..{to}"),
            _ => return None,
        },
        (Values::Number { .. } | Values::NumberOrOff { .. } | Values::NumberOrRange { .. }, Json::Number(number)) => {
            number.to_string()
        }
        _ => return None,
    };
    Change::parse(word.name, &text)
}

/// Converts the value of a change to JSON: on and off become Booleans, `off` beside numbers becomes null, and a range
/// becomes a list.
#[must_use]
pub fn json_of(change: Change) -> Json {
    match (change.word().values, change.text().1) {
        (SWITCH, value) => (value == Value::Word(ON)).into(),
        (Values::NumberOrOff { .. }, Value::Word(_)) => Json::Null,
        (_, Value::Natural(number)) => number.into(),
        (_, Value::Integer(number)) => number.into(),
        (_, Value::Range(from, to)) => [from, to].as_slice().into(),
        (_, Value::Word(word)) => word.into(),
    }
}

/// Returns the schema of a product's plant.
pub(super) fn schema_of_plant(product: Product, description: &str) -> Json {
    let members = product.words().map(|word| (word.name.to_owned(), schema(word, "Spool")));
    json!({
        "description": description,
        "type": "object",
        "properties": members.collect::<Map<_, _>>(),
        "required": product.words().map(|word| word.name).collect::<Vec<_>>(),
    })
}

/// Adds the words to the schema of a change. `beside` lists its other keys.
pub(super) fn add_to_change(schema_of_change: &mut Json, beside: [&str; 2]) {
    for word in &WORDS {
        schema_of_change["properties"][word.name] = schema(word, "SpoolChange");
    }
    let only = |product: Product| {
        let keys = product.words().map(|word| word.name).chain(beside).map(|key| (key.to_owned(), json!({})));
        json!({ "properties": keys.collect::<Map<_, _>>(), "additionalProperties": false })
    };
    schema_of_change["anyOf"] = json!([only(Product::Valve), only(Product::Encoder)]);
    schema_of_change["additionalProperties"] = false.into();
}

/// Returns the schemas to which the schemas of words refer.
pub(super) fn definitions() -> [(String, Json); 4] {
    let words = |name: &str, other: Option<&'static str>| {
        let values = WORDS.iter().find(|word| word.name == name).map(|word| word.values);
        let known = if let Some(Values::Words(known)) = values { known } else { &[] };
        known.iter().copied().chain(other).collect::<Vec<_>>()
    };
    let reference = |name| json!({ "$ref": reference(name) });
    let memory = json!({
        "description": "The non-volatile memory.", "type": "string", "enum": words(MEMORY, Some(DAMAGED)),
    });
    let fault = json!({ "description": "A fault of the spool.", "type": "string", "enum": words(SPOOL, None) });
    let spool = json!({
        "description": "The spool.",
        "type": "object",
        "properties": { "fault": {
            "description": "The fault of the spool; null or \"ok\" for a healthy spool.",
            "oneOf": [{ "type": "null" }, reference("SpoolFaultName")],
        } },
        "required": ["fault"],
        "additionalProperties": false,
    });
    let change = json!({
        "description": "A change of the spool: a word alone, or an object as in the state.",
        "oneOf": [reference("SpoolFaultName"), reference("Spool")],
    });
    [("Memory", memory), ("SpoolFaultName", fault), ("Spool", spool), ("SpoolChange", change)]
        .map(|(name, schema)| (name.to_owned(), schema))
}

/// Returns the reference to a schema.
fn reference(name: &str) -> String {
    format!("#/components/schemas/{name}")
}

/// Returns the schema of a word. `spool` is the name of the spool's schema.
fn schema(word: &Word, spool: &str) -> Json {
    let mut schema = match word.values {
        SWITCH => json!({ "type": "boolean" }),
        Values::Words(_) if word.name == SPOOL => json!({ "$ref": reference(spool) }),
        Values::Words(_) if word.name == MEMORY => json!({ "$ref": reference("Memory") }),
        Values::Words(words) => json!({ "type": "string", "enum": words }),
        Values::Number { min, max, .. } => json!({ "type": "integer", "minimum": min, "maximum": max }),
        Values::NumberOrOff { min, max } => json!({ "type": ["integer", "null"], "minimum": min, "maximum": max }),
        Values::NumberOrRange { min, max, .. } => {
            let one = json!({ "type": "integer", "minimum": min, "maximum": max });
            json!({ "oneOf": [one, { "type": "array", "items": one, "minItems": 2, "maxItems": 2 }] })
        }
    };
    schema["description"] = description(word).into();
    schema
}

fn description(word: &Word) -> String {
    let values = match word.values {
        Values::Number { min, max, unit } => format!("; {min} to {max} {unit}"),
        Values::NumberOrOff { min, max } => format!("; {min} to {max}, or null for off"),
        Values::NumberOrRange { min, max, unit } => {
            format!("; {min} to {max} {unit}, or a list of the smallest and the largest")
        }
        Values::Words(_) => String::new(),
    };
    let product = match word.product {
        Some(Product::Valve) => "Valves: ",
        Some(Product::Encoder) => "Angle sensors: ",
        None => "",
    };
    let text = format!("{product}{}{values}.", word.help);
    text[..1].to_uppercase() + &text[1..]
}
