//! The control interface: status, type and body of each answer, as they are on the wire.

use std::fmt::Write as _;
use std::io::Read as _;

use super::expected::{check, check_all};
use super::program::{Answer, Simulator};

const DEVICES: [&str; 8] = [
    "--device",
    "pvea-canopen@0x20,name=boom",
    "--device",
    "pveo-isobus@0x83,name=arm",
    "--device",
    "hat1000@5,name=angle,bit-rate=250k",
    "--link",
    "boom=angle",
];

/// The calls, a line each.
const REQUESTS: &str = include_str!("inputs/requests.txt");

/// The most frames that are cyclic.
const CYCLIC: usize = 64;

/// The headers that are part of an answer's meaning.
const HEADERS: [&str; 6] =
    ["content-type", "allow", "cache-control", "content-security-policy", "referrer-policy", "x-content-type-options"];

impl Answer {
    /// The answer in text, without its body.
    fn told(&self) -> String {
        let headers = HEADERS.into_iter().filter_map(|name| Some(format!(", {name}: {}", self.header(name)?)));
        format!("{}{}\n", self.status, headers.collect::<String>())
    }

    /// The answer in text.
    fn with_body(&self) -> String {
        format!("{}{}\n\n", self.told(), self.body)
    }
}

#[test]
fn calls() {
    let simulator = Simulator::started(&DEVICES);
    let mut text = String::new();
    for line in REQUESTS.lines() {
        let mut words = line.splitn(3, ' ');
        match (words.next(), words.next(), words.next().unwrap_or_default()) {
            (Some(method), Some(path), body) if !method.starts_with('#') => {
                let _ = write!(text, "{line}\n{}", simulator.call(method, path, body).with_body());
            }
            _ => text += &format!("{line}\n"),
        }
    }
    check("http/calls.txt", &text);
}

/// Requests that are refused whatever they ask for.
#[test]
fn guards() {
    let simulator = Simulator::started(&[]);
    let own = format!("Host: {}\r\n", simulator.host);
    let json = "Content-Type: application/json\r\n";
    let power = "/api/v1/devices/pvea-canopen/power";
    let long = format!(r#"{{"on": "{}"}}"#, "x".repeat(70_000));
    let on = r#"{"on": true}"#;
    let mut text = String::new();
    let mut tell = |what: &str, answer: Answer| text += &format!("{what}\n{}", answer.with_body());
    for (what, head) in [
        ("no Host", String::new()),
        ("another Host", "Host: example.com\r\n".to_owned()),
        ("two Hosts", format!("{own}{own}")),
        ("a user in the Host", "Host: user@127.0.0.1\r\n".to_owned()),
        ("another Origin", format!("{own}Origin: http://example.com\r\n")),
        ("Origin null", format!("{own}Origin: null\r\n")),
        ("its own Origin", format!("{own}Origin: http://{}\r\n", simulator.host)),
        ("another site", format!("{own}Sec-Fetch-Site: cross-site\r\n")),
        ("the same site", format!("{own}Sec-Fetch-Site: same-site\r\n")),
        ("the same origin", format!("{own}Sec-Fetch-Site: same-origin\r\n")),
        ("localhost", "Host: localhost\r\n".to_owned()),
    ] {
        tell(what, simulator.with("POST", power, &format!("{head}{json}"), on));
    }
    tell(
        "a link on another site",
        simulator.with("GET", "/api/v1/time", &format!("{own}Sec-Fetch-Site: cross-site\r\n"), ""),
    );
    for kind in ["application/x-www-form-urlencoded", "text/plain"] {
        tell(kind, simulator.with("POST", power, &format!("{own}Content-Type: {kind}\r\n"), on));
    }
    tell("no Content-Type", simulator.with("POST", power, &own, on));
    tell("a long body", simulator.with("POST", power, &format!("{own}{json}"), &long));
    tell("no body", simulator.with("POST", power, &format!("{own}{json}"), ""));
    tell("no text", simulator.with("POST", power, &format!("{own}{json}"), "\u{1}"));
    for id in 0..=CYCLIC {
        let answer = simulator.call("POST", "/bus/frames", &format!(r#"{{"id": {id}, "data": "", "every_ms": 1000}}"#));
        if answer.status != 200 {
            tell(&format!("cyclic frame {id}"), answer);
        }
    }
    tell("all of them", simulator.call("DELETE", "/bus/frames", ""));
    check("http/guards.txt", &text);
}

/// The panel: its files as they are served, but not what is in them.
#[test]
fn panel() {
    let simulator = Simulator::started(&[]);
    let host = format!("Host: {}\r\n", simulator.host);
    let get = |path: &str| simulator.with("GET", path, &host, "");
    let page = get("/");
    let mut text = format!("/ {}", page.told());
    let mut found: Vec<String> =
        page.body.split('"').filter(|word| word.starts_with("/panel/")).map(str::to_owned).collect();
    let mut next = 0;
    while let Some(path) = found.get(next).cloned() {
        let file = get(&path);
        text += &format!("{path} {}", file.told());
        for name in file.body.split('"').filter_map(|word| word.strip_prefix("./")) {
            let imported = format!("/panel/{name}");
            if !found.contains(&imported) {
                found.push(imported);
            }
        }
        next += 1;
    }
    for path in ["/panel/none.js", "/panel/", "/other", "/api/v1", "/api/v1/"] {
        text += &format!("{path} {}", get(path).with_body());
    }
    check("http/panel.txt", &text);
}

/// The events of a valve that goes to half its stroke, and of a destroyed frame.
#[test]
fn events() {
    let simulator = Simulator::started(&["--device", "pvea-canopen@0x20,name=boom"]);
    let call = |method: &str, path: &str, body: &str| drop(simulator.done(method, path, body));
    call("POST", "/time", r#"{"advance_ms": 10}"#);
    let mut stream = simulator.ask(&format!("GET /api/v1/events HTTP/1.1\r\nHost: {}\r\n\r\n", simulator.host));
    let mut heard = String::new();
    let mut hear = |last: &str| {
        while !heard.contains(last) {
            let mut bytes = [0; 4096];
            let count = stream.read(&mut bytes).expect("an event");
            assert!(count > 0, "the stream has ended: {heard}");
            heard += std::str::from_utf8(&bytes[..count]).expect("ASCII");
        }
        heard.clone()
    };
    // It follows from here on.
    hear("\n\n");
    call("POST", "/bus/frames", r#"{"id": 0, "data": "0120"}"#);
    call("POST", "/bus/frames", r#"{"id": "220", "data": "0F000020", "every_ms": 100}"#);
    call("POST", "/time", r#"{"advance_ms": 450}"#);
    call("PATCH", "/devices/boom/plant", r#"{"supply_mv": 23000}"#);
    call("POST", "/bus/disturb", r#"{"frames": 1, "id": "220"}"#);
    call("POST", "/time", r#"{"advance_ms": 100}"#);
    call("POST", "/devices/boom/power", r#"{"on": false}"#);
    call("POST", "/bus/frames", r#"{"id": "7FE", "data": "FEED"}"#);
    let heard = hear(r#""data":"FEED""#);
    let (head, body) = heard.split_once("\r\n\r\n").expect("a head");
    let head: String =
        head.lines().filter(|line| !line.starts_with("date: ")).map(|line| format!("{line}\n")).collect();
    // Without the sizes of the chunks, and without the comments of a quiet bus.
    let lines = body.lines().filter(|line| line.starts_with("event: ") || line.starts_with("data: "));
    check("http/events.txt", &format!("{head}\n{}\n", lines.collect::<Vec<_>>().join("\n")));
}

/// The description, a member a line.
#[test]
fn description() {
    let simulator = Simulator::started(&[]);
    let answer = simulator.call("GET", "/openapi.json", "");
    let version = format!(r#""version":"{}""#, env!("CARGO_PKG_VERSION"));
    assert!(answer.body.contains(&version), "{}", answer.body);
    check_all(&[
        ("http/openapi.json".to_owned(), laid_out(&answer.body.replace(&version, r#""version":"VERSION""#))),
        ("http/openapi.txt".to_owned(), answer.told()),
    ]);
}

/// JSON with a line for each member, in the order of its members.
fn laid_out(json: &str) -> String {
    let (mut text, mut depth, mut is_string, mut is_escaped) = (String::new(), 0, false, false);
    let line = |depth: usize| format!("\n{}", "  ".repeat(depth));
    for character in json.chars() {
        match character {
            '}' | ']' if !is_string => {
                depth -= 1;
                text += &line(depth);
            }
            _ => {}
        }
        text.push(character);
        match character {
            '"' if !is_escaped => is_string = !is_string,
            '{' | '[' if !is_string => {
                depth += 1;
                text += &line(depth);
            }
            ',' if !is_string => text += &line(depth),
            _ => {}
        }
        is_escaped = character == '\\' && !is_escaped;
    }
    text + "\n"
}
