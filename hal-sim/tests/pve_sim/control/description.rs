//! The OpenAPI description against the running server.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::Rig;

/// Follows references.
fn resolved<'a>(description: &'a Value, mut schema: &'a Value) -> &'a Value {
    while let Some(reference) = schema["$ref"].as_str() {
        let pointer = reference.strip_prefix('#').expect("a local reference");
        schema = description.pointer(pointer).unwrap_or_else(|| panic!("{reference} leads nowhere"));
    }
    schema
}

/// Why a value is not what a schema says; of the keywords that the description uses.
fn mismatch(description: &Value, schema: &Value, value: &Value, path: &str) -> Option<String> {
    let schema = resolved(description, schema);
    let wrong = |what: &str| Some(format!("{path}: {what}: {value} against {schema}"));
    for several in ["oneOf", "anyOf"] {
        if let Some(options) = schema[several].as_array() {
            let fits = options.iter().filter(|option| mismatch(description, option, value, path).is_none()).count();
            return if fits == 0 { wrong(several) } else { None };
        }
    }
    if let Some(words) = schema["enum"].as_array()
        && !words.contains(value)
    {
        return wrong("enum");
    }
    let is_type = |kind: &Value| match kind.as_str().expect("a type") {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "null" => value.is_null(),
        other => panic!("{other}"),
    };
    let fits = match &schema["type"] {
        Value::Array(kinds) => kinds.iter().any(is_type),
        Value::Null => true,
        kind => is_type(kind),
    };
    if !fits {
        return wrong("type");
    }
    if let Some(items) = value.as_array() {
        return items.iter().find_map(|item| mismatch(description, &schema["items"], item, &format!("{path}[]")));
    }
    let object = value.as_object()?;
    let properties = schema["properties"].as_object();
    let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
    if let Some(missing) = required.into_iter().find(|key| !object.contains_key(*key)) {
        return wrong(&format!("{missing} is missing"));
    }
    object.iter().find_map(|(key, value)| match properties.and_then(|properties| properties.get(key)) {
        Some(schema) => mismatch(description, schema, value, &format!("{path}.{key}")),
        None => wrong(&format!("{key} is not described")),
    })
}

#[test]
fn what_is_described_is_what_is_answered() {
    let rig = Rig::stepped(&[
        "--device",
        "pvea-canopen@0x20",
        "--device",
        "pveo-isobus",
        "--device",
        "hat1000,bit-rate=250k",
    ]);
    let description = rig.get("/openapi.json");
    assert_eq!(description["servers"][0]["url"], "/api/v1");
    rig.power("pveo-isobus", json!({"on": false}));
    let calls = [
        ("get", "/devices", "/devices", None),
        ("get", "/devices/{name}", "/devices/pvea-canopen", None),
        ("get", "/devices/{name}", "/devices/pveo-isobus", None),
        ("get", "/devices/{name}", "/devices/hat1000", None),
        ("get", "/devices/{name}", "/devices/none", None),
        (
            "patch",
            "/devices/{name}/plant",
            "/devices/pvea-canopen/plant",
            Some(json!({"lever": null, "supply_mv": 24000})),
        ),
        ("patch", "/devices/{name}/plant", "/devices/pvea-canopen/plant", Some(json!({"lever": 20000}))),
        ("post", "/devices/{name}/power", "/devices/pvea-canopen/power", Some(json!({"reset": "watchdog"}))),
        ("post", "/devices/{name}/power", "/devices/pveo-isobus/power", Some(json!({"reset": "watchdog"}))),
        ("get", "/bus", "/bus", None),
        ("patch", "/bus", "/bus", Some(json!({"bit_rate": 250000}))),
        ("post", "/bus/disturb", "/bus/disturb", Some(json!({"frames": 1, "id": 1}))),
        ("post", "/bus/frames", "/bus/frames", Some(json!({"id": 1, "data": "00", "every_ms": 10}))),
        ("delete", "/bus/frames", "/bus/frames", None),
        (
            "post",
            "/wait",
            "/wait",
            Some(json!({"device": "pvea-canopen", "state": {"faults": ["internal"]}, "within_ms": 9})),
        ),
        (
            "post",
            "/wait",
            "/wait",
            Some(json!({"device": "pvea-canopen", "state": {"led": {"color": "off"}}, "within_ms": 9})),
        ),
        ("post", "/wait", "/wait", Some(json!({"frame": {"id": 0x720}, "within_ms": 100}))),
        ("post", "/wait", "/wait", Some(json!({"frame": {"id": 0x720}}))),
        ("get", "/time", "/time", None),
        ("post", "/time", "/time", Some(json!({"advance_ms": 1}))),
        ("get", "/trace", "/trace?limit=5", None),
        ("get", "/trace", "/trace?limit=x", None),
    ];
    let mut called = BTreeSet::new();
    for (method, template, path, body) in calls {
        let described = &description["paths"][template][method];
        assert!(described.is_object(), "{method} {template} is not described");
        called.insert((template.to_owned(), method.to_owned()));
        let (status, answer) =
            rig.call(&method.to_uppercase(), path, body.as_ref().map(ToString::to_string).as_deref());
        let schema = &described["responses"][status.to_string()]["content"]["application/json"]["schema"];
        assert!(schema.is_object(), "{method} {path}: {status} is not described: {answer}");
        assert_eq!(mismatch(&description, schema, &answer, path), None);
        if let Some(body) = body.filter(|_| status != 400) {
            let schema = &described["requestBody"]["content"]["application/json"]["schema"];
            assert_eq!(mismatch(&description, schema, &body, path), None);
        }
    }
    // Every described call was made, the stream of events aside.
    let paths = description["paths"].as_object().expect("paths");
    let described = paths.iter().flat_map(|(path, methods)| {
        methods.as_object().expect("methods").keys().map(move |method| (path.clone(), method.clone()))
    });
    let left: Vec<_> = described.filter(|call| !called.contains(call)).collect();
    assert_eq!(left, [("/events".to_owned(), "get".to_owned())]);
    let ids: BTreeSet<_> = paths
        .values()
        .flat_map(|methods| methods.as_object().expect("methods").values())
        .map(|call| call["operationId"].to_string())
        .collect();
    assert_eq!(ids.len(), called.len() + 1);
}
