//! The bus: bit rate, load, disturbances, and frames of clients.

use rustix::process::Signal;
use serde_json::{Value, json};

use super::{Rig, micros};

#[test]
fn its_state_and_what_is_no_change_of_it() {
    let rig = Rig::stepped(&[]);
    let bus = rig.get("/bus");
    let disturb = json!({"frames": 0, "id": null, "extended": false});
    assert_eq!(
        bus,
        json!({"t_us": 10000, "bit_rate": 250000, "load": bus["load"], "disturb": disturb, "not_heard": []})
    );
    for body in [r#"{}"#, r#"{"bit_rate": 300000}"#, r#"{"bit_rate": 0}"#, r#"{"bit_rate": "250k"}"#, r#"{"load": 1}"#]
    {
        rig.refused("PATCH", "/bus", Some(body), 400);
    }
    for body in [
        r#"{}"#,
        r#"{"frames": -1}"#,
        r#"{"frames": 1, "id": 2048}"#,
        r#"{"frames": 1, "id": 536870912, "extended": true}"#,
        r#"{"frames": 1, "extended": true}"#,
        r#"{"frames": 1, "every": 1}"#,
    ] {
        rig.refused("POST", "/bus/disturb", Some(body), 400);
    }
    assert_eq!(rig.get("/bus"), bus);
    rig.send_every(1, "7FF: 00 00 00 00 00 00 00 00");
    rig.advance(2000);
    let load = rig.get("/bus")["load"].as_u64();
    assert!(load.is_some_and(|load| (45..65).contains(&load)), "{load:?}");
}

/// Reported from the start, before any device has power; and a second after a change, even if that is undone.
#[test]
fn who_is_not_heard_is_told_with_the_remedy() {
    let sensor = "hat1000 runs at 500 kbit/s and the bus at 250 kbit/s: it cannot communicate and will disturb the bus; \
                  use hat1000,bit-rate=250k, or a bus at 500k";
    let valve = "pvea-canopen runs at 250 kbit/s and the bus at 500 kbit/s: it cannot communicate and will disturb the \
                 bus; use pvea-canopen,bit-rate=500k, or a bus at 250k";
    let told = |device: &str, t_us: u64, is_over: bool, reason: &str| json!({"device": device, "t_us": t_us, "is_over": is_over, "reason": reason});
    let rig = Rig::stepped(&["--device", "pvea-canopen", "--device", "hat1000,bit-rate=500k"]);
    assert_eq!(rig.get("/bus")["not_heard"], json!([told("hat1000", 0, false, sensor)]));
    // The error frames of the sensor's boot-up are in the trace.
    let trace = rig.get("/trace");
    let errors = trace.as_array().expect("a list").iter().filter(|entry| entry.get("id").is_none());
    let meanings: Vec<&str> = errors.filter_map(|error| error["meaning"].as_str()).collect();
    assert!(meanings.iter().any(|meaning| meaning.starts_with("error frame: ")), "{trace}");
    assert!(meanings.iter().any(|meaning| meaning.starts_with("hat1000: error-passive")), "{trace}");
    let change = |rate: u32| rig.done("PATCH", "/bus", Some(json!({"bit_rate": rate})))["not_heard"].clone();
    assert_eq!(change(500_000), json!([told("pvea-canopen", 10_000, false, valve), told("hat1000", 0, true, sensor)]));
    rig.advance(999);
    assert_eq!(change(250_000)[0]["device"], "hat1000", "the valve was away for less than a second");
    change(500_000);
    rig.advance(1001);
    let both = change(250_000);
    assert_eq!(both[0], told("pvea-canopen", 1_009_000, true, valve));
    assert_eq!((&both[1]["is_over"], &both[1]["t_us"]), (&json!(false), &json!(2_010_000)));
    // The terminal shows the same reports, once each.
    let (_, said) = rig.simulator.end(Signal::TERM);
    for reason in [sensor, valve] {
        assert_eq!(said.matches(&format!("pve-sim: {reason}\n")).count(), 1, "{reason}: {said}");
    }
}

/// Use case 5 of the manual, live: the master changes the rate of the valve, then its own.
#[test]
fn the_master_changes_the_bit_rate() {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20,name=valve"]);
    let stored = json!({"frame": {"id": 0x7E4, "data": "17000000 .."}, "within_ms": 100});
    rig.send("000: 02 00");
    rig.send("7E5: 04 01 00 00 00 00 00 00");
    rig.send("7E5: 13 00 02 00 00 00 00 00");
    rig.post("/wait", json!({"frame": {"id": 0x7E4, "data": "13000000 .."}, "within_ms": 100}));
    rig.send("7E5: 15 00 00 00 00 00 00 00");
    rig.wait("valve", json!({"bit_rate": 500000}), 10);
    assert_eq!(rig.done("PATCH", "/bus", Some(json!({"bit_rate": 500000})))["bit_rate"], 500000);
    rig.advance(10);
    rig.send("7E5: 17 00 00 00 00 00 00 00");
    rig.post("/wait", stored);
    rig.power("valve", json!({"on": false}));
    rig.power("valve", json!({"on": true}));
    rig.post("/wait", json!({"frame": {"id": 0x720, "data": "00"}, "within_ms": 100}));
    let asked = rig.send("620: 40 18 10 01 00 00 00 00");
    let answer = rig.post("/wait", json!({"frame": {"id": 0x5A0}, "within_ms": 100}));
    assert_eq!(answer["data"], "4318100119000001");
    // 108 bits without stuff bits, and up to 3 bits of a pause, at 2 µs
    assert!(micros(&answer["t_us"]) - asked < 270, "{answer}");
}

#[test]
fn a_disturbance_destroys_so_many_attempts_of_an_identifier() {
    let rig = Rig::stepped(&[]);
    let alone = rig.send("123: 11 22") - 10_000;
    let bus = rig.post("/bus/disturb", json!({"frames": 5, "id": 0x123}));
    assert_eq!(bus["disturb"], json!({"frames": 5, "id": 0x123, "extended": false}));
    let before = micros(&rig.get("/time")["now_us"]);
    rig.send("124: 11 22");
    assert_eq!(rig.get("/bus")["disturb"]["frames"], 5, "another identifier");
    let late = rig.send("123: 11 22") - before;
    assert!(late > 2 * alone, "{late}");
    assert_eq!(rig.get("/bus")["disturb"], json!({"frames": 0, "id": null, "extended": false}));
    // It is replaced, and ended.
    rig.post("/bus/disturb", json!({"frames": 1000}));
    let bus = rig.post("/bus/disturb", json!({"frames": 1, "id": 0x123, "extended": true}));
    assert_eq!(bus["disturb"], json!({"frames": 1, "id": 0x123, "extended": true}));
    rig.send("123: 11 22");
    assert_eq!(rig.get("/bus")["disturb"]["frames"], 1, "it has 29 bits");
    rig.post("/bus/disturb", json!({"frames": 0}));
    assert_eq!(rig.get("/bus")["disturb"]["frames"], 0);
}

#[test]
fn a_frame_is_sent_once_and_answered_with_its_end() {
    let rig = Rig::stepped(&[]);
    let end = rig.send("00000123: DE AD");
    let trace = rig.trace();
    assert_eq!(trace.last(), Some(&(end, "00000123: DE AD".to_owned(), "http".to_owned())));
    // 54 bits and two bytes, with stuff bits, from 10 ms on
    assert!((10_270..10_400).contains(&end), "{end}");
    rig.send("7FF: ");
    assert_eq!(rig.trace().last().expect("a frame").1, "7FF: ");
    for body in [
        r#"{"data": ""}"#,
        r#"{"id": 1}"#,
        r#"{"id": 2048, "data": ""}"#,
        r#"{"id": 536870912, "extended": true, "data": ""}"#,
        r#"{"id": -1, "data": ""}"#,
        r#"{"id": 1, "data": "0"}"#,
        r#"{"id": 1, "data": "0G"}"#,
        r#"{"id": 1, "data": "000102030405060708"}"#,
        r#"{"id": "22G", "data": "00"}"#,
        r#"{"id": "220", "data": "00 .."}"#,
        r#"{"id": "220", "data": "0?"}"#,
        r#"{"id": 1, "data": "00", "every_ms": 0}"#,
        r#"{"id": 1, "data": "00", "every": 1}"#,
    ] {
        rig.refused("POST", "/bus/frames", Some(body), 400);
    }
    assert_eq!(rig.trace().len(), trace.len() + 1);
}

/// A text is hexadecimal wherever an identifier is given, and one of eight digits has 29 bits.
#[test]
fn an_identifier_is_a_number_or_a_text_in_hex() {
    let rig = Rig::stepped(&[]);
    for (id, frame) in [
        (json!(0x220), "220: 0F 00 00 20"),
        (json!("220"), "220: 0F 00 00 20"),
        (json!("0x220"), "220: 0F 00 00 20"),
        (json!("00000220"), "00000220: 0F 00 00 20"),
        (json!("0x0CFE3027"), "0CFE3027: 0F 00 00 20"),
    ] {
        rig.post("/bus/frames", json!({"id": id, "data": "0F00 0020", "every_ms": 100}));
        assert_eq!(rig.trace().last().expect("a frame").1, frame);
        rig.post("/bus/disturb", json!({"frames": 1, "id": id}));
        let disturbed = &rig.get("/bus")["disturb"];
        assert_eq!(disturbed["extended"], frame.len() > 16, "{disturbed}");
        rig.advance(250);
        assert_eq!(rig.get("/bus")["disturb"]["frames"], 0, "{frame}");
        let stop = id.as_str().map_or_else(|| format!("{:X}", 0x220), str::to_owned);
        assert_eq!(rig.done("DELETE", &format!("/bus/frames?id={stop}"), None), json!({"stopped": 1}), "{stop}");
    }
    rig.post("/bus/frames", json!({"id": "CFE3027", "extended": true, "data": ""}));
    rig.post("/bus/frames", json!({"id": "7E5", "data": "R1"}));
    for id in ["", "0x", "800", "22G", "20000000", "000000220"] {
        let error = rig.refused("POST", "/bus/frames", Some(&json!({"id": id, "data": ""}).to_string()), 400);
        assert!(error.starts_with(&format!("id \"{id}\" is not valid; accepted: ")), "{error}");
    }
}

#[test]
fn a_frame_that_the_bus_does_not_take_is_withdrawn() {
    let rig = Rig::stepped(&[]);
    let body = r#"{"id": 291, "data": "11"}"#;
    rig.post("/bus/disturb", json!({"frames": 1_000_000, "id": 291}));
    let error = rig.refused("POST", "/bus/frames", Some(body), 409);
    assert!(error.contains("withdrawn"), "{error}");
    assert_eq!(micros(&rig.get("/time")["now_us"]), 1_010_000, "1 s has passed");
    rig.post("/bus/disturb", json!({"frames": 0}));
    rig.advance(1000);
    assert!(rig.trace().iter().all(|(_, _, from)| from != "http"));
    // A cyclic frame that never gets onto the bus is dropped.
    rig.post("/bus/disturb", json!({"frames": 1_000_000, "id": 291}));
    rig.refused("POST", "/bus/frames", Some(r#"{"id": 291, "data": "11", "every_ms": 100}"#), 409);
    rig.post("/bus/disturb", json!({"frames": 0}));
    rig.advance(1000);
    assert!(rig.trace().iter().all(|(_, _, from)| from != "http"));
}

#[test]
fn cyclic_frames_keep_their_period_until_they_are_ended() {
    let rig = Rig::stepped(&[]);
    let first = rig.send_every(10, "100: 01");
    rig.send_every(25, "00000100: 02");
    rig.advance(1000);
    let ends = |frame: &str| -> Vec<u64> {
        rig.trace().into_iter().filter(|(_, found, _)| found == frame).map(|(end, ..)| end).collect()
    };
    let standard = ends("100: 01");
    assert_eq!(standard.len(), 101);
    assert!(standard.iter().zip(0..).all(|(end, number)| *end == first + number * 10_000), "{standard:?}");
    assert_eq!(ends("00000100: 02").len(), 41);
    // Another frame with the same identifier replaces it.
    rig.send_every(50, "100: 03");
    rig.advance(100);
    assert_eq!((ends("100: 01").len(), ends("100: 03").len()), (101, 3));
    assert_eq!(rig.done("DELETE", "/bus/frames?id=100", None), json!({"stopped": 1}));
    assert_eq!(rig.done("DELETE", "/bus/frames?id=0x100", None), json!({"stopped": 0}));
    let extended = ends("00000100: 02").len();
    rig.advance(100);
    assert_eq!((ends("100: 03").len(), ends("00000100: 02").len()), (3, extended + 4));
    for query in ["id=x", "id=", "id=0x20000000", "extended=true", "every=1", "id=1&id=2"] {
        rig.refused("DELETE", &format!("/bus/frames?{query}"), None, 400);
    }
    assert_eq!(rig.done("DELETE", "/bus/frames?id=0x100&extended=true", None), json!({"stopped": 1}));
    rig.send_every(10, "101: 01");
    rig.send_every(10, "102: 01");
    assert_eq!(rig.done("DELETE", "/bus/frames", None), json!({"stopped": 2}));
    let sent = rig.trace().len();
    rig.advance(100);
    assert_eq!(rig.trace().len(), sent);
}

/// Its last attempt completes, and is not repeated.
#[test]
fn a_cyclic_frame_that_is_ended_while_it_is_destroyed_is_sent_no_more() {
    let rig = Rig::stepped(&[]);
    rig.send_every(10, "100: AA");
    rig.post("/bus/disturb", json!({"frames": 1_000_000, "id": 0x100}));
    // An attempt begins at each multiple of the period.
    rig.advance(10);
    assert_eq!(rig.done("DELETE", "/bus/frames", None), json!({"stopped": 1}));
    rig.post("/bus/disturb", json!({"frames": 0}));
    rig.advance(100);
    assert_eq!(rig.trace().iter().filter(|(_, frame, _)| frame == "100: AA").count(), 1);
}

#[test]
fn the_trace_has_the_last_frames() {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20,name=valve"]);
    let all = rig.get("/trace");
    let first = json!({
        "t_us": all[0]["t_us"], "id": 0x720, "extended": false, "data": "00", "from": "valve",
        "meaning": "valve: boot-up"
    });
    assert_eq!((all.as_array().map(Vec::len), &all[0]), (Some(2), &first));
    rig.send("220: 0F 00");
    let limited = rig.get("/trace?limit=2");
    let ids = |frames: &Value| frames.as_array().map(|all| all.iter().map(|frame| frame["id"].clone()).collect());
    assert_eq!(ids(&limited), Some(vec![json!(0xA0), json!(0x220)]));
    assert_eq!(rig.get("/trace?limit=0"), json!([]));
    for query in ["limit=-1", "limit=x", "limit=", "last=1"] {
        rig.refused("GET", &format!("/trace?{query}"), None, 400);
    }
    // Regardless of their number.
    rig.send_every(1, "100: ");
    rig.advance(6000);
    assert_eq!(rig.get("/trace?limit=100000").as_array().map(Vec::len), Some(4096));
    assert_eq!(rig.get("/trace").as_array().map(Vec::len), Some(100));
}
