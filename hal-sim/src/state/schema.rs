//! The JSON schemas of all input, and the validation of input against them. The published schemas therefore agree with
//! the accepted input.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use protocol_core::actuator::Position;
use protocol_core::device::plant::WORDS;
use serde_json::{Map, Value, json};
use utoipa::ToSchema;
use utoipa::openapi::{RefOr, schema};

use super::{Invalid, words};
use crate::Kind;

/// The nullable properties of each schema. All other optional properties may be missing but not null.
const NULLABLE: &[(&str, &[&str])] = &[
    ("StateCondition", &["node_id", "bit_rate", "nmt", "dsm", "command", "set_point", "position", "solenoids", "led"]),
    ("Spool", &["fault"]),
];

/// The keys of the kinds of a communication fault, of which a fault has exactly one.
pub(super) const FAULT_KINDS: [&str; 9] =
    ["lose", "delay", "repeat", "swap", "corrupt", "insert", "masquerade", "destroy", "omit"];

/// Schemas by name, in draft 2020-12.
#[derive(Clone, Debug)]
pub struct Schemas(Map<String, Value>);

/// A step of the path to a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A key of an object.
    Key(String),
    /// An item of a list.
    Item(usize),
}

/// A value that a schema does not accept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mismatch {
    /// The path to the invalid value.
    pub path: Vec<Place>,
    /// The reason, with the name of the invalid value and the accepted values.
    pub reason: String,
}

impl Schemas {
    /// Returns the schema of an input type and all referenced schemas. Each type's schemas are built once.
    pub fn of<T: ToSchema + 'static>() -> &'static Self {
        static MADE: Mutex<BTreeMap<TypeId, &'static Schemas>> = Mutex::new(BTreeMap::new());
        MADE.lock().unwrap_or_else(PoisonError::into_inner).entry(TypeId::of::<T>()).or_insert_with(|| {
            let mut named = vec![(T::name().into_owned(), T::schema())];
            T::schemas(&mut named);
            Box::leak(Box::new(Self::requests(named)))
        })
    }

    /// Creates the schemas of input types. An optional property is an `Option` in Rust, but nullable only if listed in
    /// [`NULLABLE`].
    fn requests(named: impl IntoIterator<Item = (String, RefOr<schema::Schema>)>) -> Self {
        let schemas = named.into_iter().map(|(name, schema)| {
            let mut schema = serde_json::to_value(schema).unwrap_or_default();
            without_null(&name, &mut schema);
            without_formats(&mut schema);
            restrict(&name, &mut schema);
            (name, schema)
        });
        let mut schemas: Map<String, Value> = schemas.collect();
        if schemas.contains_key("PlantChange") {
            schemas.extend(words::definitions());
        }
        Self(schemas)
    }

    /// Returns the schemas by name.
    pub const fn by_name(&self) -> &Map<String, Value> {
        &self.0
    }

    /// Converts a text to a number or a Boolean if the schema of the property requires one, otherwise to a string.
    pub fn value_of(&self, name: &str, key: &str, text: &str) -> Value {
        let kind = self.0.get(name).and_then(|schema| schema["properties"][key]["type"].as_str());
        let is_number = !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit());
        match (kind, text) {
            (Some("integer"), _) if is_number => text.parse::<u64>().map_or_else(|_| text.into(), Value::from),
            // JSON has no number for `nan` and `inf`.
            (Some("number"), _) => match text.parse::<f64>() {
                Ok(number) if number.is_finite() => number.into(),
                _ => text.into(),
            },
            (Some("boolean"), "true") => true.into(),
            (Some("boolean"), "false") => false.into(),
            _ => text.into(),
        }
    }

    /// Validates a value against the named schema. `null` is the word for null in messages.
    ///
    /// # Errors
    /// [`Mismatch`] for the first invalid value.
    pub fn check(&self, name: &str, value: &Value, null: &str) -> Result<(), Mismatch> {
        let Some(schema) = self.0.get(name) else { return Ok(()) };
        Checker { schemas: self, null }.mismatch(schema, value, &mut Vec::new()).map_or(Ok(()), Err)
    }
}

impl From<Map<String, Value>> for Schemas {
    fn from(definitions: Map<String, Value>) -> Self {
        Self(definitions)
    }
}

impl From<Mismatch> for Invalid {
    fn from(mismatch: Mismatch) -> Self {
        Self(mismatch.reason)
    }
}

/// Removes null from the schema of each property that is not nullable.
fn without_null(name: &str, schema: &mut Value) {
    let nullable = NULLABLE.iter().find(|(known, _)| *known == name).map_or(&[][..], |(_, keys)| keys);
    let Some(members) = schema.get_mut("properties").and_then(Value::as_object_mut) else { return };
    for (_, member) in members.iter_mut().filter(|(key, _)| !nullable.contains(&key.as_str())) {
        if let Some(Value::Array(types)) = member.get_mut("type") {
            types.retain(|name| name != "null");
            if let [only] = types.as_slice() {
                member["type"] = only.clone();
            }
        }
        for several in ["oneOf", "anyOf"] {
            if let Some(Value::Array(choices)) = member.get_mut(several) {
                choices.retain(|choice| *choice != json!({ "type": "null" }));
            }
        }
    }
}

/// Removes the integer formats from a schema, because the limits already define the exact range.
pub fn without_formats(schema: &mut Value) {
    match schema {
        Value::Object(members) => {
            if members.get("format").is_some_and(|format| *format == "int32" || *format == "int64") {
                members.remove("format");
            }
            members.values_mut().for_each(without_formats);
        }
        Value::Array(items) => items.iter_mut().for_each(without_formats),
        _ => {}
    }
}

/// Adds constraints that attributes cannot express: dependencies between properties, and limits defined by the core.
fn restrict(name: &str, schema: &mut Value) {
    let members = schema.get("properties").and_then(Value::as_object);
    if members.is_some_and(|members| members.contains_key("id") && members.contains_key("extended")) {
        // An identifier of 11 bits; of 29 bits with `extended`; or of 29 bits as a string of eight digits.
        schema["anyOf"] = json!([
            {
                "properties": {
                    "id": { "anyOf": [{ "type": "integer", "maximum": 0x7FF }, { "type": "string", "pattern": STANDARD }] },
                    "extended": { "enum": [false] },
                },
            },
            { "properties": { "extended": { "enum": [true] } }, "required": ["id", "extended"] },
            {
                "properties": { "id": { "type": "string", "pattern": EIGHT_DIGITS }, "extended": { "enum": [true] } },
                "required": ["id"],
            },
        ]);
    }
    match name {
        "PowerChange" => {
            schema["minProperties"] = 1.into();
            schema["maxProperties"] = 1.into();
        }
        "PlantChange" => words::add_to_change(schema, ["for_ms", "profile"]),
        "StateCondition" => {
            let mut faults: Vec<&str> = Kind::ALL.iter().flat_map(|kind| kind.fault_names()).collect();
            faults.sort_unstable();
            faults.dedup();
            schema["properties"]["faults"]["items"] = json!({ "type": "string", "enum": faults });
        }
        "SetPointValue" | "PositionCondition" => {
            schema["oneOf"][0]["minimum"] = Position::MIN.raw().into();
            schema["oneOf"][0]["maximum"] = Position::MAX.raw().into();
        }
        "CommunicationFault" => {
            schema["oneOf"] = FAULT_KINDS.iter().map(|kind| json!({ "required": [kind] })).collect();
        }
        "Profile" => {
            let numeric = WORDS.iter().filter(|word| word.values.range().is_some()).map(|word| word.name);
            schema["properties"]["word"]["enum"] = numeric.collect();
        }
        "Points" => {
            schema["oneOf"][1]["minItems"] = 1.into();
            schema["oneOf"][1]["items"]["minItems"] = 2.into();
            schema["oneOf"][1]["items"]["maxItems"] = 2.into();
        }
        "Limits" | "LedCondition" => schema["minProperties"] = 1.into(),
        "Wait" => {
            schema["anyOf"] = json!([
                { "required": ["device", "state"], "maxProperties": 3 },
                { "required": ["frame"], "maxProperties": 2 },
                { "properties": { "received": { "enum": [true] } }, "required": ["received"], "maxProperties": 2 },
            ]);
        }
        _ => {}
    }
}

/// A regular expression for 11-bit identifiers.
const STANDARD: &str = "^(0[xX])?0{0,4}[0-7]?[0-9A-Fa-f]{1,2}$";

/// A regular expression for hex strings of eight digits, which are 29-bit identifiers.
const EIGHT_DIGITS: &str = "^(0[xX])?[01][0-9A-Fa-f]{7}$";

/// A regular expression for all identifiers.
pub const IDENTIFIER: &str = "^(0[xX])?([01][0-9A-Fa-f]{7}|[0-9A-Fa-f]{1,7})$";

/// The accepted forms of an expectation in a step.
const EXPECTED: &str = "a frame as in \"1A0#0F00 0020\", a list of frames, or a state as in { dsm = \"active\" }";

struct Checker<'a> {
    schemas: &'a Schemas,
    null: &'a str,
}

impl<'a> Checker<'a> {
    fn resolved(&self, schema: &'a Value) -> &'a Value {
        let name = schema["$ref"].as_str().and_then(|reference| reference.rsplit('/').next());
        match name.and_then(|name| self.schemas.0.get(name)) {
            Some(referred) => self.resolved(referred),
            None => schema,
        }
    }

    /// Returns whether a schema, or any of its choices, describes an object with properties.
    fn has_members(&self, schema: &'a Value) -> bool {
        self.leaves(schema).iter().any(|leaf| leaf["properties"].is_object())
    }

    /// Returns the first mismatch between a value and its schema.
    fn mismatch(&self, schema: &'a Value, value: &Value, path: &mut Vec<Place>) -> Option<Mismatch> {
        let schema = self.resolved(schema);
        if let Some(choices) = choices(schema) {
            let fails = |choice: &&'a Value| self.mismatch(choice, value, &mut path.clone()).is_some();
            if !choices.iter().all(|choice| fails(&choice)) {
                return None;
            }
            // For an object, the mismatch is taken from the choice with members, so that the message names a member.
            let same = choices.iter().find(|choice| value.is_object() && self.has_members(choice));
            return match (same, choices.as_slice()) {
                (Some(only), _) | (None, [only]) => self.mismatch(only, value, path),
                _ => Some(self.refusal(schema, value, path)),
            };
        }
        if let Some(words) = schema["enum"].as_array() {
            return (!words.contains(value)).then(|| self.refusal(schema, value, path));
        }
        let fits = match &schema["type"] {
            Value::Array(kinds) => kinds.iter().any(|kind| is_of(kind, value)),
            Value::Null => true,
            kind => is_of(kind, value),
        };
        if !fits || !is_within(schema, value) || !has_length(schema, value) {
            return Some(self.refusal(schema, value, path));
        }
        match value {
            Value::Array(items) => items.iter().enumerate().find_map(|(place, item)| {
                path.push(Place::Item(place));
                let mismatch = self.mismatch(&schema["items"], item, path);
                path.pop();
                mismatch
            }),
            Value::Object(members) => self.of_members(schema, members, path),
            _ => None,
        }
    }

    fn of_members(&self, schema: &'a Value, members: &Map<String, Value>, path: &mut Vec<Place>) -> Option<Mismatch> {
        let known = schema["properties"].as_object()?;
        for (key, value) in members {
            path.push(Place::Key(key.clone()));
            let mismatch = match known.get(key) {
                Some(member) => self.mismatch(member, value, path),
                None => {
                    let place = named(&path[..path.len() - 1]);
                    let known: Vec<&str> = known.keys().map(String::as_str).collect();
                    let (tip, known) = (meant(key, &known), known.join(", "));
                    let reason = format!("{}unknown key '{key}'{tip}; accepted: {known}", prefix(&place));
                    Some(Mismatch { path: path.clone(), reason })
                }
            };
            path.pop();
            if mismatch.is_some() {
                return mismatch;
            }
        }
        let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
        let missing = required.into_iter().find(|key| !members.contains_key(*key))?;
        let accepted = known.get(missing).map(|member| self.accepted(member)).unwrap_or_default();
        let reason = format!("{}{missing} is missing; accepted: {accepted}", prefix(&named(path)));
        Some(Mismatch { path: path.clone(), reason })
    }

    fn refusal(&self, schema: &'a Value, value: &Value, path: &[Place]) -> Mismatch {
        let (place, accepted) = (named(path), self.accepted(schema));
        let words = self.words(schema);
        let reason = match value {
            Value::String(text) if !words.is_empty() => {
                format!("{}unknown value '{text}'{}; accepted: {accepted}", prefix(&place), meant(text, &words))
            }
            _ => {
                let place = if place.is_empty() { "the body" } else { &place };
                let found = if value.is_null() { self.null.to_owned() } else { value.to_string() };
                format!("{place} {found} is not valid; accepted: {accepted}")
            }
        };
        Mismatch { path: path.to_vec(), reason }
    }

    /// Returns the words that a schema, or any of its choices, accepts.
    fn words(&self, schema: &'a Value) -> Vec<&'a str> {
        let leaves = self.leaves(schema).into_iter();
        leaves.filter_map(|leaf| leaf["enum"].as_array()).flatten().filter_map(Value::as_str).collect()
    }

    /// Describes the values that a schema accepts.
    fn accepted(&self, schema: &'a Value) -> String {
        let schema = self.resolved(schema);
        if self.is_expected(schema) {
            return EXPECTED.to_owned();
        }
        if choices(schema).is_some() {
            let (null, some): (Vec<_>, Vec<_>) =
                self.leaves(schema).into_iter().partition(|choice| choice["type"] == "null");
            return list(some.into_iter().chain(null).map(|choice| self.accepted(choice)).collect());
        }
        if let Some(words) = schema["enum"].as_array() {
            let words = words.iter().map(|word| word.as_str().map_or_else(|| word.to_string(), str::to_owned));
            return words.collect::<Vec<_>>().join(", ");
        }
        match &schema["type"] {
            Value::Array(kinds) => list(kinds.iter().map(|kind| self.of_kind(kind, schema)).collect()),
            kind => self.of_kind(kind, schema),
        }
    }

    /// Returns the innermost choices of a schema.
    fn leaves(&self, schema: &'a Value) -> Vec<&'a Value> {
        let schema = self.resolved(schema);
        match choices(schema).filter(|_| !self.is_expected(schema)) {
            Some(choices) => choices.iter().flat_map(|choice| self.leaves(choice)).collect(),
            None => vec![schema],
        }
    }

    /// Returns whether a schema is the schema of an expectation in a step.
    fn is_expected(&self, schema: &Value) -> bool {
        self.schemas.0.get("Expected").is_some_and(|expected| std::ptr::eq(expected, schema))
    }

    fn of_kind(&self, kind: &Value, schema: &Value) -> String {
        match kind.as_str().unwrap_or_default() {
            kind @ ("integer" | "number") => {
                let noun = if kind == "integer" { "whole number" } else { "number" };
                match (&schema["minimum"], &schema["maximum"]) {
                    (Value::Null, _) | (_, Value::Null) => format!("a {noun}"),
                    (min, max) => format!("a {noun} from {min} to {max}"),
                }
            }
            "boolean" => "true or false".to_owned(),
            "string" => match schema["examples"][0].as_str() {
                Some(example) => format!("a hex string as in \"{example}\""),
                None => "a string".to_owned(),
            },
            "array" => match schema["maxItems"].as_u64() {
                Some(items) => format!("a list of {items} items"),
                None => "a list".to_owned(),
            },
            "null" => self.null.to_owned(),
            "object" => match schema["properties"].as_object() {
                Some(members) if members.len() < 4 => {
                    let keys: Vec<String> = members.keys().map(|key| format!("\"{key}\"")).collect();
                    format!("{{{}}}", keys.join(", "))
                }
                _ => "an object".to_owned(),
            },
            kind => format!("a {kind}"),
        }
    }
}

/// Returns the choices of a schema; `None` if the schema has no choices, or has properties.
fn choices(schema: &Value) -> Option<&Vec<Value>> {
    let has_members = schema["properties"].is_object();
    ["oneOf", "anyOf"].iter().find_map(|several| schema[several].as_array()).filter(|_| !has_members)
}

fn is_of(kind: &Value, value: &Value) -> bool {
    match kind.as_str().unwrap_or_default() {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        _ => value.is_null(),
    }
}

/// Returns whether a number is within the limits of its schema; true for any value that is not a number.
fn is_within(schema: &Value, value: &Value) -> bool {
    let whole = |value: &Value| value.as_i64().map(i128::from).or_else(|| value.as_u64().map(i128::from));
    let Some(number) = whole(value) else {
        let (min, max) = (schema["minimum"].as_f64(), schema["maximum"].as_f64());
        return value
            .as_f64()
            .is_none_or(|number| min.is_none_or(|min| number >= min) && max.is_none_or(|max| number <= max));
    };
    whole(&schema["minimum"]).is_none_or(|min| number >= min)
        && whole(&schema["maximum"]).is_none_or(|max| number <= max)
}

/// Returns whether a list has the number of items that its schema requires, if any.
fn has_length(schema: &Value, value: &Value) -> bool {
    schema["maxItems"].as_u64().zip(value.as_array()).is_none_or(|(items, list)| list.len() as u64 == items)
}

/// Formats the path of a value: `steps[2].plant.supply_mv`.
fn named(path: &[Place]) -> String {
    path.iter().fold(String::new(), |name, place| match place {
        Place::Key(key) if name.is_empty() => key.clone(),
        Place::Key(key) => format!("{name}.{key}"),
        Place::Item(item) => format!("{name}[{item}]"),
    })
}

fn prefix(place: &str) -> String {
    if place.is_empty() { String::new() } else { format!("{place}: ") }
}

/// Returns a "did you mean" hint with the most similar known word, if any.
fn meant(word: &str, known: &[&str]) -> String {
    let near = known.iter().map(|known| (strsim::jaro_winkler(word, known), known));
    let near = near.filter(|(likeness, _)| *likeness > 0.79).max_by(|one, other| one.0.total_cmp(&other.0));
    near.map_or_else(String::new, |(_, near)| format!("; did you mean '{near}'?"))
}

/// Joins choices into an English list.
fn list(choices: Vec<String>) -> String {
    match choices.as_slice() {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{}, or {last}", first.join(", ")),
    }
}
