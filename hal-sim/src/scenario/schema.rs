//! The format of scenarios as a JSON schema, for editors.

use serde_json::{Map, Value, json};
use utoipa::{PartialSchema, ToSchema};

use super::file::ScenarioFile;

/// Where a null of the control interface is "none" in a scenario; everywhere else a value that is given is not null.
const NULLABLE: &[(&str, &[&str])] = &[
    ("StateCondition", &["node_id", "bit_rate", "nmt", "dsm", "command", "set_point", "position", "solenoids", "led"]),
    ("PlantChange", &["lever"]),
    ("Spool", &["fault"]),
];

/// Returns the schema, in draft 2020-12.
#[must_use]
pub fn schema() -> String {
    let mut named = Vec::new();
    ScenarioFile::schemas(&mut named);
    let mut definitions = Map::new();
    for (name, schema) in named {
        let mut schema = serde_json::to_value(schema).unwrap_or_default();
        let nullable = NULLABLE.iter().find(|(known, _)| *known == name).map_or(&[][..], |(_, keys)| keys);
        if let Some(properties) = schema.get_mut("properties").and_then(Value::as_object_mut) {
            for (key, property) in properties {
                without_null(property, nullable.contains(&key.as_str()));
            }
        }
        definitions.insert(name, schema);
    }
    let mut schema = serde_json::to_value(ScenarioFile::schema()).unwrap_or_default();
    if let Some(properties) = schema.get_mut("properties").and_then(Value::as_object_mut) {
        properties.values_mut().for_each(|property| without_null(property, false));
    }
    if let Some(root) = schema.as_object_mut() {
        root.insert("$schema".to_owned(), json!("https://json-schema.org/draft/2020-12/schema"));
        root.insert("title".to_owned(), json!("Scenario of pve-sim"));
        root.insert("$defs".to_owned(), Value::Object(definitions));
    }
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    text.replace("#/components/schemas/", "#/$defs/") + "\n"
}

/// Takes null out of what a property accepts, or puts "none" in its place.
fn without_null(property: &mut Value, nullable: bool) {
    let Some(fields) = property.as_object_mut() else { return };
    let description = fields.remove("description");
    if let Some(Value::Array(types)) = fields.get_mut("type") {
        types.retain(|name| name != "null");
        if let [only] = types.as_slice() {
            let only = only.clone();
            fields.insert("type".to_owned(), only);
        }
    }
    if let Some(Value::Array(choices)) = fields.get_mut("oneOf") {
        choices.retain(|choice| *choice != json!({ "type": "null" }));
    }
    if nullable {
        let some = std::mem::take(fields);
        fields.insert("anyOf".to_owned(), json!([some, { "const": "none" }]));
    }
    if let Some(mut description) = description {
        if nullable && let Some(text) = description.as_str() {
            description = text.replace("null", "\"none\"").into();
        }
        fields.insert("description".to_owned(), description);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    fn schema() -> Value {
        serde_json::from_str(&super::schema()).expect("JSON")
    }

    #[test]
    fn the_copy_for_editors_is_up_to_date() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/scenario.schema.json");
        let copy = std::fs::read_to_string(path).expect("the copy").replace('\r', "");
        assert!(copy == super::schema(), "pve-sim scenario --schema > docs/scenario.schema.json");
    }

    /// The keys are those that the reader names.
    #[test]
    fn the_schema_has_the_keys_of_the_reader() {
        let schema = schema();
        let keys = |schema: &Value| {
            let mut keys: Vec<String> = schema["properties"].as_object().expect("keys").keys().cloned().collect();
            keys.sort();
            keys
        };
        let read = |text: &str| {
            let reason = Scenario::parse(text).expect_err(text).reason;
            let (_, accepted) = reason.rsplit_once("accepted: ").expect("a list");
            let mut keys: Vec<String> = accepted.split(", ").map(str::to_owned).collect();
            keys.sort();
            keys
        };
        let step = |step: &str| read(&format!("devices = [\"pvea-canopen\"]\nsteps = [{{ {step} }}]"));
        assert_eq!(keys(&schema), read("qqq = 1"));
        assert_eq!(keys(&schema["$defs"]["Step"]), step("qqq = 1"));
        assert_eq!(keys(&schema["$defs"]["StateCondition"]), step("expect = { qqq = 1 }"));
        assert_eq!(keys(&schema["$defs"]["PlantChange"]), step("plant = { qqq = 1 }"));
        assert_eq!(schema["required"], json!(["devices", "steps"]));
        assert!(!schema.to_string().contains("\"null\"") && !schema.to_string().contains("components"), "{schema:#}");
    }

    /// Where the reader takes "none" for some device the schema does, and nowhere else.
    #[test]
    fn none_is_where_null_is() {
        let schema = schema();
        for (table, key, beside) in [("expect", "StateCondition", "t_us = 1, "), ("plant", "PlantChange", "")] {
            for (field, property) in schema["$defs"][key]["properties"].as_object().expect("keys") {
                let beside = if field == "t_us" { "" } else { beside };
                let reads = ["pvea-canopen", "pvea-isobus", "hat1000"].map(|device| {
                    let step = format!("{{ {table} = {{ {beside}{field} = \"none\" }} }}");
                    Scenario::parse(&format!("devices = [\"{device}\"]\nsteps = [{step}]"))
                });
                let is_read = reads.iter().any(Result::is_ok);
                assert_eq!(is_read, property.to_string().contains("none"), "{field}: {reads:?} {property}");
            }
        }
    }
}
