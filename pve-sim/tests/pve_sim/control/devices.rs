//! States, plant and power.

use serde_json::{Value, json};

use super::Rig;

const DEVICES: &[&str] = &[
    "--device",
    "pvea-canopen@0x20,name=boom",
    "--device",
    "pveo-isobus@0x83,name=arm",
    "--device",
    "hat1000@5,name=angle,bit-rate=250k",
];

/// Returns the faults of a device, without any occurrence.
fn faults(names: &[&str]) -> Value {
    names.iter().map(|name| json!({"fault": name, "active": false, "count": 0})).collect()
}

const VALVE_FAULTS: [&str; 8] = [
    "spool-not-at-set-point",
    "float-not-reached",
    "internal",
    "can-bus",
    "temperature",
    "supply-high",
    "supply-low",
    "time-guarding",
];

#[test]
fn a_state_tells_everything() {
    let rig = Rig::stepped(DEVICES);
    let valve_plant = json!({
        "supply_mv": 24000, "temperature_c": 25, "spool": {"fault": null}, "lever": null,
        "internal_fault": false, "memory": "ok", "bus_off": false,
        "brown_out_mv": null, "oil": false, "boot_ms": 0, "answer_ms": 0, "cycle_ms": 0
    });
    let boom = json!({
        "t_us": 10000, "name": "boom", "kind": "pvea-canopen", "node_id": 32, "bit_rate": 250000, "powered": true,
        "nmt": "pre-operational", "dsm": "init", "command": null, "set_point": 0, "position": 0, "solenoids": false,
        "led": {"color": "yellow", "flashing": false}, "faults": faults(&VALVE_FAULTS), "plant": valve_plant
    });
    let arm = json!({
        "t_us": 10000, "name": "arm", "kind": "pveo-isobus", "node_id": 0x83, "bit_rate": 250000, "powered": true,
        "nmt": null, "dsm": null, "command": "blocked", "set_point": 0, "position": 0, "solenoids": true,
        "led": {"color": "green", "flashing": false}, "faults": faults(&VALVE_FAULTS), "plant": valve_plant
    });
    let angle = json!({
        "t_us": 10000, "name": "angle", "kind": "hat1000", "node_id": 5, "bit_rate": 250000, "powered": true,
        "nmt": "pre-operational", "dsm": null, "command": null, "set_point": null, "position": 0, "solenoids": null,
        "led": null, "faults": faults(&["set-up", "controller", "error-passive", "can-bus"]),
        "plant": {
            "angle_cdeg": 0, "speed_rpm": 0, "measuring_error": false,
            "internal_fault": false, "memory": "ok", "bus_off": false, "boot_ms": 0, "answer_ms": 0, "cycle_ms": 0
        }
    });
    for (name, state) in [("boom", &boom), ("arm", &arm), ("angle", &angle)] {
        assert_eq!(rig.device(name), *state);
    }
    assert_eq!(rig.get("/devices"), json!([boom, arm, angle]));
}

#[test]
fn without_power_there_is_nothing_to_tell() {
    let rig = Rig::stepped(DEVICES);
    let boom = rig.power("boom", json!({"on": false}));
    let expected = json!({
        "powered": false, "node_id": null, "bit_rate": null, "nmt": null, "dsm": null, "command": null, "set_point": null,
        "position": 0, "solenoids": false, "led": {"color": "off", "flashing": false}
    });
    for (key, value) in expected.as_object().expect("an object") {
        assert_eq!(boom[key], *value, "{key}");
    }
    let angle = rig.power("angle", json!({"on": false}));
    assert_eq!((&angle["position"], &angle["powered"], &angle["led"]), (&Value::Null, &json!(false), &Value::Null));
    // No frame is sent, and the power returns at this instant.
    let sent = rig.trace().len();
    rig.advance(1000);
    assert!(rig.trace()[sent..].iter().all(|(_, _, from)| from == "arm"));
    assert_eq!(rig.power("boom", json!({"on": true}))["nmt"], "pre-operational");
    let frame = rig.post("/wait", json!({"frame": {"id": 0x720, "data": "00"}, "within_ms": 10}));
    assert_eq!(frame["from"], "boom");
    assert_eq!(rig.power("boom", json!({"on": true}))["powered"], true, "one that is on stays so");
}

#[test]
fn each_part_of_the_plant_alone_and_together() {
    let rig = Rig::stepped(DEVICES);
    for (device, changes) in [
        (
            "boom",
            &[
                json!({"supply_mv": 8000}),
                json!({"temperature_c": -41}),
                json!({"spool": {"fault": "stuck"}}),
                json!({"spool": {"fault": "slow"}}),
                json!({"spool": {"fault": "drifting"}}),
                json!({"spool": {"fault": "no-float"}}),
                json!({"spool": {"fault": null}}),
                json!({"lever": -16384}),
                json!({"lever": null}),
                json!({"internal_fault": true}),
                json!({"memory": "write-fails"}),
                json!({"memory": "damaged"}),
                json!({"memory": "ok"}),
                json!({"bus_off": true}),
                json!({"supply_mv": 24000, "temperature_c": 25, "lever": 16384, "internal_fault": false, "bus_off": false}),
                json!({"brown_out_mv": 7000, "oil": true}),
                json!({"brown_out_mv": null}),
                json!({"boot_ms": 60000, "answer_ms": [5, 20], "cycle_ms": 1000}),
                json!({"answer_ms": 60000, "cycle_ms": 0}),
                json!({}),
            ][..],
        ),
        (
            "angle",
            &[
                json!({"angle_cdeg": 35999}),
                json!({"measuring_error": true}),
                json!({"internal_fault": true}),
                json!({"memory": "write-fails"}),
                json!({"bus_off": true}),
                json!({"boot_ms": 300, "answer_ms": 0, "cycle_ms": 10}),
                json!({"cycle_ms": 0}),
                json!({"speed_rpm": -60, "angle_cdeg": 100}),
            ],
        ),
    ] {
        for change in changes {
            let before = rig.device(device)["plant"].clone();
            let state = rig.plant(device, change.clone());
            let mut expected = before;
            for (key, value) in change.as_object().expect("an object") {
                expected[key] = value.clone();
            }
            assert_eq!(state["plant"], expected, "{change}");
            assert_eq!(rig.device(device), state);
        }
    }
    // The shaft turns once a second, backwards, from 1 degree.
    rig.advance(250);
    assert_eq!(rig.device("angle")["plant"]["angle_cdeg"], 36_000 - 9_000 + 100);
}

#[test]
fn what_cannot_be_changes_nothing() {
    let rig = Rig::stepped(&[DEVICES, &["--link", "boom=angle"]].concat());
    let before = rig.get("/devices");
    for (device, change, words) in [
        ("boom", r#"{"supply_mv": 8000, "supply": 1}"#, "unknown key 'supply'; did you mean 'supply_mv'?"),
        ("boom", r#"{"supply_mv": 8000, "angle_cdeg": 1}"#, "angle_cdeg 1: not a plant word of this kind"),
        (
            "boom",
            r#"{"supply_mv": 8000, "lever": 16385}"#,
            "lever 16385 is not valid; accepted: a whole number from -16384 to 16384, or null",
        ),
        ("boom", r#"{"supply_mv": 8000, "temperature_c": 40000}"#, "temperature_c 40000 is not valid; accepted: "),
        ("boom", r#"{"temperature_c": 30, "supply_mv": -1}"#, "supply_mv -1 is not valid; accepted: "),
        (
            "boom",
            r#"{"temperature_c": 30, "supply_mv": 100001}"#,
            "supply_mv 100001 is not valid; accepted: a whole number from 0 to 100000",
        ),
        (
            "boom",
            r#"{"supply_mv": 8000, "temperature_c": -274}"#,
            "temperature_c -274 is not valid; accepted: a whole number from -273 to 1000",
        ),
        ("boom", r#"{"supply_mv": null}"#, "supply_mv null is not valid; accepted: "),
        ("boom", r#"{"supply_mv": 8000.5}"#, "supply_mv 8000.5 is not valid; accepted: "),
        (
            "boom",
            r#"{"supply_mv": 8000, "spool": {"fault": "bent"}}"#,
            "spool.fault: unknown value 'bent'; accepted: ok, stuck, slow, drifting, no-float, or null",
        ),
        (
            "boom",
            r#"{"supply_mv": 8000, "spool": {}}"#,
            "spool: fault is missing; accepted: ok, stuck, slow, drifting, no-float, or null",
        ),
        ("boom", r#"{"supply_mv": 8000, "spool": {"fault": null, "x": 1}}"#, "spool: unknown key 'x'; accepted: fault"),
        (
            "boom",
            r#"{"supply_mv": 8000, "spool": ["stuck"]}"#,
            "spool [\"stuck\"] is not valid; accepted: ok, stuck, slow, drifting, no-float, or {\"fault\"}",
        ),
        (
            "boom",
            r#"{"supply_mv": 8000, "memory": "gone"}"#,
            "memory: unknown value 'gone'; accepted: ok, write-fails, damaged",
        ),
        ("boom", r#"{"supply_mv": 8000, "supply_mv": 9000}"#, "duplicate member supply_mv"),
        ("boom", r#"{"supply_mv": 8000, "bus_off": 1}"#, "bus_off 1 is not valid; accepted: true or false"),
        ("boom", r#"{"boot_ms": 60001}"#, "boot_ms 60001 is not valid; accepted: a whole number from 0 to 60000"),
        ("boom", r#"{"cycle_ms": -1}"#, "cycle_ms -1 is not valid; accepted: a whole number from 0 to 1000"),
        (
            "boom",
            r#"{"answer_ms": 60001}"#,
            "answer_ms 60001 is not valid; accepted: a whole number from 0 to 60000, or a list of 2 items",
        ),
        (
            "boom",
            r#"{"answer_ms": [20, 5]}"#,
            "answer_ms 20..5: out of range; accepted: 0 to 60000 ms, or a range as in 5..20",
        ),
        (
            "boom",
            r#"{"answer_ms": [1, 2, 3]}"#,
            "is not valid; accepted: a whole number from 0 to 60000, or a list of 2 items",
        ),
        (
            "boom",
            r#"{"answer_ms": [1, 70000]}"#,
            "is not valid; accepted: a whole number from 0 to 60000, or a list of 2 items",
        ),
        (
            "boom",
            r#"{"brown_out_mv": 0}"#,
            "brown_out_mv 0 is not valid; accepted: a whole number from 1 to 100000, or null",
        ),
        ("boom", r#"{"oil": "cold"}"#, "oil \"cold\" is not valid; accepted: true or false"),
        ("angle", r#"{"oil": true}"#, "oil on: not a plant word of this kind of device"),
        ("boom", "[]", "the body [] is not valid; accepted: an object"),
        ("boom", "", "EOF"),
        ("boom", r#"{"supply_mv": 8000}{}"#, "trailing"),
        ("angle", r#"{"measuring_error": true, "supply_mv": 8000}"#, "supply_mv 8000: not a plant word of this kind"),
        (
            "angle",
            r#"{"measuring_error": true, "angle_cdeg": 36000}"#,
            "angle_cdeg 36000 is not valid; accepted: a whole number from 0 to 35999",
        ),
        ("angle", r#"{"measuring_error": true, "speed_rpm": 1}"#, "linked to a valve"),
        ("angle", r#"{"measuring_error": true, "lever": null}"#, "not a plant word of this kind"),
    ] {
        let error = rig.refused("PATCH", &format!("/devices/{device}/plant"), Some(change), 400);
        assert!(error.contains(words) && !error.contains('\n'), "{change}: {error}");
        assert_eq!(rig.get("/devices"), before, "{change}");
    }
    // A linked shaft has no speed of its own, and can be turned manually.
    assert_eq!(rig.plant("angle", json!({"speed_rpm": 0, "angle_cdeg": 4500}))["plant"]["angle_cdeg"], 4500);
    for path in ["/devices/other", "/devices/other/plant", "/devices/other/power"] {
        let (method, body) = match path.rsplit('/').next() {
            Some("plant") => ("PATCH", Some("{}")),
            Some("power") => ("POST", Some(r#"{"on": false}"#)),
            _ => ("GET", None),
        };
        let error = rig.refused(method, path, body, 404);
        assert_eq!(error, "no device 'other'; accepted: boom, arm, angle");
    }
    for body in
        [r#"{}"#, r#"{"on": true, "reset": "watchdog"}"#, r#"{"on": null}"#, r#"{"reset": "button"}"#, r#"{"off": 1}"#]
    {
        rig.refused("POST", "/devices/boom/power", Some(body), 400);
    }
    rig.power("boom", json!({"on": false}));
    let error = rig.refused("POST", "/devices/boom/power", Some(r#"{"reset": "watchdog"}"#), 409);
    assert!(error.contains("no power"), "{error}");
}

/// A word alone and an object mean the same, and `ok` is the word for healthy.
#[test]
fn the_spool_is_changed_by_a_word_or_an_object() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    for (change, fault) in [
        (json!("stuck"), json!("stuck")),
        (json!("ok"), json!(null)),
        (json!({"fault": "no-float"}), json!("no-float")),
        (json!({"fault": "ok"}), json!(null)),
        (json!({"fault": "slow"}), json!("slow")),
        (json!({"fault": null}), json!(null)),
    ] {
        rig.plant("valve", json!({"spool": change}));
        assert_eq!(rig.device("valve")["plant"]["spool"], json!({"fault": fault}), "{change}");
    }
}
