//! The control interface of the running program: each call, valid and invalid.

mod bus;
mod crowd;
mod description;
mod devices;
mod faults;
mod guards;
mod hang_up;
mod messages;
mod time;
mod wait;

use serde_json::{Value, json};

use crate::simulator::{PATIENCE, Simulator};

/// A simulator with its control interface.
pub(crate) struct Rig {
    pub(crate) simulator: Simulator,
    /// `127.0.0.1:PORT` of the interface.
    pub(crate) host: String,
    agent: ureq::Agent,
}

impl Rig {
    /// Returns one with stepped time, after the start of all devices.
    pub(crate) fn stepped(arguments: &[&str]) -> Self {
        let rig = Self::start(&[&["--speed", "step"], arguments].concat());
        rig.advance(10);
        rig
    }

    pub(crate) fn start(arguments: &[&str]) -> Self {
        Self::of(Simulator::serve(&[&["--http", "127.0.0.1:0"], arguments].concat()))
    }

    /// Returns one for a running simulator.
    pub(crate) fn of(simulator: Simulator) -> Self {
        let (_, http) = simulator.ready.split_once(" http=http://").expect("an address");
        let host = http.strip_suffix('/').expect("a slash").to_owned();
        let config = ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(PATIENCE));
        Self { simulator, host, agent: config.build().into() }
    }

    /// Returns status and body of a request with an optional JSON body.
    pub(crate) fn call(&self, method: &str, path: &str, body: Option<&str>) -> (u16, Value) {
        let request = ureq::http::Request::builder().method(method).uri(format!("http://{}/api/v1{path}", self.host));
        let answer = match body {
            Some(body) => {
                let request = request.header("content-type", "application/json").body(body);
                self.agent.run(request.expect("a request"))
            }
            None => self.agent.run(request.body(()).expect("a request")),
        };
        let mut answer = answer.unwrap_or_else(|error| panic!("{method} {path}: {error}"));
        let text = answer.body_mut().read_to_string().expect("text");
        let body = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{method} {path}: {error}: {text}"));
        (answer.status().as_u16(), body)
    }

    /// Returns the body of a successful answer.
    #[track_caller]
    pub(crate) fn done(&self, method: &str, path: &str, body: Option<Value>) -> Value {
        let (status, answer) = self.call(method, path, body.as_ref().map(ToString::to_string).as_deref());
        assert_eq!(status, 200, "{method} {path} {body:?}: {answer}");
        answer
    }

    /// Returns the text of a refusal.
    #[track_caller]
    pub(crate) fn refused(&self, method: &str, path: &str, body: Option<&str>, status: u16) -> String {
        let (found, answer) = self.call(method, path, body);
        assert_eq!(found, status, "{method} {path} {body:?}: {answer}");
        assert_eq!(answer.as_object().map(serde_json::Map::len), Some(1), "{answer}");
        answer["error"].as_str().unwrap_or_else(|| panic!("no words: {answer}")).to_owned()
    }

    #[track_caller]
    pub(crate) fn get(&self, path: &str) -> Value {
        self.done("GET", path, None)
    }

    #[track_caller]
    pub(crate) fn post(&self, path: &str, body: Value) -> Value {
        self.done("POST", path, Some(body))
    }

    #[track_caller]
    pub(crate) fn plant(&self, device: &str, change: Value) -> Value {
        self.done("PATCH", &format!("/devices/{device}/plant"), Some(change))
    }

    #[track_caller]
    pub(crate) fn power(&self, device: &str, change: Value) -> Value {
        self.post(&format!("/devices/{device}/power"), change)
    }

    #[track_caller]
    pub(crate) fn device(&self, name: &str) -> Value {
        self.get(&format!("/devices/{name}"))
    }

    #[track_caller]
    pub(crate) fn advance(&self, millis: u32) -> u64 {
        micros(&self.post("/time", json!({"advance_ms": millis}))["now_us"])
    }

    /// Sends a frame in the manual's notation, `220: 0F 00 00 20`; returns its end.
    #[track_caller]
    pub(crate) fn send(&self, frame: &str) -> u64 {
        micros(&self.post("/bus/frames", frame_body(frame))["t_us"])
    }

    #[track_caller]
    pub(crate) fn send_every(&self, millis: u32, frame: &str) -> u64 {
        let mut body = frame_body(frame);
        body["every_ms"] = millis.into();
        micros(&self.post("/bus/frames", body)["t_us"])
    }

    /// Waits for a state; returns it.
    #[track_caller]
    pub(crate) fn wait(&self, device: &str, state: Value, millis: u32) -> Value {
        self.post("/wait", json!({"device": device, "state": state, "within_ms": millis}))
    }

    /// Returns the last frames in the manual's notation, each with its end and its sender.
    pub(crate) fn trace(&self) -> Vec<(u64, String, String)> {
        let frames = self.get("/trace?limit=4096");
        let frames = frames.as_array().expect("a list").iter().filter(|entry| entry.get("id").is_some());
        frames.map(|frame| (micros(&frame["t_us"]), printed(frame), text(&frame["from"]))).collect()
    }
}

pub(crate) fn micros(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("no time: {value}"))
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_else(|| panic!("no text: {value}")).to_owned()
}

fn frame_body(frame: &str) -> Value {
    let (id, data) = frame.split_once(':').expect("an identifier");
    json!({
        "id": u32::from_str_radix(id, 16).expect("hex"),
        "extended": id.len() == 8,
        "data": data.replace(' ', ""),
    })
}

fn printed(frame: &Value) -> String {
    let id = frame["id"].as_u64().expect("a number");
    let id = if frame["extended"] == true { format!("{id:08X}") } else { format!("{id:03X}") };
    let data = text(&frame["data"]);
    let bytes: Vec<&str> = data.as_bytes().chunks(2).map(|byte| std::str::from_utf8(byte).expect("hex")).collect();
    format!("{id}: {}", bytes.join(" "))
}
