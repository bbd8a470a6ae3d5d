//! Requests refused by the guard, and the JSON of all refusals.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use serde_json::{Value, json};

use super::Rig;
use crate::simulator::{PATIENCE, output, refusal};

impl Rig {
    /// Sends the bytes of a request, which ends the connection; returns status and body.
    fn raw(&self, request: &str) -> (u16, Value) {
        let mut client = TcpStream::connect(&self.host).expect("a connection");
        client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        client.write_all(request.as_bytes()).expect("it reads");
        let mut answer = String::new();
        client.read_to_string(&mut answer).expect("text");
        let status =
            answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or_else(|| panic!("{answer}"));
        let body = answer.split_once("\r\n\r\n").expect("a body").1;
        (status, serde_json::from_str(body).unwrap_or_else(|error| panic!("{error}: {answer}")))
    }

    /// Returns the status of a request for a head.
    fn head(&self, path: &str) -> u16 {
        let url = format!("http://{}{path}", self.host);
        self.agent.head(url).call().expect("an answer").status().as_u16()
    }

    fn with(&self, method: &str, path: &str, headers: &str, body: &str) -> (u16, Value) {
        self.raw(&format!(
            "{method} {path} HTTP/1.1\r\n{headers}Connection: close\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        ))
    }
}

const SWITCH_OFF: &str = r#"{"on": false}"#;
const POWER: &str = "/api/v1/devices/pvea-canopen/power";
const JSON: &str = "Content-Type: application/json\r\n";

#[test]
fn a_foreign_host_or_origin_changes_nothing() {
    let rig = Rig::stepped(&[]);
    let own = format!("Host: {}\r\n", rig.host);
    let foreign = [
        "Host: example.com\r\n".to_owned(),
        format!("Host: example.com:{}\r\n", rig.host.rsplit(':').next().expect("a port")),
        format!("{own}Host: example.com\r\n"),
        format!("Host: user@{}\r\n", rig.host),
        "Host: user@127.0.0.1\r\n".to_owned(),
        "Host: 127.0.0.1:\r\n".to_owned(),
        String::new(),
        format!("{own}Origin: http://example.com\r\n"),
        format!("{own}Origin: null\r\n"),
        format!("{own}Origin: http://localhost:3000\r\n"),
        format!("{own}Sec-Fetch-Site: cross-site\r\n"),
        format!("{own}Sec-Fetch-Site: same-site\r\n"),
    ];
    for headers in foreign {
        let (status, answer) = rig.with("POST", POWER, &format!("{headers}{JSON}"), SWITCH_OFF);
        assert_eq!(status, 403, "{headers}: {answer}");
        assert!(answer["error"].is_string(), "{answer}");
    }
    let target = format!("http://example.com{POWER}");
    assert_eq!(rig.with("POST", &target, &format!("{own}{JSON}"), SWITCH_OFF).0, 403);
    let target = format!("http://user@{}{POWER}", rig.host);
    assert_eq!(rig.with("POST", &target, &format!("{own}{JSON}"), SWITCH_OFF).0, 403);
    // The types that a form on any page can send.
    for kind in ["application/x-www-form-urlencoded", "text/plain", "multipart/form-data"] {
        let (status, answer) = rig.with("POST", POWER, &format!("{own}Content-Type: {kind}\r\n"), SWITCH_OFF);
        assert_eq!((status, answer["error"].is_string()), (415, true), "{answer}");
    }
    assert_eq!(rig.with("POST", POWER, &own, SWITCH_OFF).0, 415);
    assert_eq!(rig.device("pvea-canopen")["powered"], true);
    let same = format!("{own}Origin: http://{}\r\nSec-Fetch-Site: same-origin\r\n{JSON}", rig.host);
    assert_eq!(rig.with("POST", POWER, &same, SWITCH_OFF).0, 200);
    assert_eq!(rig.device("pvea-canopen")["powered"], false);
}

#[test]
fn every_refusal_is_json() {
    let rig = Rig::stepped(&[]);
    rig.refused("GET", "/nothing", None, 404);
    rig.refused("GET", "/devices/", None, 404);
    for (method, path) in
        [("POST", "/devices"), ("DELETE", "/bus"), ("PUT", "/time"), ("GET", "/wait"), ("OPTIONS", "/bus")]
    {
        rig.refused(method, path, None, 405);
    }
    let long = format!(r#"{{"on": false, "x": "{}"}}"#, "x".repeat(70_000));
    let refused = rig.refused("POST", "/devices/pvea-canopen/power", Some(&long), 413);
    assert_eq!(refused, "the body is too large; accepted: up to 65536 bytes");
    rig.refused("POST", "/time", Some("{"), 400);
    assert_eq!(rig.refused("GET", "/devices/%ff", None, 400), "the name in the path is not UTF-8");
    let own = format!("Host: {}\r\n", rig.host);
    let (_, answer) = rig.with("POST", "/api/v1/time", &own, "{}");
    assert_eq!(answer["error"], "the body must have the Content-Type application/json");
    let half = format!("POST /api/v1/time HTTP/1.1\r\n{own}{JSON}Transfer-Encoding: chunked\r\n\r\nx\r\n");
    assert_eq!(rig.raw(&half), (400, json!({"error": "the body was not received"})));
    let (status, answer) = rig.with("GET", "/other", &own, "");
    assert_eq!((status, answer["error"].is_string()), (404, true));
    assert_eq!(rig.get("/time"), json!({"now_us": 10_000, "speed": "step"}));
}

/// A misspelt address of one fault, for example, must not end all of them.
#[test]
fn what_a_call_does_not_read_is_refused() {
    let rig = Rig::stepped(&["--device", "pvea-canopen,name=valve"]);
    rig.post("/bus/faults", json!({"lose": "220"}));
    rig.send_every(1000, "100: ");
    let own = format!("Host: {}\r\n", rig.host);
    let off = "/api/v1/devices/valve/power?on=false";
    for (method, path, body) in [
        ("DELETE", "/api/v1/bus/faults?name=lose-220", ""),
        ("DELETE", "/api/v1/bus/faults/lose-220?x", ""),
        ("GET", "/api/v1/devices?x=1", ""),
        ("HEAD", "/api/v1/events?x=1", ""),
        ("POST", off, SWITCH_OFF),
        ("POST", "/api/v1/bus/frames?id=100", r#"{"id": "100", "data": ""}"#),
        ("DELETE", "/api/v1/bus/frames", r#"{"id": "100"}"#),
        ("DELETE", "/api/v1/bus/faults", r#"{"name": "lose-221"}"#),
        ("GET", "/api/v1/trace?limit=1", "{}"),
    ] {
        let (status, answer) = match method {
            "HEAD" => (rig.head(path), json!({"error": ""})),
            _ => rig.with(method, path, &format!("{own}{JSON}"), body),
        };
        assert_eq!((status, answer["error"].is_string()), (400, true), "{method} {path} {body}: {answer}");
    }
    assert_eq!(rig.with("GET", "/nothing?x=1", &own, "").0, 404);
    assert_eq!(rig.with("PUT", "/api/v1/bus?x=1", &own, "").0, 405);
    assert_eq!(rig.with("GET", "/api/v1/bus?", &own, "").0, 200, "an empty query");
    assert_eq!(rig.with("GET", "/api/v1/trace?limit=1", &own, "").0, 200);
    assert_eq!(rig.device("valve")["powered"], true);
    assert_eq!(rig.get("/bus/faults").as_array().map(Vec::len), Some(1));
    assert_eq!(rig.done("DELETE", "/bus/frames?id=100", None), json!({"stopped": 1}));
}

#[test]
fn the_address() {
    let text = refusal(&["--bus", "socketcand://127.0.0.1:0/pve0", "--http", "0.0.0.0:0"], 2);
    assert!(text.contains("--allow-remote"), "{text}");
    let rig = Rig::start(&["--speed", "step"]);
    let taken = format!("http://{}", rig.host);
    let text = refusal(&["--bus", "socketcand://127.0.0.1:0/pve0", "--http", &rig.host], 1);
    assert!(
        text.contains(&rig.host) && text.contains("--http 127.0.0.1:0") && text.contains("--no-http"),
        "{text} {taken}"
    );
    assert!(String::from_utf8(output(&["--help"]).stdout).expect("text").contains("--http"));
}
