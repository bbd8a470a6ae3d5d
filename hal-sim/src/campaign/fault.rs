//! The faults of a plan: one for each combination of an entry's values.

use std::fmt::Write as _;

use protocol_core::device::Kind;
use protocol_core::frame::Frame;
use protocol_core::time::Duration;
use toml::{Table, Value};

use crate::bus::Fault;
use crate::devices::NamedDevice;
use crate::scenario::file::table;
use crate::scenario::trial::{device, power, within};
use crate::simulation::{Command, Refusal, Simulation};
use crate::state::{FaultRequest, Invalid, PlantChange, Power, digits};

/// A fault of a plan.
#[derive(Clone, Debug)]
pub(super) struct PlanFault {
    /// The fault in words.
    pub(super) text: String,
    /// The reference for the reports.
    pub(super) reference: Option<String>,
    /// The keys of the fault in the plan, with `device` added and without `reference`.
    pub(super) entry: Table,
    pub(super) act: Act,
}

/// The action that injects a fault.
#[derive(Clone, Debug)]
pub(super) enum Act {
    /// A plant change of the named device.
    Plant(String, PlantChange),
    /// A power change of the named device. The power returns after the duration, if any.
    Power(String, Power, Option<Duration>),
    /// A communication fault.
    Message(Fault),
}

/// The device faults of a valve: causes of all monitors except time guarding (SPEC 3), and lever, power and processor.
/// A drifting spool is omitted, because each movement ends the drift before the monitor detects it.
const ALL_OF_PVE: [&str; 13] = [
    "plant = { supply_mv = 8000 }",
    "plant = { supply_mv = 40000 }",
    "plant = { temperature_c = 130 }",
    "plant = { spool = \"stuck\" }",
    "plant = { spool = \"slow\" }",
    "plant = { spool = \"no-float\" }",
    "plant = { lever = 16384 }",
    "plant = { lever = -16384 }",
    "plant = { internal_fault = true }",
    "plant = { memory = \"write-fails\" }",
    "plant = { bus_off = true }",
    "power = { on = false }",
    "power = { reset = \"watchdog\" }",
];

/// Returns the number of combinations of an entry's values.
pub(super) fn count(entry: &Table) -> u64 {
    let of = |(key, value): (&String, &Value)| match value {
        Value::Table(table) => count(table),
        Value::Array(items) if !is_one_value(key, items) => items.len() as u64,
        _ => 1,
    };
    entry.iter().map(of).fold(1, u64::saturating_mul)
}

/// Returns a key that needs a value but has an empty list.
pub(super) fn without_value(entry: &Table) -> Option<&str> {
    entry.iter().find_map(|(key, value)| match value {
        Value::Table(table) => without_value(table),
        Value::Array(items) if items.is_empty() && !is_one_value(key, items) => Some(key),
        _ => None,
    })
}

/// Returns one table for each combination of an entry's values. The last key varies fastest.
pub(super) fn combinations(entry: &Table) -> Vec<Table> {
    let mut all = vec![Table::new()];
    for (key, value) in entry {
        let values: Vec<Value> = match value {
            Value::Table(table) => combinations(table).into_iter().map(Value::Table).collect(),
            Value::Array(items) if !is_one_value(key, items) => items.clone(),
            value => vec![value.clone()],
        };
        let with = |table: &Table, value: &Value| {
            let mut table = table.clone();
            table.insert(key.clone(), value.clone());
            table
        };
        all = all.iter().flat_map(|table| values.iter().map(move |value| with(table, value))).collect();
    }
    all
}

/// Returns whether a list is a single value of its key: names of receivers, the limits of a delay, or the points of a
/// profile.
fn is_one_value(key: &str, items: &[Value]) -> bool {
    match key {
        "receivers" => items.iter().all(Value::is_str),
        "ms" => items.len() == 2 && items.iter().all(Value::is_integer),
        "points" => items.iter().all(|item| item.as_array().is_some_and(|pair| pair.iter().all(Value::is_integer))),
        _ => false,
    }
}

/// Returns the faults of [`ALL_OF_PVE`] for each valve.
///
/// # Errors
/// The reason, if there is no valve.
pub(super) fn all_of_pve(devices: &[NamedDevice]) -> Result<Vec<Table>, String> {
    let valves = devices.iter().filter(|device| matches!(device.setup.kind, Kind::Pve(_)));
    let entries = valves.flat_map(|valve| {
        let entry = |text: &&str| toml::from_str(&format!("{text}\ndevice = \"{}\"", valve.name)).ok();
        ALL_OF_PVE.iter().filter_map(entry)
    });
    let entries: Vec<Table> = entries.collect();
    if entries.is_empty() {
        return Err("'all-of-pve': the scenario has no valve; add a valve, or give faults as tables".to_owned());
    }
    Ok(entries)
}

/// The eight communication errors of IEC 61784-3. `ID` stands for the identifier, `MASK` for the changed bits, and
/// `DATA` for the data with these changes.
const ERRORS: [(&str, &str); 8] = [
    ("corruption", "corrupt = \"ID\"\ndata = { toggle = \"MASK\" }"),
    ("unintended repetition", "repeat = \"ID\"\ntimes = 5\nafter_ms = 5"),
    ("incorrect sequence", "swap = \"ID\""),
    ("loss", "lose = \"ID\""),
    ("unacceptable delay", "delay = \"ID\"\nms = 300"),
    ("insertion", "insert = \"ID#DATA\""),
    ("masquerade", "masquerade = \"ID#DATA\"\nevery_ms = 20"),
    ("addressing", "corrupt = \"ID\"\nidentifier = { toggle = \"1\" }"),
];

/// The number of communication errors on the identifier of a frame without data.
pub(super) const LEAST_ERRORS: u64 = ERRORS.len() as u64 - 1;

/// The bit that a communication error changes in the last data byte.
const CHANGED_BIT: u8 = 0x40;

/// Returns the communication errors on a frame's identifier: all eight, or all except corruption if the frame has no
/// data.
pub(super) fn communication(frame: &Frame) -> impl Iterator<Item = PlanFault> {
    let (id, mut data) = (digits(frame.id()), frame.data().to_vec());
    let mut mask = vec![0; data.len()];
    if let (Some(byte), Some(bit)) = (data.last_mut(), mask.last_mut()) {
        (*byte, *bit) = (*byte ^ CHANGED_BIT, CHANGED_BIT);
    }
    let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02X}")).collect::<String>();
    let (is_empty, mask, data) = (data.is_empty(), hex(&mask), hex(&data));
    let errors = ERRORS.iter().filter(move |(_, text)| !is_empty || !text.contains("MASK"));
    let errors =
        errors.map(move |(error, text)| (error, text.replace("ID", &id).replace("MASK", &mask).replace("DATA", &data)));
    errors.filter_map(|(error, text)| {
        let entry: Table = toml::from_str(&text).ok()?;
        let (text, act) = message(entry.clone()).ok()?;
        Some(PlanFault { text, reference: Some(format!("IEC 61784-3: {error}")), entry, act })
    })
}

impl PlanFault {
    /// Checks one combination of an entry's values. `trial` is a simulation of the devices, without power.
    ///
    /// # Errors
    /// The reason, with the accepted values.
    pub(super) fn check(mut entry: Table, devices: &[NamedDevice], trial: &Simulation) -> Result<Self, String> {
        let reference = match entry.remove("reference") {
            Some(Value::String(text)) => Some(text),
            _ => None,
        };
        let mut keys = entry.clone();
        let name = entry.remove("device");
        let is_message = FaultRequest::kinds().any(|kind| entry.contains_key(kind));
        let (text, act) = match (entry.remove("plant"), entry.remove("power")) {
            (None, None) if name.is_some() => {
                return Err("device is only valid together with plant or power".to_owned());
            }
            (None, None) if is_message => message(entry)?,
            (Some(Value::Table(change)), None) if !is_message => {
                let device = device(devices, name.as_ref().and_then(Value::as_str), true)?;
                plant(&device.name, change, entry).map_err(within("plant"))?
            }
            (None, Some(Value::Table(change))) if !is_message => {
                let device = device(devices, name.as_ref().and_then(Value::as_str), true)?;
                switch(&device.name, change, entry).map_err(within("power"))?
            }
            _ => {
                let kinds = FaultRequest::kinds().collect::<Vec<_>>().join(", ");
                return Err(format!("a fault needs exactly one of plant, power, {kinds}"));
            }
        };
        if let Act::Plant(device, _) | Act::Power(device, ..) = &act {
            keys.insert("device".to_owned(), device.clone().into());
        }
        let fault = Self { text, reference, entry: keys, act };
        let mut trial = trial.clone();
        match trial.execute(fault.command()) {
            // A device without power cannot be reset.
            Err(Refusal::Conflict(_)) if matches!(fault.act, Act::Power(..)) => Ok(fault),
            Err(refusal) => Err(refusal.to_string()),
            Ok(_) => Ok(fault),
        }
    }

    /// Returns the command that injects the fault.
    pub(super) fn command(&self) -> Command {
        match &self.act {
            Act::Plant(device, change) => Command::Plant(device.clone(), change.clone()),
            Act::Power(device, power, _) => Command::Power(device.clone(), *power),
            Act::Message(fault) => Command::Fault(fault.clone()),
        }
    }
}

fn message(entry: Table) -> Result<(String, Act), String> {
    let request: FaultRequest = entry.try_into().map_err(|error: toml::de::Error| error.message().to_owned())?;
    let fault = request.fault().map_err(|Invalid(reason)| reason)?;
    Ok((fault.to_string(), Act::Message(fault)))
}

fn plant(device: &str, mut change: Table, rest: Table) -> Result<(String, Act), String> {
    if change.is_empty() {
        return Err("empty change; give at least one key, as in { supply_mv = 8000 }".to_owned());
    }
    if change.contains_key("for_ms") && rest.contains_key("for_ms") {
        return Err("for_ms is given twice; give it once, inside or beside plant".to_owned());
    }
    change.extend(only_duration(rest)?);
    let text = change.iter().fold(format!("{device}:"), |mut text, (key, value)| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{} {key} = {value}", if text.ends_with(':') { "" } else { "," });
        text
    });
    Ok((text, Act::Plant(device.to_owned(), table(change)?)))
}

fn switch(device: &str, change: Table, rest: Table) -> Result<(String, Act), String> {
    let power = power(table(change)?)?;
    let lasts = match only_duration(rest)?.remove("for_ms") {
        Some(Value::Integer(_)) if power != Power::Off => {
            return Err("for_ms is only valid with { on = false }".to_owned());
        }
        Some(Value::Integer(ms)) => u64::try_from(ms).ok().map(Duration::from_millis),
        _ => None,
    };
    let word = match power {
        Power::Off => "power off",
        Power::On => "power on",
        Power::Watchdog => "watchdog reset",
    };
    let span = lasts.map_or_else(String::new, |lasts| format!(" for {} ms", lasts.as_millis()));
    Ok((format!("{device}: {word}{span}"), Act::Power(device.to_owned(), power, lasts)))
}

/// Refuses any key except `for_ms`.
fn only_duration(rest: Table) -> Result<Table, String> {
    match rest.keys().find(|key| *key != "for_ms") {
        Some(key) => Err(format!("{key} is a key of communication faults; accepted here: device, for_ms, reference")),
        None => Ok(rest),
    }
}
