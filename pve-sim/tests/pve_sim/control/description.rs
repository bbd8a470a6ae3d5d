//! The OpenAPI description against the running server.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::Rig;

/// Resolves references.
fn resolved<'a>(description: &'a Value, mut schema: &'a Value) -> &'a Value {
    while let Some(reference) = schema["$ref"].as_str() {
        let pointer = reference.strip_prefix('#').expect("a local reference");
        schema = description.pointer(pointer).unwrap_or_else(|| panic!("{reference} leads nowhere"));
    }
    schema
}

/// Returns why a value does not fit a schema, for the keywords of the description.
fn mismatch(description: &Value, schema: &Value, value: &Value, path: &str) -> Option<String> {
    let schema = resolved(description, schema);
    let wrong = |what: &str| Some(format!("{path}: {what}: {value} against {schema}"));
    for several in ["oneOf", "anyOf"] {
        if let Some(options) = schema[several].as_array() {
            let fits = options.iter().filter(|option| mismatch(description, option, value, path).is_none()).count();
            match fits {
                0 => return wrong(several),
                2.. if several == "oneOf" && schema["properties"].is_object() => return wrong(several),
                // With members beside them, choices express dependencies.
                _ if schema["properties"].is_object() => {}
                _ => return None,
            }
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
    if let Some(number) = value.as_f64()
        && (schema["minimum"].as_f64().is_some_and(|min| number < min)
            || schema["maximum"].as_f64().is_some_and(|max| number > max))
    {
        return wrong("limits");
    }
    let is_within = |length: usize, least: &str, most: &str| {
        schema[least].as_u64().is_none_or(|least| length as u64 >= least)
            && schema[most].as_u64().is_none_or(|most| length as u64 <= most)
    };
    if value.as_array().is_some_and(|items| !is_within(items.len(), "minItems", "maxItems"))
        || value.as_object().is_some_and(|members| !is_within(members.len(), "minProperties", "maxProperties"))
    {
        return wrong("length");
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
        None if schema["type"] == "object" => wrong(&format!("{key} is not described")),
        None => None,
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
        ("post", "/bus/faults", "/bus/faults", Some(json!({"lose": "220", "count": 1}))),
        ("post", "/bus/faults", "/bus/faults", Some(json!({"delay": "220", "ms": [5, 20], "probability": 0.5}))),
        ("post", "/bus/faults", "/bus/faults", Some(json!({"lose": "220", "count": 0}))),
        ("get", "/bus/faults", "/bus/faults", None),
        ("delete", "/bus/faults/{name}", "/bus/faults/lose-220", None),
        ("delete", "/bus/faults/{name}", "/bus/faults/lose-220", None),
        ("delete", "/bus/faults", "/bus/faults", None),
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
        ("get", "/cell", "/cell", None),
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
    // Every described call was made, except for the stream of events.
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

/// The possible status codes of each call.
#[test]
fn every_refusal_is_described() {
    let rig = Rig::stepped(&[]);
    let description = rig.get("/openapi.json");
    let paths = description["paths"].as_object().expect("paths");
    for (path, calls) in paths {
        for (method, call) in calls.as_object().expect("calls") {
            let described = call["responses"].as_object().expect("responses");
            let mut wanted = vec!["200", "400", "403", "405", "503"];
            if call["requestBody"].is_object() {
                wanted.extend(["408", "413", "415"]);
            }
            if path.contains("{name}") {
                wanted.push("404");
            }
            let missing: Vec<_> = wanted.into_iter().filter(|status| !described.contains_key(*status)).collect();
            assert!(missing.is_empty(), "{method} {path}: {missing:?}");
            assert!(described.values().all(|response| response["description"] != ""), "{method} {path}");
        }
    }
    let id = &description["paths"]["/bus/frames"]["delete"]["parameters"][0];
    assert_eq!((&id["name"], &id["schema"]["type"]), (&json!("id"), &json!("string")));
    assert_eq!(id["schema"]["pattern"], description["components"]["schemas"]["Identifier"]["anyOf"][1]["pattern"]);
    assert!(!description.to_string().contains("\"int32\""));
}

/// Returns the integers in a schema, except for choices of words, each with its path.
fn numbers<'a>(description: &'a Value, schema: &'a Value, path: &str) -> Vec<(String, &'a Value)> {
    let schema = resolved(description, schema);
    let members = schema["properties"].as_object();
    let choices = ["oneOf", "anyOf"].into_iter().filter_map(|several| schema[several].as_array()).flatten();
    let inner = members.into_iter().flatten().map(|(key, member)| (key.as_str(), member));
    let inner = inner.chain(choices.filter(|_| members.is_none()).map(|choice| ("", choice)));
    let is_number = schema["type"].to_string().contains("integer") && !schema["enum"].is_array();
    let own = is_number.then(|| (path.to_owned(), schema));
    own.into_iter()
        .chain(inner.flat_map(|(key, inner)| numbers(description, inner, &format!("{path}.{key}"))))
        .collect()
}

/// Input integers have limits; so have all identifiers and bit rates.
#[test]
fn numbers_have_limits() {
    let rig = Rig::stepped(&[]);
    let description = rig.get("/openapi.json");
    let calls = description["paths"].as_object().expect("paths").iter().flat_map(|(path, calls)| {
        calls.as_object().expect("calls").iter().map(move |(method, call)| (format!("{method} {path}"), call))
    });
    for (name, call) in calls {
        let parameters = call["parameters"].as_array().into_iter().flatten().map(|parameter| &parameter["schema"]);
        let body = call["requestBody"].get("content").map(|content| &content["application/json"]["schema"]);
        for (path, number) in parameters.chain(body).flat_map(|schema| numbers(&description, schema, &name)) {
            assert!(number["minimum"].is_number() && number["maximum"].is_number(), "{path}: {number}");
        }
    }
    let schemas = description["components"]["schemas"].as_object().expect("schemas");
    let members = |key: &'static str| schemas.values().filter_map(move |schema| schema["properties"].get(key));
    let ids: Vec<_> = members("id").flat_map(|id| numbers(&description, id, "id")).collect();
    for (_, id) in &ids {
        assert_eq!((&id["minimum"], &id["maximum"]), (&json!(0), &json!(0x1FFF_FFFF)), "{id}");
    }
    assert_eq!((ids.len(), members("bit_rate").count()), (5, 4));
    let rates: Vec<_> = members("bit_rate").flat_map(|rate| numbers(&description, rate, "bit_rate")).collect();
    assert_eq!(rates, []);
}

/// In JSON, 8000.0 and 8000 are the same number.
#[test]
fn a_whole_number_may_have_a_fraction() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    let (status, answer) = rig.call("PATCH", "/devices/valve/plant", Some(r#"{"supply_mv": 8000.0}"#));
    assert_eq!((status, &answer["plant"]["supply_mv"]), (200, &json!(8000)), "{answer}");
    let wanted = r#"{"device": "valve", "state": {"position": 0.0}, "within_ms": 0}"#;
    let (status, answer) = rig.call("POST", "/wait", Some(wanted));
    assert_eq!(status, 200, "{answer}");
}

/// The described limits are accepted, values beyond them refused, and null where the schema does not allow it.
#[test]
fn what_is_described_is_what_is_accepted() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve", "--device", "hat1000,bit-rate=250k,name=sensor"]);
    let description = rig.get("/openapi.json");
    let mut numbers = 0;
    type Body = fn(Value) -> Value;
    let bodies: [(&str, &str, &[&str], Body); 6] = [
        ("PlantChange", "/plant", &["valve", "sensor"], |change| match change["for_ms"].is_null() {
            true => change,
            false => extend(json!({"memory": "ok"}), change),
        }),
        ("StateCondition", "/wait", &["valve"], |state| json!({"device": "valve", "state": state, "within_ms": 0})),
        ("Disturb", "/bus/disturb", &[""], |change| extend(json!({"frames": 0}), change)),
        ("FrameToSend", "/bus/frames", &[""], |frame| extend(json!({"id": 1, "data": ""}), frame)),
        ("BusChange", "/bus", &[""], |change| change),
        ("Advance", "/time", &[""], |change| change),
    ];
    for (name, path, devices, body) in bodies {
        let schema = &description["components"]["schemas"][name];
        let is_state = name == "StateCondition";
        let is_accepted = |change: Value| {
            let body = body(change).to_string();
            devices.iter().any(|device| {
                let (method, path) = match path {
                    "/plant" => ("PATCH", format!("/devices/{device}/plant")),
                    "/bus" => ("PATCH", path.to_owned()),
                    _ => ("POST", path.to_owned()),
                };
                let (status, answer) = rig.call(method, &path, Some(&body));
                assert!(matches!(status, 200 | 400 | 408 | 409), "{body}: {status} {answer}");
                status != 400
            })
        };
        for (key, member) in schema["properties"].as_object().expect("members") {
            let described = |value: &Value| mismatch(&description, member, value, key).is_none();
            for value in
                [Value::Null, json!({}), json!([]), json!("qqq"), json!(""), json!(1.5), json!(-1), json!({"ok": null})]
            {
                // Any text is a possible name, and the device itself refuses an unknown fault.
                let is_text = value.is_string() && matches!(&**key, "name" | "kind" | "data" | "id");
                if is_text || key == "faults" {
                    continue;
                }
                let (accepted, described) = (is_accepted(json!({key: value})), described(&value));
                // A state is also refused if a device of its kind never has it.
                assert!(accepted == described || (is_state && !accepted), "{name}.{key}: {value}");
            }
            let limits = (member["minimum"].as_i64(), member["maximum"].as_i64());
            // Too long for a test.
            if let (Some(min), Some(max)) = limits
                && !matches!(&**key, "advance_ms" | "t_us")
            {
                numbers += 1;
                for (value, accepted) in [(min - 1, false), (min, true), (max, true), (max + 1, false)] {
                    let is_accepted = is_accepted(json!({key: value}));
                    assert!(is_accepted == accepted || (is_state && !is_accepted), "{name}.{key}: {value}");
                }
            }
        }
    }
    assert!(numbers >= 8, "{numbers}");
}

/// What depends on other members, or on the number of members or items.
#[test]
fn each_form_of_a_body_is_described() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    let description = rig.get("/openapi.json");
    let points = |points: Value| json!({"profile": {"word": "supply_mv", "points": points}});
    for (call, name, body, accepted) in [
        ("POST /wait", "Wait", json!({"device": "valve", "state": {}, "within_ms": 1}), true),
        ("POST /wait", "Wait", json!({"frame": {"id": 1}, "within_ms": 1}), true),
        ("POST /wait", "Wait", json!({"received": true, "within_ms": 1}), true),
        ("POST /wait", "Wait", json!({"received": false, "within_ms": 1}), false),
        ("POST /wait", "Wait", json!({"received": true, "device": "valve", "state": {}, "within_ms": 1}), false),
        ("POST /wait", "Wait", json!({"received": true, "frame": {"id": 1}, "within_ms": 1}), false),
        ("POST /wait", "Wait", json!({"device": "valve", "within_ms": 1}), false),
        ("POST /wait", "Wait", json!({"within_ms": 1}), false),
        ("POST /wait", "Wait", json!({"device": "valve", "state": {"position": {}}, "within_ms": 1}), false),
        ("POST /wait", "Wait", json!({"device": "valve", "state": {"led": {}}, "within_ms": 1}), false),
        ("PATCH /devices/valve/plant", "PlantChange", points(json!([[0, 24_000]])), true),
        ("PATCH /devices/valve/plant", "PlantChange", points(json!([])), false),
        ("PATCH /devices/valve/plant", "PlantChange", points(json!([[0]])), false),
        ("PATCH /devices/valve/plant", "PlantChange", points(json!([[0, 1, 2]])), false),
        ("PATCH /devices/valve/plant", "PlantChange", json!({"profile": {"word": "spool", "points": [[0, 1]]}}), false),
        ("POST /bus/faults", "CommunicationFault", json!({"lose": "220"}), true),
        ("POST /bus/faults", "CommunicationFault", json!({"count": 1}), false),
        ("POST /bus/faults", "CommunicationFault", json!({"lose": "220", "swap": "220"}), false),
    ] {
        let (method, path) = call.split_once(' ').expect("a call");
        let (status, answer) = rig.call(method, path, Some(&body.to_string()));
        assert_eq!(status != 400, accepted, "{body}: {answer}");
        let mismatch = mismatch(&description, &description["components"]["schemas"][name], &body, name);
        assert_eq!(mismatch.is_none(), accepted, "{body}: {mismatch:?}");
    }
}

/// Returns an object with the members of another one added.
fn extend(mut object: Value, other: Value) -> Value {
    let members = object.as_object_mut().expect("an object");
    members.extend(other.as_object().expect("an object").clone());
    object
}

/// Refusals name the member, in the words of the interface.
#[test]
fn refusals_name_the_member_and_what_is_accepted() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    for (method, path, body, words) in [
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"supply_mv": 8.5}"#,
            "supply_mv 8.5 is not valid; accepted: a whole number from 0 to 100000",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"supply_mv": null}"#,
            "supply_mv null is not valid; accepted: a whole number from 0 to 100000",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"temperature_c": 1001}"#,
            "temperature_c 1001 is not valid; accepted: a whole number from -273 to 1000",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"lever": "up"}"#,
            "lever \"up\" is not valid; accepted: a whole number from -16384 to 16384, or null",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"suply_mv": 1}"#,
            "unknown key 'suply_mv'; did you mean 'supply_mv'?; accepted: ",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"spool": "stuk"}"#,
            "spool: unknown value 'stuk'; did you mean 'stuck'?; accepted: ok, stuck, slow, drifting, no-float, or {\"fault\"}",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"spool": {"fault": 1}}"#,
            "spool.fault 1 is not valid; accepted: ok, stuck, slow, drifting, no-float, or null",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"memory": "gone"}"#,
            "memory: unknown value 'gone'; accepted: ok, write-fails, damaged",
        ),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"bus_off": "on"}"#,
            "bus_off \"on\" is not valid; accepted: true or false",
        ),
        ("PATCH", "/devices/valve/plant", "[]", "the body [] is not valid; accepted: an object"),
        ("PATCH", "/devices/valve/plant", r#"{"bus_off": true, "bus_off": true}"#, "duplicate member bus_off"),
        ("PATCH", "/devices/valve/plant", r#"{"supply_mv": 8000.0, "supply_mv": 9000}"#, "duplicate member supply_mv"),
        ("PATCH", "/devices/valve/plant", r#"{"spool": {"fault": "stuck", "fault": "ok"}}"#, "duplicate member fault"),
        (
            "PATCH",
            "/devices/valve/plant",
            r#"{"profile": {"word": "supply_mv", "points": [[0, 1]], "points": [[0, 2]]}}"#,
            "duplicate member points",
        ),
        ("POST", "/bus/frames", r#"{"id": 544.0, "id": 545, "data": "00"}"#, "duplicate member id"),
        ("POST", "/bus/faults", r#"{"lose": "123", "count": 1.0, "count": 7}"#, "duplicate member count"),
        (
            "POST",
            "/wait",
            r#"{"device": "valve", "state": {"position": {"min": 0, "min": 5}}, "within_ms": 0}"#,
            "duplicate member min",
        ),
        (
            "POST",
            "/wait",
            r#"{"received": true, "within_ms": 1, "x` at line": 1, "x` at line": 1}"#,
            "duplicate member x` at line",
        ),
        (
            "POST",
            "/wait",
            r#"{"device": "valve", "state": {"nmt": null, "nmt": "stopped"}, "within_ms": 0}"#,
            "duplicate member nmt",
        ),
        ("PATCH", "/bus", r#"{"bit_rate": 251000}"#, "bit_rate 251000 is not valid; accepted: "),
        (
            "POST",
            "/bus/frames",
            r#"{"data": ""}"#,
            "id is missing; accepted: a whole number from 0 to 536870911, or a hex string as in \"220\"",
        ),
        (
            "POST",
            "/bus/frames",
            r#"{"id": 1, "data": "", "every_ms": 0}"#,
            "every_ms 0 is not valid; accepted: a whole number from 1 to 4294967295",
        ),
        (
            "POST",
            "/bus/frames",
            r#"{"id": true, "data": ""}"#,
            "id true is not valid; accepted: a whole number from 0 to 536870911, or a hex string",
        ),
        (
            "POST",
            "/wait",
            r#"{"device": "valve", "state": {"led": {"color": "blue"}}, "within_ms": 1}"#,
            "state.led.color: unknown value 'blue'; accepted: green, yellow, red, off",
        ),
        (
            "POST",
            "/wait",
            r#"{"device": "valve", "state": {"position": {"min": 0.5}}, "within_ms": 1}"#,
            "state.position.min 0.5 is not valid; accepted: a whole number from -16384 to 16384",
        ),
        (
            "POST",
            "/wait",
            r#"{"device": "valve", "state": {"faults": [1]}, "within_ms": 1}"#,
            "state.faults[0] 1 is not valid; accepted: can-bus, controller, ",
        ),
        ("DELETE", "/bus/frames?id=22G", "", "id \"22G\" is not valid; accepted: 0 to 2047, or a hex string"),
        ("DELETE", "/bus/frames?extended=yes&id=1", "", "extended \"yes\" is not valid; accepted: true or false"),
        ("DELETE", "/bus/frames?id=1&id=2", "", "duplicate parameter id"),
        ("GET", "/trace?limit=-1", "", "limit \"-1\" is not valid; accepted: a whole number from 0 to 4294967295"),
        ("GET", "/trace?last=1", "", "unknown key 'last'; accepted: limit"),
    ] {
        let error = rig.refused(method, path, Some(body).filter(|body| !body.is_empty()), 400);
        assert!(error.contains(words), "{method} {path} {body}: {error}");
        for parser in ["u32", "i16", "expected", "invalid type", "struct", "variant", "untagged", "column"] {
            assert!(!error.contains(parser), "{error}");
        }
    }
}
