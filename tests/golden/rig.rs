//! What is done to a running device, a line each, and what can be read from it.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde_json::{Value, json};

use super::program::{Simulator, printed};

/// The kinds of devices.
pub(crate) const KINDS: [&str; 6] =
    ["pvea-canopen", "pveo-canopen", "pvea-isobus", "pveo-isobus", "hat1000", "hat3000"];

/// The name of the device, whatever its kind.
pub(crate) const NAME: &str = "device";

/// The numbers that UDS reads from a valve, but for its data of the factory's files.
const UDS: [&str; 9] = ["1001", "F010", "F1FA", "F192", "F193", "F194", "F195", "F18C", "F18B"];

/// How long an answer may take, in milliseconds of virtual time.
const PATIENCE: u32 = 1000;

/// A running device, alone on its bus.
pub(crate) struct Rig {
    pub(crate) simulator: Simulator,
    kind: String,
}

impl Rig {
    pub(crate) fn new(simulator: Simulator, kind: &str) -> Self {
        Self { simulator, kind: kind.to_owned() }
    }

    /// Does what these lines say.
    pub(crate) fn play<S: AsRef<str>>(&self, lines: &[S]) {
        lines.iter().for_each(|line| self.act(line.as_ref()));
    }

    /// Does what a line says.
    ///
    /// ```text
    /// advance MS             lets time pass          send FRAME        sends it, as a client
    /// every MS FRAME         again and again         ask FRAME ID      sends it and waits for an answer
    /// stop                   no more of that         plant JSON        changes what acts on the device
    /// power JSON             switches it             rate BITS         changes that of the bus
    /// ```
    #[track_caller]
    fn act(&self, line: &str) {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        let call = |method: &str, path: &str, body: Value| drop(self.simulator.done(method, path, &body.to_string()));
        let plain =
            |text: &str| -> Value { serde_json::from_str(text).unwrap_or_else(|error| panic!("{line}: {error}")) };
        match word {
            "advance" => call("POST", "/time", json!({"advance_ms": plain(rest)})),
            "send" => call("POST", "/bus/frames", frame(rest)),
            "every" => {
                let (period, text) = rest.split_once(' ').expect("a period and a frame");
                let mut cyclic = frame(text);
                cyclic["every_ms"] = plain(period);
                call("POST", "/bus/frames", cyclic);
            }
            "ask" => {
                let (text, answer) = rest.rsplit_once(' ').expect("a frame and an identifier");
                call("POST", "/bus/frames", frame(text));
                call("POST", "/wait", json!({"frame": {"id": answer}, "within_ms": PATIENCE}));
            }
            "stop" => drop(self.simulator.done("DELETE", "/bus/frames", "")),
            "plant" => call("PATCH", &format!("/devices/{NAME}/plant"), plain(rest)),
            "power" => call("POST", &format!("/devices/{NAME}/power"), plain(rest)),
            "rate" => call("PATCH", "/bus", json!({"bit_rate": plain(rest)})),
            _ => panic!("no such word: {line}"),
        }
    }

    /// Everything that was on the bus, a line each, with its time.
    pub(crate) fn trace(&self) -> String {
        let entries = self.simulator.done("GET", "/trace?limit=4096", "");
        let line = |entry: &Value| match entry["id"].as_u64() {
            Some(id) => {
                let id = if entry["extended"] == true { format!("{id:08X}") } else { format!("{id:03X}") };
                format!("{:>9}  {id}#{}\n", entry["t_us"].to_string(), words(&entry["data"]))
            }
            None => format!("{:>9}  {}\n", entry["t_us"].to_string(), words(&entry["meaning"])),
        };
        entries.as_array().expect("a list").iter().map(line).collect()
    }

    /// What the control interface says of the device, and of the bus, without what passes.
    pub(crate) fn state(&self) -> String {
        let state = self.simulator.done("GET", &format!("/devices/{NAME}"), "");
        let faults = state["faults"].as_array().expect("a list").iter();
        let faults: Vec<String> = faults
            .filter(|fault| fault["count"] != 0 || fault["active"] == true)
            .map(|fault| {
                format!(
                    "{} {}{}",
                    words(&fault["fault"]),
                    fault["count"],
                    if fault["active"] == true { " active" } else { "" }
                )
            })
            .collect();
        let members = ["node_id", "bit_rate", "nmt", "dsm", "command", "position"];
        let members: Vec<String> = members.iter().map(|key| format!("{key} {}", state[key])).collect();
        let bus = self.simulator.done("GET", "/bus", "")["bit_rate"].clone();
        format!("{}\nfaults [{}]; bus at {bus}\n", members.join(", "), faults.join(", "))
    }

    /// Every value that a client can read from the device, by its name. A device without a node ID has none.
    pub(crate) fn values(&self) -> BTreeMap<String, String> {
        let node = self.simulator.done("GET", &format!("/devices/{NAME}"), "")["node_id"].as_u64();
        let Some(node) = node else { return BTreeMap::new() };
        let mut values = BTreeMap::new();
        if !self.kind.ends_with("isobus") {
            self.read_objects(node, &mut values);
        }
        if self.kind.starts_with("pve") {
            let uds = |source: u64, destination: u64| format!("{:08X}", 0x1BC0_0000 | source << 11 | destination);
            let request = |number: &&str| format!("{}#0322{number}", uds(0xF1, node));
            let answers = self.exchange(&UDS.iter().map(request).collect::<Vec<_>>(), &uds(node, 0xF1), 100);
            values.extend(UDS.iter().zip(answers).map(|(number, answer)| (format!("UDS {number}"), answer)));
        }
        if self.kind.ends_with("isobus") {
            // The NAME; the previously active trouble codes with their counts, in packets if there are many.
            for (name, group, identifier) in
                [("NAME", "00EE00", "18EEFF"), ("DM2", "CBFE00", "18FECB"), ("DM2 packets", "CBFE00", "1CEBFF")]
            {
                let answers =
                    self.exchange(&[format!("18EA{node:02X}27#{group}")], &format!("{identifier}{node:02X}"), 300);
                values.insert(name.to_owned(), answers.join(" "));
            }
        }
        values
    }

    /// The data of all frames of an identifier that come within so many milliseconds of these requests.
    fn exchange(&self, requests: &[String], identifier: &str, millis: u32) -> Vec<String> {
        self.simulator.put(requests);
        let since = self.simulator.done("GET", "/time", "")["now_us"].as_u64().expect("a time");
        self.act(&format!("advance {millis}"));
        let trace = self.simulator.done("GET", "/trace?limit=1000", "");
        let identifier = u64::from_str_radix(identifier, 16).ok();
        let wanted = trace.as_array().expect("a list").iter();
        let wanted = wanted.filter(|entry| entry["t_us"].as_u64() > Some(since) && entry["id"].as_u64() == identifier);
        wanted.map(|entry| words(&entry["data"]).to_owned()).collect()
    }

    /// Reads each object by SDO: its bytes as they come, or the abort code.
    fn read_objects(&self, node: u64, values: &mut BTreeMap<String, String>) {
        let objects = &OBJECTS[self.kind.as_str()];
        let exchange = |requests: &[String]| -> Vec<String> {
            let requests: Vec<String> = requests.iter().map(|data| format!("{:03X}#{data}", 0x600 + node)).collect();
            let answers = self.exchange(&requests, &format!("{:03X}", 0x580 + node), 2 * objects.len() as u32);
            assert_eq!(answers.len(), requests.len(), "an answer to each request: {answers:?}");
            answers
        };
        let initiate = |(index, sub): &(u16, u8)| {
            let [low, high] = index.to_le_bytes();
            format!("40{low:02X}{high:02X}{sub:02X}00000000")
        };
        let firsts = exchange(&objects.iter().map(initiate).collect::<Vec<_>>());
        for (object, first) in objects.iter().zip(firsts) {
            let command = u8::from_str_radix(&first[..2], 16).expect("hex");
            let value = match command {
                0x80 => format!("abort {}", &first[8..]),
                // In segments, of this length.
                0x41 => {
                    let length = usize::from(u8::from_str_radix(&first[8..10], 16).expect("hex"));
                    let segment =
                        |number: usize| format!("{}00000000000000", if number.is_multiple_of(2) { 60 } else { 70 });
                    let requests = std::iter::once(initiate(object)).chain((0..length.div_ceil(7)).map(segment));
                    let segments = exchange(&requests.collect::<Vec<_>>());
                    segments[1..].iter().map(|segment| &segment[2..]).collect::<String>()[..2 * length].to_owned()
                }
                // Expedited, with a size.
                command => first[8..8 + 2 * (4 - usize::from(command >> 2 & 3))].to_owned(),
            };
            values.insert(format!("{:04X}:{}", object.0, object.1), value);
        }
    }
}

/// A text of JSON.
fn words(value: &Value) -> &str {
    value.as_str().expect("a text")
}

/// The body that sends a frame, `220#0F00 0020`.
fn frame(text: &str) -> Value {
    let (id, data) = text.split_once('#').unwrap_or_else(|| panic!("no frame: {text}"));
    json!({"id": id, "data": data})
}

/// The objects of the kinds that have some.
static OBJECTS: LazyLock<BTreeMap<&str, Vec<(u16, u8)>>> = LazyLock::new(|| {
    let kinds = KINDS.into_iter().filter(|kind| !kind.ends_with("isobus"));
    kinds.map(|kind| (kind, objects(&printed(&["eds", kind])))).collect()
});

/// The objects that an EDS lists.
fn objects(sheet: &str) -> Vec<(u16, u8)> {
    let section = |line: &str| {
        let name = line.strip_prefix('[')?.strip_suffix(']')?;
        let (index, sub) = name.split_once("sub").map_or((name, None), |(index, sub)| (index, Some(sub)));
        let index = (index.len() == 4).then(|| u16::from_str_radix(index, 16).ok()).flatten()?;
        Some((index, sub.map(|sub| u8::from_str_radix(sub, 16).expect("hex"))))
    };
    let found: Vec<(u16, Option<u8>)> = sheet.lines().filter_map(section).collect();
    let has_subs = |index: u16| found.iter().any(|(other, sub)| *other == index && sub.is_some());
    found
        .iter()
        .filter_map(|(index, sub)| match sub {
            Some(sub) => Some((*index, *sub)),
            None => (!has_subs(*index)).then_some((*index, 0)),
        })
        .collect()
}
