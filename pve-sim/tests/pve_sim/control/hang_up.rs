//! Clients that hang up, or that close their sending half.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::time::Instant;

use serde_json::{Value, json};

use super::{Rig, micros};
use crate::simulator::PATIENCE;

/// The bytes that a client sends after its request.
const AHEAD: [&str; 3] = ["", "\r\n", "GET /api/v1/time HTTP/1.1\r\nHost: localhost\r\n\r\n"];

impl Rig {
    /// Sends a request with a JSON body, and further bytes.
    fn request(&self, call: &str, body: &Value, ahead: &str) -> TcpStream {
        let mut client = TcpStream::connect(&self.host).expect("a connection");
        client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        let (method, path) = call.split_once(' ').expect("a call");
        let (host, body) = (&self.host, if body.is_null() { String::new() } else { body.to_string() });
        let head = format!("{method} /api/v1{path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n");
        let request = format!("{head}Content-Length: {}\r\n\r\n{body}{ahead}", body.len());
        client.write_all(request.as_bytes()).expect("it reads");
        client
    }

    /// Sends a request, and closes the sending half; returns the answer.
    fn half_closed(&self, call: &str, body: &Value) -> String {
        let mut client = self.request(call, body, "");
        client.shutdown(Shutdown::Write).expect("a half");
        let mut answer = String::new();
        client.read_to_string(&mut answer).expect("text");
        answer
    }

    /// Makes a call until it is no longer 503.
    #[track_caller]
    fn in_the_end(&self, method: &str, path: &str, body: &Value) -> u16 {
        let start = Instant::now();
        loop {
            match self.call(method, path, Some(&body.to_string())).0 {
                503 => assert!(start.elapsed() < PATIENCE, "{method} {path}: the capacity stays exhausted"),
                status => return status,
            }
        }
    }
}

fn wait(within_ms: u32) -> Value {
    json!({"device": "valve", "state": {"powered": false}, "within_ms": within_ms})
}

/// A client that hangs up ends its own call, and time stops.
#[test]
fn a_client_that_hangs_up_waits_no_longer() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    let week = 7 * 86_400_000_u32;
    // A week has too many events to pass in a moment.
    rig.send_every(1, "100: ");
    for (call, body) in [("POST /wait", wait(week)), ("POST /time", json!({"advance_ms": week}))] {
        for ahead in AHEAD {
            let start = micros(&rig.get("/time")["now_us"]);
            let client = rig.request(call, &body, ahead);
            // Time advances, so its turn has come.
            while micros(&rig.get("/time")["now_us"]) == start {}
            client.shutdown(Shutdown::Both).expect("an end");
            drop(client);
            // The next call gets its turn within seconds, not after the week.
            let now = rig.advance(1);
            assert!(now < start + u64::from(week) * 1000, "{call} {ahead}");
            assert_eq!(micros(&rig.get("/time")["now_us"]), now, "{call} {ahead}: time stands");
        }
    }
    let mut client = TcpStream::connect(&rig.host).expect("a connection");
    write!(client, "GET /api/v1/time HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", rig.host).expect("it reads");
    let mut answer = String::new();
    client.read_to_string(&mut answer).expect("text");
    assert!(answer.starts_with("HTTP/1.1 200 "), "{answer}");
}

/// As many waits and followers as there may be, on a bus without frames.
#[test]
fn clients_that_hang_up_make_room() {
    let rig = Rig::start(&["--device", "pvea-canopen,name=valve"]);
    rig.power("valve", json!({"on": false}));
    let body = json!({"device": "valve", "state": {"powered": true}, "within_ms": u32::MAX});
    for ahead in AHEAD {
        let mut waits = Vec::new();
        while rig.call("POST", "/wait", Some(&wait(0).to_string())).0 != 503 {
            waits.push(rig.request("POST /wait", &body, ahead));
        }
        drop(waits);
        assert_eq!(rig.in_the_end("POST", "/wait", &wait(0)), 200);
        let (mut followers, start) = (Vec::new(), Instant::now());
        while followers.len() < 64 {
            let (mut follower, mut head) = (rig.request("GET /events", &Value::Null, ahead), [0; 12]);
            follower.read_exact(&mut head).expect("the head of the stream");
            // Followers of the previous round may not have left yet.
            match &head {
                b"HTTP/1.1 200" => followers.push(follower),
                _ => assert!(start.elapsed() < PATIENCE, "the previous followers stay"),
            }
        }
        assert!(rig.half_closed("GET /events", &Value::Null).starts_with("HTTP/1.1 503 "));
        drop(followers);
        let start = Instant::now();
        while !rig.half_closed("GET /events", &Value::Null).starts_with("HTTP/1.1 200 ") {
            assert!(start.elapsed() < PATIENCE, "the followers stay");
        }
    }
}

/// Each call is answered as on an open connection, except for those that wait.
#[test]
fn a_half_closed_request_is_answered() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    for supply in 9000..9050 {
        assert!(rig.half_closed("GET /time", &Value::Null).starts_with("HTTP/1.1 200 "));
        let changed = rig.half_closed("PATCH /devices/valve/plant", &json!({"supply_mv": supply}));
        assert!(
            changed.starts_with("HTTP/1.1 200 ") && changed.contains(&format!("\"supply_mv\":{supply}")),
            "{changed}"
        );
    }
    let events = rig.half_closed("GET /events", &Value::Null);
    assert!(events.contains("event: device"), "{events}");
    // A week of cyclic frames does not pass before the end is noticed.
    let week = 7 * 86_400_000;
    rig.send_every(1, "100: ");
    for (call, body) in [("POST /wait", wait(week)), ("POST /time", json!({"advance_ms": week}))] {
        let answer = rig.half_closed(call, &body);
        assert!(answer.starts_with("HTTP/1.1 400 ") && answer.contains("keep the connection open"), "{answer}");
    }
}
