//! Input of users and scripts: command lines, lines on stdin, and calls over HTTP.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use hal_sim::devices::{DeviceSpec, NamedDevice, NamedLink, named};
use hal_sim::simulation::Simulation;
use hal_sim::world::Electronics;
use hal_sim::{Kind, Memory};
use pve_sim::cli::{Request, parse};
use pve_sim::control::Speed;
use pve_sim::gateway::BusUrl;
use pve_sim::http;
use pve_sim::inbox::ToWorld;
use pve_sim::run::RunOptions;
use serde_json::{Map, Value};
use tokio::sync::oneshot;

use crate::keyboard::Keyboard;
use crate::room::assert_one_line;
use crate::simulator::{Simulator, Stranger, play};

/// The maximum number of lines.
const LINES: usize = 16;

/// The maximum number of devices in a world.
const DEVICES: usize = 4;

/// The character that ends typed input without an end of line.
const END_OF_INPUT: u8 = 4;

/// The methods of HTTP. A line that begins with one is a call.
const METHODS: [&str; 7] = ["GET ", "POST ", "PATCH ", "DELETE ", "PUT ", "HEAD ", "OPTIONS "];

/// Plays lines of any bytes. The first one holds the arguments of `pve-sim`. A line that begins with a method is a
/// call, with a body after the path. A line with `!` is sent to the server as it is (0x01 stands for an end of line),
/// and one with `+` lets milliseconds pass. All other lines are typed; A typed line that ends in 0x04 has no end of
/// line.
///
/// A refusal has one line and changes nothing. An accepted change is made as a whole. The next call is answered.
pub fn control(bytes: &[u8]) {
    let mut lines = bytes.split(|byte| *byte == b'\n');
    let options = options(&String::from_utf8_lossy(lines.next().unwrap_or_default()));
    let lines: Vec<&[u8]> = lines.take(LINES).collect();
    play(converse(options, &lines));
}

/// Returns the options of the arguments or, if they start no run, the default options.
fn options(arguments: &str) -> RunOptions {
    let words = |text: &str| parse(["pve-sim"].into_iter().chain(text.split(' ').filter(|word| !word.is_empty())));
    let options = match words(arguments) {
        Ok(Request::Run(options)) => {
            check_words(&options);
            Some(options)
        }
        Ok(_) => None,
        Err(refusal) => {
            assert_one_line(&refusal.to_string());
            None
        }
    };
    let options = options.filter(|options| options.devices.len() <= DEVICES);
    options.unwrap_or_else(|| match words("--speed step") {
        Ok(Request::Run(options)) => options,
        _ => panic!("the options of a run"),
    })
}

/// Asserts that the printed form of the options parses to the same options.
fn check_words(options: &RunOptions) {
    for device in &options.devices {
        let NamedDevice { name, setup, spool_times, has_oil, electronics, roughness } = device;
        let id = setup.node_id.map_or_else(|| ",blank".to_owned(), |id| format!("@{id}"));
        let mut text = format!("{}{id},name={name}", setup.kind);
        text.extend(setup.serial.map(|serial| format!(",serial=0x{serial:X}")));
        text.extend(setup.bit_rate.map(|rate| format!(",bit-rate={}", rate.bits_per_second())));
        if matches!(setup.kind, Kind::Pve(_)) {
            text += &format!(",stroke-ms={},return-ms={}", spool_times.stroke_ms(), spool_times.return_ms());
        }
        let Electronics { boot, answer: (from, to), cycle, brown_out_mv } = electronics;
        let [boot, from, to, cycle] = [boot, from, to, cycle].map(|time| time.as_millis());
        text += &format!(",boot-ms={boot},answer-ms={from}..{to},cycle-ms={cycle}");
        text.extend(brown_out_mv.map(|supply| format!(",brown-out-mv={supply}")));
        text += &format!(",noise={},dead-band={}", roughness.noise, roughness.dead_band);
        text.extend(has_oil.then_some(",oil"));
        let spec: DeviceSpec = text.parse().unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_eq!(named(vec![spec]).as_ref().map(Vec::as_slice), Ok(std::slice::from_ref(device)));
    }
    for NamedLink { valve, sensor, link } in &options.links {
        assert!(link.min < link.max, "{link:?}");
        let kind =
            |name: &String| options.devices.iter().find(|device| device.name == *name).map(|device| device.setup.kind);
        assert!(matches!((kind(valve), kind(sensor)), (Some(Kind::Pve(_)), Some(Kind::Hat(_)))));
    }
    for bus in &options.buses {
        assert_eq!(bus.to_string().parse::<BusUrl>().as_ref(), Ok(bus));
    }
    if let Speed::Factor(factor) = options.speed {
        assert!(factor.is_finite() && factor > 0.0);
    }
}

fn simulator(options: &RunOptions) -> Simulator {
    let rate = options.bit_rate.or_else(|| options.devices.first()?.setup.bit_rate);
    let mut simulation = Simulation::new(rate.unwrap_or(hal_sim::BitRate::Kbit250), options.seed);
    for device in &options.devices {
        simulation.add(device, Memory::in_ram());
    }
    simulation.link(&options.links);
    let speed = if options.speed == Speed::STEP { Speed::STEP } else { Speed::Factor(1.0) };
    Simulator::new(simulation, |driver| driver.controlled(speed))
}

/// A simulator, and the connection of an observer.
struct Desk {
    simulator: Simulator,
    observer: Stranger,
}

/// An answer of the server: status and body.
type Answer = (u16, String);

async fn converse(options: RunOptions, lines: &[&[u8]]) {
    let simulator = simulator(&options);
    let observer = connect(&simulator);
    let mut desk = Desk { simulator, observer };
    let mut keyboard = Keyboard::default();
    let mut typed = 0;
    for line in lines {
        let text = String::from_utf8_lossy(line);
        let before = desk.look().await;
        if let Some(ms) = text.strip_prefix('+') {
            let ms = ms.trim().parse::<u64>().unwrap_or(1).min(100);
            desk.simulator.pass(Duration::from_millis(ms)).await;
        } else if let Some(raw) = line.strip_prefix(b"!") {
            desk.raw(raw).await;
        } else if METHODS.iter().any(|method| text.starts_with(method)) {
            desk.call(&text, &before).await;
        } else if let Some(begun) = line.strip_suffix(&[END_OF_INPUT]) {
            keyboard.enter(begun, false);
        } else if let Some(text) = keyboard.enter(line, true) {
            let (obeyed, done) = oneshot::channel();
            desk.simulator.world_sender.tell(ToWorld::Typed(text.clone(), obeyed));
            desk.simulator.settle().await;
            drop(done);
            typed += 1;
            check_typed(&text, &before, &desk.look().await);
        }
    }
    let now = desk.ask("GET /api/v1/time").await;
    assert_eq!(now.0, 200, "the last word: {}", now.1);
    let stderr = desk.simulator.end();
    assert!(stderr.lines().count() <= 40 * (typed + 1), "{stderr}");
    assert!(stderr.len() <= 4096 * (typed + 1), "{stderr}");
}

fn connect(simulator: &Simulator) -> Stranger {
    let (stranger, far) = Stranger::new();
    let local = SocketAddr::from((Ipv4Addr::LOCALHOST, 8408));
    tokio::spawn(http::serve(far, local, simulator.world_sender.clone()));
    stranger
}

impl Desk {
    /// Returns the states of all devices, the bus and the trace at this time.
    async fn look(&mut self) -> [Value; 3] {
        let mut seen = [Value::Null, Value::Null, Value::Null];
        for (seen, resource) in seen.iter_mut().zip(["devices", "bus", "trace?limit=20"]) {
            let (status, body) = self.ask(&format!("GET /api/v1/{resource}")).await;
            assert_eq!(status, 200, "{resource}: {body}");
            *seen = serde_json::from_str(&body).expect("JSON");
        }
        seen
    }

    /// Makes a call without a body on the connection of the observer.
    async fn ask(&mut self, call: &str) -> Answer {
        self.observer.say(format!("{call} HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes()).await;
        self.simulator.settle().await;
        answer(&self.observer.heard().0).unwrap_or_else(|| panic!("no answer to {call}"))
    }

    /// Makes the call of a line on its own connection.
    async fn call(&mut self, line: &str, before: &[Value; 3]) {
        let mut words = line.splitn(3, ' ');
        let (method, path) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        let body = words.next().unwrap_or_default();
        let mut stranger = connect(&self.simulator);
        let head = format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n");
        stranger.say(format!("{head}Content-Length: {}\r\n\r\n{body}", body.len()).as_bytes()).await;
        self.simulator.settle().await;
        let (heard, _) = stranger.heard();
        let Some((status, text)) = answer(&heard) else {
            // The call waits for time that does not pass, so the client disconnects.
            assert!(heard.is_empty(), "half an answer: {}", String::from_utf8_lossy(&heard));
            let is_slow = ["/wait", "/time", "/frames"].iter().any(|path| line.contains(path));
            assert!(is_slow, "no answer to {line}");
            stranger.leave().await;
            return self.simulator.settle().await;
        };
        let (path, _) = path.split_once('?').unwrap_or((path, ""));
        let known = [200, 400, 403, 404, 405, 408, 409, 413, 414, 415, 503];
        assert!(known.contains(&status), "{status}: {text}");
        let after = self.look().await;
        if status >= 400 && method != "HEAD" {
            check_refusal(status, &text);
        }
        if (status >= 400 && !matches!(status, 408 | 409)) || method == "GET" {
            assert_eq!(after, *before, "what is refused, or read, changes nothing: {line}");
        }
        if status == 200 && path.ends_with("/plant") {
            check_plant(body, &text);
        }
        stranger.leave().await;
    }

    /// Sends bytes to the server as they are.
    async fn raw(&mut self, bytes: &[u8]) {
        let mut stranger = connect(&self.simulator);
        let bytes: Vec<u8> =
            bytes.iter().flat_map(|byte| if *byte == 1 { b"\r\n".to_vec() } else { vec![*byte] }).collect();
        stranger.say(&bytes).await;
        self.simulator.settle().await;
        let (heard, _) = stranger.heard();
        if let Some((status, _)) = answer(&heard) {
            let text = String::from_utf8_lossy(&bytes).to_lowercase();
            let is_own = ["localhost", "127.", "[::1]"].iter().any(|host| text.contains(host));
            assert!(is_own || status >= 400, "{status} without a host of loopback");
        }
        stranger.leave().await;
        self.simulator.settle().await;
    }
}

/// Returns the first complete answer in the output of a server. The body of a stream of events is the part that has
/// come.
fn answer(heard: &[u8]) -> Option<Answer> {
    let text = String::from_utf8_lossy(heard);
    let (head, body) = text.split_once("\r\n\r\n")?;
    let status = head.strip_prefix("HTTP/1.")?.get(2..5)?.parse().ok()?;
    Some((status, body.to_owned()))
}

/// Asserts that a refusal has one line.
fn check_refusal(status: u16, body: &str) {
    // The HTTP server itself refuses bytes that are no request.
    if body.is_empty() {
        return assert!(matches!(status, 400 | 414), "{status} without a word");
    }
    let refusal: Map<String, Value> = serde_json::from_str(body).unwrap_or_else(|error| panic!("{error}: {body}"));
    let line = refusal.get("error").and_then(Value::as_str).unwrap_or_else(|| panic!("no error: {body}"));
    assert!(!line.is_empty() && line.len() <= 8192, "{line}");
}

/// Asserts that a change was made as a whole.
fn check_plant(asked: &str, state: &str) {
    let (Ok(asked), Ok(state)) =
        (serde_json::from_str::<Map<String, Value>>(asked), serde_json::from_str::<Value>(state))
    else {
        return;
    };
    for (key, asked) in asked {
        let found = &state["plant"][&key];
        let is_so = match (&asked, found) {
            (Value::Number(asked), Value::Number(found)) => asked.as_f64() == found.as_f64(),
            (Value::Bool(_) | Value::Null, found) => asked == *found,
            // The state shows it by another word, or not at all.
            _ => true,
        };
        assert!(is_so, "{key}: {found} instead of {asked}");
    }
}

/// Asserts that a typed line changed nothing but the value of its word, of one device.
fn check_typed(line: &str, [before, ..]: &[Value; 3], [after, ..]: &[Value; 3]) {
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let none = Vec::new();
    let (before, after) = (before.as_array().unwrap_or(&none), after.as_array().unwrap_or(&none));
    assert_eq!(before.len(), after.len());
    for (before, after) in before.iter().zip(after) {
        let (Some(old), Some(new)) = (before["plant"].as_object(), after["plant"].as_object()) else { continue };
        let changed: Vec<&String> =
            new.iter().filter(|(key, value)| old.get(*key) != Some(value)).map(|(key, _)| key).collect();
        match (changed.as_slice(), words.as_slice()) {
            ([], _) => {}
            ([key], [word, value]) if key == word => check_value(value, &new[*key]),
            ([key], [name, word, value]) if key == word && after["name"] == *name => check_value(value, &new[*key]),
            _ => panic!("{line:?} changed {changed:?} of {}", after["name"]),
        }
    }
}

fn check_value(word: &str, value: &Value) {
    let is_so = match value {
        Value::Number(number) => word.parse::<f64>().ok() == number.as_f64(),
        Value::Bool(is) => word == if *is { "on" } else { "off" },
        Value::Null => word == "off",
        Value::String(text) => word == text,
        Value::Object(spool) => spool["fault"].as_str().unwrap_or("ok") == word,
        Value::Array(_) => false,
    };
    assert!(is_so, "{word} became {value}");
}
