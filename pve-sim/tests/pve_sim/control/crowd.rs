//! Events, slow readers, garbage and crowds: the bus keeps its time, and others are served.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
use std::net::TcpStream;
use std::process::Stdio;
use std::time::Instant;

use serde_json::{Value, json};

use super::{Rig, micros};
use crate::simulator::{PATIENCE, Simulator, pve_sim, say};

/// A client that follows the events.
struct Follower(BufReader<TcpStream>);

impl Follower {
    fn join(rig: &Rig) -> Self {
        let mut client = TcpStream::connect(&rig.host).expect("a connection");
        client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        write!(client, "GET /api/v1/events HTTP/1.1\r\nHost: {}\r\n\r\n", rig.host).expect("it reads");
        let mut follower = Self(BufReader::new(client));
        while !follower.line().is_empty() {}
        follower
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        assert!(self.0.read_line(&mut line).expect("a line") > 0, "it has ended");
        line.trim_end().to_owned()
    }

    /// Reads the next event: its name and its data.
    fn event(&mut self) -> (String, Value) {
        loop {
            if let Some(name) = self.line().strip_prefix("event: ") {
                let data = self.line();
                let data = data.strip_prefix("data: ").unwrap_or_else(|| panic!("no data: {data}"));
                return (name.to_owned(), serde_json::from_str(data).expect("JSON"));
            }
        }
    }
}

#[test]
fn events_tell_frames_and_changes() {
    let rig = Rig::stepped(&["--device", "pvea-canopen@0x20,name=valve", "--device", "pvea-isobus@0x80,name=other"]);
    let mut follower = Follower::join(&rig);
    assert_eq!(follower.event(), ("device".to_owned(), rig.device("valve")));
    assert_eq!(follower.event(), ("device".to_owned(), rig.device("other")));
    rig.plant("valve", json!({"supply_mv": 8000}));
    let (name, state) = follower.event();
    assert_eq!((name.as_str(), &state["plant"]["supply_mv"]), ("device", &json!(8000)));
    let end = rig.send("000: 01 20");
    let (name, frame) = follower.event();
    assert_eq!((name.as_str(), &frame["t_us"], &frame["from"]), ("frame", &json!(end), &json!("http")));
    assert_eq!(frame["meaning"], "master: NMT start, valve");
    let (name, state) = follower.event();
    assert_eq!((name.as_str(), &state["nmt"], &state["t_us"]), ("device", &json!("operational"), &json!(end)));
    rig.post("/bus/disturb", json!({"frames": 1}));
    rig.send("7FF: ");
    let (name, trouble) = follower.event();
    assert_eq!((name.as_str(), &trouble["from"]), ("error", &json!("http")), "{trouble}");
    // The spool moves for 125 ms: its position is reported at intervals, and at the end.
    rig.send_every(50, "220: 0F 00 00 20");
    rig.advance(1000);
    let mut positions = Vec::new();
    while positions.last() != Some(&json!(8192)) {
        let (name, state) = follower.event();
        if name == "device" && state["name"] == "valve" {
            positions.push(state["position"].clone());
        }
    }
    assert!(positions.len() >= 6 && positions.is_sorted_by_key(Value::as_i64), "{positions:?}");
}

/// A follower that does not read loses events, and gets their number; the bus goes on meanwhile.
#[test]
fn a_slow_follower_loses_events() {
    let rig = Rig::stepped(&[]);
    let mut follower = Follower::join(&rig);
    let first = rig.send_every(1, "100: 01 02 03 04 05 06 07 08");
    // In parts, because each call has a time limit.
    for _ in 0..20 {
        rig.advance(5_000);
    }
    let frames = rig.trace();
    assert!(frames.iter().all(|(end, ..)| (end - first).is_multiple_of(1_000)), "every stamp is exact");
    rig.done("DELETE", "/bus/frames", None);
    let last = rig.send("7FF: FF");
    let (mut lost, mut told) = (0, 0);
    loop {
        match follower.event() {
            (name, data) if name == "lost" => lost += data["events"].as_u64().expect("a number"),
            (_, data) if data["t_us"] == last => break,
            (name, _) => told += u64::from(name == "frame"),
        }
    }
    assert!(lost > 50_000, "{lost}");
    assert!(lost + told >= 100_000, "{lost} lost, {told} told");
}

#[test]
fn a_crowd_keeps_nobody_from_being_served_and_the_bus_its_time() {
    let rig = Rig::start(&["--device", "pvea-canopen@0x20,name=valve"]);
    let first = rig.send_every(20, "100: 01");
    let mut crowd = Vec::new();
    for number in 0..1000 {
        let Ok(mut client) = TcpStream::connect(&rig.host) else { continue };
        // Nothing, garbage, half a request, or one whose answer is not read.
        let request = match number % 4 {
            0 => String::new(),
            1 => "\u{1}\u{2}garbage\r\n\r\n".to_owned(),
            2 => "POST /api/v1/wait HTTP/1.1\r\nHost: local".to_owned(),
            _ => format!(
                "GET /api/v1/{} HTTP/1.1\r\nHost: {}\r\n\r\n",
                if number % 8 == 3 { "events" } else { "trace?limit=9999" },
                rig.host
            ),
        };
        // A dismissed client is gone.
        let _ = client.write_all(request.as_bytes());
        crowd.push(client);
        if number % 100 == 0 {
            rig.device("valve");
        }
    }
    // From here on, because the crowd may have taken longer on a slow machine.
    let never = json!({"device": "valve", "state": {"powered": false}, "within_ms": 3_000}).to_string();
    assert_eq!(rig.call("POST", "/wait", Some(&never)).0, 408);
    let ends: Vec<u64> =
        rig.trace().into_iter().filter(|(_, frame, _)| frame == "100: 01").map(|(end, ..)| end).collect();
    assert!(ends.len() >= 150, "{}", ends.len());
    assert!(ends.iter().all(|end| (end - first).is_multiple_of(20_000)), "{ends:?}");
    assert!(micros(&rig.get("/time")["now_us"]) >= first + 3_000_000);
    drop(crowd);
}

/// Returns the status of an answer: `None` before it arrives, 0 for a connection closed without one.
fn status(client: &mut TcpStream) -> Option<u16> {
    let mut line = [0; 12];
    client.set_nonblocking(true).expect("a mode");
    match client.peek(&mut line) {
        Ok(12) => Some(String::from_utf8_lossy(&line[9..]).parse().expect("a status")),
        Ok(0) => Some(0),
        Err(error) if error.kind() != ErrorKind::WouldBlock => Some(0),
        _ => None,
    }
}

/// As many clients as connections wait forever: half of them are refused, and others are served.
#[test]
fn clients_that_wait_for_ever_lock_nobody_out() {
    const CONNECTIONS: usize = 256;
    let rig = Rig::start(&["--device", "pvea-canopen@0x20,name=valve"]);
    let body = json!({"device": "valve", "state": {"powered": false}, "within_ms": u32::MAX}).to_string();
    let head = format!("POST /api/v1/wait HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\n", rig.host);
    let mut crowd: Vec<TcpStream> = (0..CONNECTIONS)
        .map(|_| {
            let mut client = TcpStream::connect(&rig.host).expect("a connection");
            write!(client, "{head}Content-Length: {}\r\n\r\n{body}", body.len()).expect("it reads");
            client
        })
        .collect();
    let start = Instant::now();
    let mut refused = 0;
    while refused < CONNECTIONS / 2 {
        assert!(start.elapsed() < PATIENCE, "{refused} are refused");
        refused = crowd.iter_mut().filter_map(status).count();
    }
    assert_eq!(rig.device("valve")["powered"], true);
    assert!(rig.refused("POST", "/wait", Some(&body), 503).contains("too many calls are waiting"));
    rig.power("valve", json!({"on": false}));
    let mut statuses = BTreeMap::<u16, usize>::new();
    for client in &mut crowd {
        let status = loop {
            match status(client) {
                Some(status) => break status,
                None => assert!(start.elapsed() < 3 * PATIENCE, "no answer"),
            }
        };
        *statuses.entry(status).or_default() += 1;
    }
    // A connection may have been dismissed before its call was read.
    let closed = statuses.remove(&0).unwrap_or(0);
    assert!(closed <= 3, "{closed} closed, {statuses:?}");
    assert_eq!(statuses, BTreeMap::from([(200, CONNECTIONS / 2), (503, CONNECTIONS / 2 - closed)]));
}

#[test]
fn calls_are_answered_however_slow_time_is() {
    let rig = Rig::start(&["--speed", "0.0001", "--device", "pvea-canopen@0x20,name=valve"]);
    let mut bus = rig.simulator.join();
    say(&mut bus, "< send 100 0 >");
    assert_eq!(rig.device("valve")["powered"], true);
    assert_eq!(rig.plant("valve", json!({"supply_mv": 8000}))["plant"]["supply_mv"], 8000);
    let never = json!({"device": "valve", "state": {"powered": false}, "within_ms": 0}).to_string();
    assert_eq!(rig.call("POST", "/wait", Some(&never)).0, 408);
    assert!(micros(&rig.get("/time")["now_us"]) < 100_000);
}

/// The shortest possible lines, at the highest rate.
#[test]
fn a_flood_on_stdin_takes_neither_memory_nor_the_control_interface() {
    let options = ["--http", "127.0.0.1:0", "--bus", "socketcand://127.0.0.1:0/pve0"];
    let mut simulator = Simulator::spawn(pve_sim(&options).stdin(Stdio::piped()));
    let mut stdin = simulator.process.stdin.take().expect("a pipe");
    let flood = std::thread::spawn(move || while stdin.write_all(&[b'\n'; 64 * 1024]).is_ok() {});
    let process = simulator.process.id();
    let rig = Rig::of(simulator);
    for _ in 0..50 {
        rig.device("pvea-canopen");
    }
    let status = std::fs::read_to_string(format!("/proc/{process}/status"));
    if let Ok(status) = status {
        let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next());
        let kilobytes: usize = kilobytes.expect("a size").parse().expect("a number");
        assert!(kilobytes < 100_000, "{kilobytes} kB");
    }
    drop(rig);
    flood.join().expect("no panic");
}
