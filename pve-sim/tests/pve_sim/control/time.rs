//! Virtual time: running and stepped.

use serde_json::json;

use super::{Rig, micros};
use crate::simulator::{expect, say};

#[test]
fn time_passes_by_itself_or_when_it_is_told() {
    let rig = Rig::start(&["--speed", "step"]);
    for _ in 0..3 {
        assert_eq!(rig.get("/time"), json!({"now_us": 0, "speed": "step"}));
    }
    assert_eq!(rig.advance(1), 1_000);
    assert_eq!(rig.advance(0), 1_000);
    assert_eq!(rig.advance(3_600_000), 3_600_001_000);
    for body in [
        r#"{}"#,
        r#"{"advance_ms": -1}"#,
        r#"{"advance_ms": 0.5}"#,
        r#"{"advance_ms": 4294967296}"#,
        r#"{"now_us": 1}"#,
    ] {
        rig.refused("POST", "/time", Some(body), 400);
    }
    assert_eq!(rig.get("/time"), json!({"now_us": 3_600_001_000_u64, "speed": "step"}));

    let rig = Rig::start(&["--speed", "1000"]);
    assert_eq!(rig.get("/time")["speed"], 1000.0);
    let error = rig.refused("POST", "/time", Some(r#"{"advance_ms": 1}"#), 409);
    assert!(error.contains("--speed step"), "{error}");
    let never = r#"{"device": "pvea-canopen", "state": {"powered": false}, "within_ms": 10000}"#;
    let (status, answer) = rig.call("POST", "/wait", Some(never));
    assert_eq!(status, 408);
    assert!(micros(&answer["t_us"]) >= 10_000_000, "{answer}");
    assert!(micros(&rig.get("/time")["now_us"]) >= micros(&answer["t_us"]));
}

/// The interval of reported positions grows with the speed, up to a limit.
#[test]
fn the_largest_speeds_are_served() {
    for speed in ["1e15", "1e300"] {
        let rig = Rig::start(&["--speed", speed]);
        assert_eq!(rig.get("/time")["speed"], speed.parse::<f64>().expect("a number"));
    }
}

/// The echo confirms the frame; the bus takes virtual time, which does not advance.
#[test]
fn what_clients_send_waits_for_the_next_advance() {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20"]);
    let mut client = rig.simulator.join();
    say(&mut client, "< send 620 8 40 18 10 1 0 0 0 0 >< echo >");
    expect(&mut client, "< echo >");
    let frames = rig.trace().len();
    assert_eq!(rig.get("/time"), json!({"now_us": 10_000, "speed": "step"}));
    assert_eq!(rig.trace().len(), frames);
    rig.advance(1);
    assert_eq!(crate::simulator::frame(&mut client), "5A0#4318100119000001");
    assert_eq!(rig.trace().len(), frames + 2);
}
