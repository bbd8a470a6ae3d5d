//! The faults of a plan: one for each combination of an entry's values.

use protocol_core::device::Kind;
use protocol_core::frame::Frame;
use protocol_core::time::Duration;
use toml::{Table, Value};

use crate::devices::NamedDevice;
use crate::scenario::file::table;
use crate::scenario::trial::{device, power, within};
use crate::simulation::{Command, Refusal, Simulation};
use crate::state::{FaultRequest, Invalid, Power, digits};

/// A fault of a plan.
#[derive(Clone, Debug)]
pub(super) struct PlanFault {
    /// The fault in words.
    pub(super) text: String,
    /// The reference for the reports.
    pub(super) reference: Option<String>,
    /// The keys of the fault in the plan, with `device` added and without `reference`.
    pub(super) entry: Table,
    /// The command that injects the fault: a plant change, a power change or a communication fault.
    pub(super) command: Command,
    /// The time after which the power returns, if any.
    pub(super) off_for: Option<Duration>,
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

/// Returns the lists of values in an entry: their keys and lengths.
pub(super) fn lists(entry: &Table) -> Vec<(&str, u64)> {
    let lists = entry.iter().flat_map(|(key, value)| match value {
        Value::Table(table) => lists(table),
        Value::Array(items) if !is_one_value(key, items) => vec![(key.as_str(), items.len() as u64)],
        _ => Vec::new(),
    });
    lists.collect()
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
        let (text, command) = message(entry.clone()).ok()?;
        Some(PlanFault { text, reference: Some(format!("IEC 61784-3: {error}")), entry, command, off_for: None })
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
        let mut off_for = None;
        let (text, command) = match (entry.remove("plant"), entry.remove("power")) {
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
                let (text, command, lasts) = switch(&device.name, change, entry).map_err(within("power"))?;
                off_for = lasts;
                (text, command)
            }
            _ => {
                let kinds = FaultRequest::kinds().collect::<Vec<_>>().join(", ");
                return Err(format!("a fault needs exactly one of plant, power, {kinds}"));
            }
        };
        if let Command::Plant(device, _) | Command::Power(device, _) = &command {
            keys.insert("device".to_owned(), device.clone().into());
        }
        match trial.clone().execute(command.clone()) {
            // A device without power cannot be reset.
            Err(Refusal::Conflict(_)) if matches!(command, Command::Power(..)) => {}
            Err(refusal) => return Err(refusal.to_string()),
            Ok(_) => {}
        }
        Ok(Self { text, reference, entry: keys, command, off_for })
    }

    /// Returns the device of a plant or power change.
    pub(super) fn device(&self) -> Option<&str> {
        match &self.command {
            Command::Plant(device, _) | Command::Power(device, _) => Some(device),
            _ => None,
        }
    }
}

fn message(entry: Table) -> Result<(String, Command), String> {
    let request: FaultRequest = entry.try_into().map_err(|error: toml::de::Error| error.message().to_owned())?;
    let fault = request.fault().map_err(|Invalid(reason)| reason)?;
    Ok((fault.to_string(), Command::Fault(fault)))
}

fn plant(device: &str, mut change: Table, rest: Table) -> Result<(String, Command), String> {
    if change.is_empty() {
        return Err("empty change; give at least one key, as in { supply_mv = 8000 }".to_owned());
    }
    if change.contains_key("for_ms") && rest.contains_key("for_ms") {
        return Err("for_ms is given twice; give it once, inside or beside plant".to_owned());
    }
    change.extend(only_duration(rest)?);
    let keys: Vec<String> = change.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    let text = format!("{device}: {}", keys.join(", "));
    Ok((text, Command::Plant(device.to_owned(), table(change)?)))
}

fn switch(device: &str, change: Table, rest: Table) -> Result<(String, Command, Option<Duration>), String> {
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
    Ok((format!("{device}: {word}{span}"), Command::Power(device.to_owned(), power), lasts))
}

/// Refuses any key except `for_ms`.
fn only_duration(rest: Table) -> Result<Table, String> {
    match rest.keys().find(|key| *key != "for_ms") {
        Some(key) => Err(format!("{key} is a key of communication faults; accepted here: device, for_ms, reference")),
        None => Ok(rest),
    }
}
