//! Waiting for states and frames.

use serde_json::{Value, json};

use super::{Rig, micros};

/// Returns a valve that follows a set-point of full stroke from the returned instant on.
fn moving() -> (Rig, u64) {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20,name=valve"]);
    rig.send("000: 01 00");
    for _ in 0..2 {
        rig.send("220: 0F 00 00 00");
    }
    rig.send("220: 0F 00 00 00");
    let since = rig.send("220: 0F 00 00 40");
    (rig, since)
}

#[test]
fn the_first_instant_is_exact() {
    let (rig, since) = moving();
    // 16384 in 250 ms: 4096 after 62.5 ms, to the microsecond.
    let state = rig.wait("valve", json!({"position": 4096}), 1000);
    assert_eq!(micros(&state["t_us"]), since + 62_500);
    let state = rig.wait("valve", json!({"position": {"min": 8192}}), 1000);
    assert_eq!((micros(&state["t_us"]), &state["position"]), (since + 125_000, &json!(8192)));
    // Now, if the state holds now.
    assert_eq!(rig.wait("valve", json!({"position": {"min": 0, "max": 8192}}), 0)["t_us"], state["t_us"]);
    assert_eq!(rig.wait("valve", json!({}), 0), rig.device("valve"));
    let state = rig.wait("valve", json!({"position": 16384, "set_point": 16384, "nmt": "operational"}), 1000);
    assert_eq!(micros(&state["t_us"]), since + 250_000);
}

#[test]
fn every_key_of_a_state_can_be_waited_for() {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20,name=valve", "--device", "hat1000@5,bit-rate=250k"]);
    for name in ["valve", "hat1000"] {
        let mut state = rig.device(name);
        let fields = state.as_object_mut().expect("an object");
        fields.remove("plant");
        fields["faults"] = json!([]);
        for (key, value) in fields.clone() {
            assert_eq!(rig.wait(name, json!({key.as_str(): value}), 0)["name"], name, "{key}");
        }
        assert_eq!(rig.wait(name, Value::Object(fields.clone()), 0), rig.device(name));
    }
    let state = rig.wait("valve", json!({"led": {"color": "yellow"}, "set_point": {"min": 0}}), 0);
    assert_eq!(micros(&rig.wait("valve", json!({"t_us": 12_345}), 100)["t_us"]), 12_345);
    for (key, other) in [
        ("t_us", json!(0)),
        ("node_id", json!(33)),
        ("node_id", json!(null)),
        ("bit_rate", json!(125000)),
        ("powered", json!(false)),
        ("nmt", json!("stopped")),
        ("dsm", json!("active")),
        ("dsm", json!(null)),
        ("set_point", json!("float")),
        ("set_point", json!(1)),
        ("set_point", json!({"min": 1})),
        ("set_point", json!(null)),
        ("position", json!(-1)),
        ("position", json!({"max": -1})),
        ("solenoids", json!(true)),
        ("led", json!({"color": "green"})),
        ("led", json!({"flashing": true})),
        ("faults", json!(["internal"])),
    ] {
        let body = json!({"device": "valve", "state": {key: other}, "within_ms": 1}).to_string();
        let (status, answer) = rig.call("POST", "/wait", Some(&body));
        assert_eq!(status, 408, "{body}: {answer}");
        assert_eq!((&answer["state"]["name"], answer["error"].is_string()), (&state["name"], true), "{answer}");
        assert_eq!(answer["t_us"], answer["state"]["t_us"]);
    }
}

#[test]
fn what_is_not_known_is_refused() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    for body in [
        r#"{"device": "valve", "state": {"nmt": "operational"}}"#,
        r#"{"device": "valve", "within_ms": 1}"#,
        r#"{"state": {}, "within_ms": 1}"#,
        r#"{"within_ms": 1}"#,
        r#"{"device": "valve", "state": {}, "frame": {"id": 1}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {}, "within_ms": 1, "until": 2}"#,
        r#"{"device": "valve", "state": {}, "within_ms": -1}"#,
        r#"{"device": "valve", "state": {"nmt": "operating"}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"state": "hold"}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"plant": {"supply_mv": 1}}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"position": {"from": 1}}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"position": "float"}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"led": {"colour": "red"}}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"led": {"color": "blue"}}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"faults": ["broken"]}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"faults": "internal"}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"solenoids": 1}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"position": {}}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"led": {}}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": [], "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"led": ["red"]}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"position": [0, 1]}, "within_ms": 1}"#,
        r#"{"device": "valve", "state": {"set_point": []}, "within_ms": 1}"#,
        r#"{"frame": [1], "within_ms": 1}"#,
        r#"{"frame": {"id": 2048}, "within_ms": 1}"#,
        r#"{"frame": {"data": "00"}, "within_ms": 1}"#,
        r#"{"frame": {"id": 1, "data": "0"}, "within_ms": 1}"#,
        r#"{"frame": {"id": 1, "from": "valve"}, "within_ms": 1}"#,
    ] {
        let error = rig.refused("POST", "/wait", Some(body), 400);
        assert!(!error.is_empty(), "{body}");
    }
    let body = r#"{"device": "other", "state": {}, "within_ms": 1}"#;
    rig.refused("POST", "/wait", Some(body), 404);
    assert_eq!(rig.get("/time"), json!({"now_us": 10_000, "speed": "step"}), "no time has passed");
}

/// Impossible states are refused, with the key and its possible values.
#[test]
fn a_state_that_can_never_be_is_refused() {
    let devices = ["pvea-canopen@0x20,name=valve", "pvea-isobus,name=tractor", "hat1000@5,bit-rate=250k,name=boom"];
    let arguments: Vec<&str> = devices.iter().flat_map(|device| ["--device", device]).collect();
    let rig = Rig::stepped(&arguments);
    for (name, state, error) in [
        ("valve", json!({"name": "other"}), "name is never \"other\" on valve; accepted: \"valve\""),
        ("valve", json!({"kind": "pvea-isobus"}), "accepted: \"pvea-canopen\""),
        ("valve", json!({"command": "blocked"}), "command is never \"blocked\" on valve; accepted: null"),
        ("valve", json!({"node_id": 200}), "node_id is never 200 on valve; accepted: 1 to 127, null"),
        ("valve", json!({"bit_rate": 800_000}), "accepted: 125000, 250000, 500000, null"),
        ("valve", json!({"position": null}), "accepted: -16384 to 16384"),
        ("valve", json!({"position": {"min": 100, "max": -100}}), "position: min 100 is above max -100"),
        ("valve", json!({"led": null}), "accepted: green constant, "),
        ("valve", json!({"powered": false, "nmt": "stopped"}), "nmt and powered never hold together"),
        ("tractor", json!({"dsm": "active"}), "dsm is never \"active\" on tractor; accepted: null"),
        ("tractor", json!({"node_id": 5}), "accepted: 128 to 143, null"),
        ("boom", json!({"set_point": 0}), "accepted: null"),
        ("boom", json!({"position": -1}), "accepted: 0 to 16383, null"),
    ] {
        let body = json!({"device": name, "state": state, "within_ms": 1}).to_string();
        let said = rig.refused("POST", "/wait", Some(&body), 400);
        assert!(said.contains(error), "{body}: {said}");
    }
}

#[test]
fn a_frame_by_its_identifier_and_its_data() {
    let rig = Rig::stepped(&["--device", "pvea-isobus@0x83,name=valve"]);
    let frame = rig
        .post("/wait", json!({"frame": {"id": 0x0CFE_1383, "extended": true, "data": "7d7D30.."}, "within_ms": 1000}));
    assert_eq!((&frame["from"], &frame["data"]), (&json!("valve"), &json!("7D7D30FFFFFFFFFF")));
    assert_eq!(rig.get("/time")["now_us"], frame["t_us"]);
    let (status, answer) = rig.call("POST", "/wait", Some(r#"{"frame": {"id": 1}, "within_ms": 50}"#));
    assert_eq!((status, &answer["state"]), (408, &Value::Null));
    assert_eq!(micros(&answer["t_us"]), micros(&frame["t_us"]) + 50_000);
    // Earlier frames do not count, nor frames with 11 bits or other data.
    for frame in [json!({"id": 0x383}), json!({"id": 0x0CFE_1383, "extended": true, "data": "7D7D31.."})] {
        assert_eq!(
            rig.call("POST", "/wait", Some(&json!({"frame": frame, "within_ms": 200}).to_string()).map(|x| x.as_str()))
                .0,
            408
        );
    }
}

/// A pattern has the same meaning as in a scenario: exact bytes, and `..` at the end for any further bytes.
#[test]
fn a_pattern_of_a_frame_is_exact() {
    let rig = Rig::stepped(&["--device", "pvea-isobus@0x83,name=valve"]);
    let wait = |frame: Value| {
        let (status, answer) = rig.call("POST", "/wait", Some(&json!({"frame": frame, "within_ms": 250}).to_string()));
        (status, answer["error"].as_str().unwrap_or_default().to_owned())
    };
    // AVEF, every 100 ms: 7D 7D 30 FF FF FF FF FF
    for data in
        ["7D7D30FFFFFFFFFF", "7d7D 30FF FFFF FFFF", "7D7D30..", "7D 7D 30 ..", "7D??30..", "7?7D30FFFFFFFFFF", ".."]
    {
        assert_eq!(wait(json!({"id": "0CFE1383", "data": data})), (200, String::new()), "{data}");
    }
    assert_eq!(wait(json!({"id": "0CFE1383"})).0, 200);
    for (data, why) in [
        (
            "7D7D30",
            "which differs only in its length: 8 bytes instead of 3 bytes; append \"..\" to accept further bytes",
        ),
        ("", "which differs only in its length: 8 bytes instead of 0 bytes"),
        ("7D7D31", "the last frame with its identifier was 0CFE1383: 7D 7D 30 FF FF FF FF FF"),
        ("7D7D31..", "the frame 0CFE1383: 7D 7D 31 .. was not received"),
    ] {
        let (status, error) = wait(json!({"id": "0CFE1383", "data": data}));
        assert!(status == 408 && error.contains(why), "{data}: {status} {error}");
        assert_eq!(error.contains("only in its length"), why.contains("only in its length"), "{error}");
    }
    let error = wait(json!({"id": "123", "data": "00"})).1;
    assert_eq!(error, "the frame 123: 00 was not received, nor any other frame with its identifier");
    // Of several frames, the last one: the released spool moves.
    rig.plant("valve", json!({"lever": 16384}));
    rig.plant("valve", json!({"lever": null}));
    let before = rig.trace().len();
    let error = wait(json!({"id": "0CFE1383", "data": "00"})).1;
    let trace = &rig.trace()[before..];
    let [(_, first, _), .., (_, last, _)] = trace else { panic!("{trace:?}") };
    assert!(first != last && last.starts_with("0CFE1383"), "{trace:?}");
    assert!(error.contains(&format!("the last frame with its identifier was {last}")), "{error}");
    for data in ["0", "0G", "00..00", "...", "R9", "000102030405060708"] {
        let body = json!({"frame": {"id": 1, "data": data}, "within_ms": 1}).to_string();
        let error = rig.refused("POST", "/wait", Some(&body), 400);
        assert!(
            error.starts_with(&format!("data \"{data}\": ")) && error.contains("accepted: up to 8 bytes"),
            "{error}"
        );
    }
}

#[test]
fn a_wait_that_is_over_says_what_differs() {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20,name=valve"]);
    let wanted = json!({"dsm": "active", "nmt": "pre-operational", "position": {"min": 8000}, "faults": ["internal"]});
    let body = json!({"device": "valve", "state": wanted, "within_ms": 1}).to_string();
    let (status, answer) = rig.call("POST", "/wait", Some(&body));
    assert_eq!(status, 408);
    assert_eq!(
        answer["error"],
        "the state was not reached: dsm is \"init\", not \"active\"; faults is [], not [\"internal\"]; \
         position is 0, not {\"min\":8000}"
    );
}

/// With stepped time each call advances its own time, one after the other; running time serves all at once.
#[test]
fn calls_that_let_time_pass_take_turns() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    let rig = &rig;
    let ends: Vec<u64> = std::thread::scope(|scope| {
        let never = json!({"device": "valve", "state": {"powered": false}, "within_ms": 100}).to_string();
        let waits: Vec<_> = (0..5)
            .map(|_| {
                let never = never.clone();
                scope.spawn(move || micros(&rig.call("POST", "/wait", Some(&never)).1["t_us"]))
            })
            .collect();
        waits.into_iter().map(|wait| wait.join().expect("an answer")).collect()
    });
    let mut sorted = ends;
    sorted.sort_unstable();
    assert_eq!(sorted, [110_000, 210_000, 310_000, 410_000, 510_000]);
}
