//! Communication faults: `/bus/faults`, and what clients receive.

use std::net::TcpStream;

use serde_json::{Value, json};

use super::Rig;
use crate::simulator::{READ_VENDOR, VENDOR, await_frame, frame, say};

/// The request of `READ_VENDOR`, and its answer, as other clients see them.
const REQUEST: &str = "620#4018100100000000";

/// Returns the name of each fault, the number of affected frames, and whether it is over.
fn names(records: &Value) -> Vec<(&str, u64, bool)> {
    let records = records.as_array().expect("a list").iter();
    let fields = records
        .map(|record| Some((record["name"].as_str()?, record["struck"].as_u64()?, record["is_over"].as_bool()?)));
    fields.collect::<Option<_>>().expect("records")
}

#[test]
fn a_fault_is_added_listed_and_ended() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=boom"]);
    assert_eq!(rig.get("/bus/faults"), json!([]));
    let added = rig.post("/bus/faults", json!({"lose": "220", "count": 2}));
    assert_eq!(added, json!({"name": "lose-220", "fault": "lose 220, count 2", "struck": 0, "is_over": false}));
    let second = rig.post("/bus/faults", json!({"lose": "220", "receivers": ["boom"]}));
    assert_eq!(second["name"], "lose-220-2");
    rig.post("/bus/faults", json!({"delay": "720", "ms": 5, "name": "late"}));
    rig.send("000: 01 20");
    for _ in 0..3 {
        rig.send("220: 0F 00 00 20");
    }
    let faults = rig.get("/bus/faults");
    assert_eq!(names(&faults), [("lose-220", 2, true), ("lose-220-2", 3, false), ("late", 0, false)]);
    assert_eq!(rig.device("boom")["dsm"], "init", "no set-point has reached it");
    let ended = rig.done("DELETE", "/bus/faults/lose-220-2", None);
    assert_eq!(names(&ended), [("lose-220-2", 3, false)]);
    assert_eq!(names(&rig.done("DELETE", "/bus/faults", None)), [("lose-220", 2, true), ("late", 0, false)]);
    assert_eq!(rig.get("/bus/faults"), json!([]));
    assert_eq!(rig.done("DELETE", "/bus/faults", None), json!([]));
    rig.send_every(20, "220: 0F 00 00 20");
    rig.wait("boom", json!({"dsm": "active"}), 1000);
}

#[test]
fn a_refused_fault_changes_nothing() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=boom"]);
    for (body, reason) in [
        (r#"{}"#, "a fault needs one of "),
        (r#"{"lose": "220", "sender": "bucket"}"#, "no device or client 'bucket'; known: boom"),
        (r#"{"lose": "220", "receivers": ["bucket"]}"#, "no device or client 'bucket'; known: boom"),
        (
            r#"{"lose": "220", "sender": "the gateway, listening"}"#,
            "no device or client 'the gateway, listening'; known: boom, the gateway, http",
        ),
        (r#"{"lose": ""}"#, "lose: id \"\" is not valid; "),
        (r#"{"lose": "220", "probability": 2}"#, "probability 2 is not valid; "),
        (r#"{"lose": "220", "lose": "221"}"#, "duplicate member lose"),
        (r#"{"insert": "220#00", "name": "boom"}"#, "the name of an insert fault must not be"),
        (r#"{"loss": "220"}"#, "unknown key 'loss'"),
    ] {
        let refused = rig.refused("POST", "/bus/faults", Some(body), 400);
        assert!(refused.starts_with(reason) && !refused.contains('\n'), "{body}: {refused}");
    }
    rig.post("/bus/faults", json!({"lose": "220", "name": "one"}));
    let twice = r#"{"lose": "221", "name": "one"}"#;
    assert_eq!(rig.refused("POST", "/bus/faults", Some(twice), 409), "a fault named 'one' is already active");
    for number in 1..64 {
        rig.post("/bus/faults", json!({"lose": number}));
    }
    let another = rig.refused("POST", "/bus/faults", Some(r#"{"lose": "all"}"#), 409);
    assert_eq!(another, "64 faults are active: end one first");
    assert_eq!(rig.refused("DELETE", "/bus/faults/two", None, 404).split(';').next(), Some("no fault 'two'"));
    assert_eq!(rig.get("/bus/faults").as_array().map(Vec::len), Some(64));
}

/// A frame that a fault holds back does not hold back the other frames of its client.
#[test]
fn clients_go_on_while_a_frame_is_held_back() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=boom"]);
    rig.post("/bus/faults", json!({"delay": "123", "ms": 3000}));
    rig.post("/bus/faults", json!({"swap": "124", "count": 1}));
    let sent = rig.send("123: 01");
    assert_eq!(sent, 10_000, "it is answered at once");
    rig.send("124: 01");
    rig.send("125: 01");
    rig.advance(4000);
    let from = |rig: &Rig, name: &str| -> Vec<String> {
        let frames = rig.trace().into_iter().filter(|(.., from)| from == name);
        frames.map(|(_, frame, _)| frame).collect()
    };
    assert_eq!(from(&rig, "http"), ["125: 01", "124: 01", "123: 01"]);
    let mut client = rig.simulator.join();
    rig.post("/bus/faults", json!({"swap": "126", "sender": "the gateway", "count": 1}));
    say(&mut client, "< send 126 1 1 >");
    say(&mut client, "< send 127 1 1 >");
    while from(&rig, "the gateway").len() < 2 {
        rig.advance(1);
    }
    assert_eq!(from(&rig, "the gateway"), ["127: 01", "126: 01"]);
}

/// Clients of gateways are receivers, too: together they are "the gateway".
#[test]
fn clients_lose_frames() {
    let rig = Rig::start(&["--device", "pvea-canopen,name=boom"]);
    let (mut one, mut other) = (rig.simulator.join(), rig.simulator.join());
    read_before(&mut one, &mut [&mut other]);
    rig.post("/bus/faults", json!({"lose": "5A0", "receivers": ["the gateway"], "count": 1}));
    say(&mut one, READ_VENDOR);
    wait_for_a_strike(&rig);
    say(&mut one, READ_VENDOR);
    assert_eq!(frame(&mut one), VENDOR, "the second one");
    assert_eq!([(); 3].map(|()| frame(&mut other)), [REQUEST, REQUEST, VENDOR]);
}

/// Receivers that accept a frame with an error in its last but one bit get it twice.
#[test]
fn clients_get_a_frame_twice_that_others_omit() {
    let rig = Rig::start(&["--device", "pvea-canopen,name=boom", "--device", "hat1000,bit-rate=250k,name=angle"]);
    let mut client = rig.simulator.join();
    read_before(&mut client, &mut []);
    rig.post("/bus/faults", json!({"omit": "5A0", "receivers": ["angle"], "count": 1}));
    say(&mut client, READ_VENDOR);
    assert_eq!([(); 2].map(|()| frame(&mut client)), [VENDOR, VENDOR]);
    rig.done("DELETE", "/bus/faults", None);
    rig.post("/bus/faults", json!({"omit": "5A0", "receivers": ["the gateway"], "count": 1}));
    say(&mut client, READ_VENDOR);
    wait_for_a_strike(&rig);
    rig.send("7F0: 01");
    assert_eq!([(); 2].map(|()| frame(&mut client)), [VENDOR, "7F0#01"]);
}

/// Reads once, so that no frame of the start is left for these clients.
fn read_before(client: &mut TcpStream, others: &mut [&mut TcpStream]) {
    say(client, READ_VENDOR);
    await_frame(client, VENDOR);
    others.iter_mut().for_each(|other| await_frame(other, VENDOR));
}

/// Waits until the first fault has affected a frame.
fn wait_for_a_strike(rig: &Rig) {
    while names(&rig.get("/bus/faults"))[0].1 == 0 {}
}

/// What a fault did stands in the trace and in a log whose format has comments.
#[test]
fn faults_are_traced_and_logged() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("faults.asc");
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=boom", "--log", log.to_str().expect("text")]);
    rig.post("/bus/faults", json!({"lose": "220", "count": 1}));
    rig.send("220: 0F 00 00 20");
    let told = "fault lose-220: 220: 0F 00 00 20 of http lost for all receivers";
    let trace = rig.get("/trace");
    assert!(trace.as_array().expect("a list").iter().any(|entry| entry["meaning"] == told), "{trace}");
    let (stdout, _) = rig.simulator.end(rustix::process::Signal::TERM);
    assert!(stdout.lines().any(|line| line.starts_with("# (") && line.ends_with(told)), "{stdout}");
    let log = std::fs::read_to_string(log).expect("a log");
    assert!(log.lines().any(|line| line.starts_with("// ") && line.ends_with(told)), "{log}");
}
