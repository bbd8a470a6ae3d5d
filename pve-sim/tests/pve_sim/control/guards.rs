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
    rig.refused("POST", "/devices/pvea-canopen/power", Some(&long), 413);
    rig.refused("POST", "/time", Some("{"), 400);
    rig.refused("GET", "/devices/%ff", None, 400);
    let own = format!("Host: {}\r\n", rig.host);
    let (status, answer) = rig.with("GET", "/other", &own, "");
    assert_eq!((status, answer["error"].is_string()), (404, true));
    assert_eq!(rig.get("/time"), json!({"now_us": 10_000, "speed": "step"}));
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
