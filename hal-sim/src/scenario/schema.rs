//! The JSON schema of scenarios, for editors.

use serde_json::{Map, Value, json};
use utoipa::ToSchema as _;

use super::file::ScenarioFile;
use crate::state::schema::Schemas;

/// Returns the JSON schema, in draft 2020-12.
#[must_use]
pub fn schema() -> String {
    let mut definitions: Map<String, Value> = Schemas::of::<ScenarioFile>().by_name().clone();
    replace_null(&mut definitions);
    published(&ScenarioFile::name(), "Scenario of pve-sim", definitions)
}

/// Returns the JSON schema text of the named definition, including the other definitions.
pub(crate) fn published(name: &str, title: &str, mut definitions: Map<String, Value>) -> String {
    let mut schema = definitions.remove(name).unwrap_or_default();
    if let Some(root) = schema.as_object_mut() {
        root.insert("$schema".to_owned(), json!("https://json-schema.org/draft/2020-12/schema"));
        root.insert("title".to_owned(), json!(title));
        root.insert("$defs".to_owned(), Value::Object(definitions));
    }
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    text.replace("#/components/schemas/", "#/$defs/") + "\n"
}

/// Replaces null with "none" in the schemas of nullable properties.
pub(crate) fn replace_null(definitions: &mut Map<String, Value>) {
    for schema in definitions.values_mut() {
        if let Some(members) = schema.get_mut("properties").and_then(Value::as_object_mut) {
            members.values_mut().for_each(with_none);
        }
    }
}

/// Replaces null with "none" in the schema of a nullable property.
fn with_none(member: &mut Value) {
    let Some(fields) = member.as_object_mut() else { return };
    let description = fields.remove("description");
    let mut accepts_null = false;
    if let Some(Value::Array(types)) = fields.get_mut("type") {
        accepts_null = types.iter().any(|name| name == "null");
        types.retain(|name| name != "null");
    }
    if let Some(Value::Array(choices)) = fields.get_mut("oneOf") {
        accepts_null |= choices.contains(&json!({ "type": "null" }));
        choices.retain(|choice| *choice != json!({ "type": "null" }));
    }
    if accepts_null {
        let some = std::mem::take(fields);
        fields.insert("anyOf".to_owned(), json!([some, { "const": "none" }]));
    }
    if let Some(mut description) = description {
        if accepts_null && let Some(text) = description.as_str() {
            description = text.replace("null", "\"none\"").into();
        }
        fields.insert("description".to_owned(), description);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

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

    /// The schema and the reader accept the same keys.
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

    #[test]
    fn the_page_and_the_dictionary_have_each_key_of_a_step() {
        let read = |path| std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).expect(path);
        let (page, dictionary) = (read("../docs/scenarios.md"), read("../fuzz/dictionaries/scenario.dict"));
        for key in schema()["$defs"]["Step"]["properties"].as_object().expect("keys").keys() {
            let is_told = [format!("`{key}`"), format!("`{key} = ")].iter().any(|told| page.contains(told));
            assert!(is_told, "docs/scenarios.md: {key} is missing");
            let is_there = dictionary.lines().any(|line| line == format!("\"{key}\""));
            assert!(is_there, "fuzz/dictionaries/scenario.dict: {key} is missing");
        }
    }

    /// The schema accepts "none" exactly where the reader accepts it for at least one device.
    #[test]
    fn none_is_where_null_is() {
        let schema = schema();
        for (table, key, beside) in [("expect", "StateCondition", "t_us = 1, "), ("plant", "PlantChange", "")] {
            for (field, property) in schema["$defs"][key]["properties"].as_object().expect("keys") {
                let beside = if field == "t_us" { "" } else { beside };
                let reads = ["pvea-canopen", "pvea-isobus", "hat1000"].map(|device| {
                    let step = format!("{{ {table} = {{ {beside}{field} = \"none\" }} }}");
                    Scenario::read(&format!("devices = [\"{device}\"]\nsteps = [{step}]"))
                });
                let is_read = reads.iter().any(Result::is_ok);
                assert_eq!(is_read, property.to_string().contains("none"), "{field}: {reads:?} {property}");
            }
        }
    }
}
