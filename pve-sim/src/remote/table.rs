//! Device states as a table, in the words of the console's `status`.

use std::iter::once;

use hal_sim::text::in_one_line;
use serde::Deserialize;
use serde_json::Value;

/// The members of a device state that appear in the table.
#[derive(Debug, Deserialize)]
struct Shown {
    name: String,
    kind: String,
    node_id: Option<u8>,
    powered: bool,
    nmt: Option<String>,
    dsm: Option<String>,
    command: Option<String>,
    set_point: Option<Value>,
    position: Option<i16>,
    led: Option<Led>,
    faults: Vec<Fault>,
}

#[derive(Debug, Deserialize)]
struct Led {
    color: String,
    flashing: bool,
}

#[derive(Debug, Deserialize)]
struct Fault {
    fault: String,
    active: bool,
}

/// The state of one device, or the list of all states.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Answer {
    All(Vec<Shown>),
    One(Box<Shown>),
}

const COLUMNS: usize = 8;

type Row = [String; COLUMNS];

const HEAD: [&str; COLUMNS] = ["name", "kind", "node_id", "state", "set_point", "position", "led", "faults"];

/// The cell of a member that does not exist for the kind or for an unpowered device.
const ABSENT: &str = "-";

/// Returns a response of the control interface as a table, with a line for each device.
///
/// # Errors
/// When the JSON is not that of device states.
pub(super) fn of(answer: &str) -> serde_json::Result<String> {
    let devices = match serde_json::from_str(answer)? {
        Answer::All(devices) => devices,
        Answer::One(device) => vec![*device],
    };
    let rows: Vec<Row> = once(HEAD.map(str::to_owned)).chain(devices.iter().map(row)).collect();
    let widths = rows.iter().fold([0; COLUMNS], |mut widths, row| {
        widths.iter_mut().zip(row).for_each(|(width, cell)| *width = (*width).max(cell.chars().count()));
        widths
    });
    Ok(rows.iter().map(|row| line(row, widths)).collect())
}

fn line(row: &Row, widths: [usize; COLUMNS]) -> String {
    let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}"));
    cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
}

fn row(device: &Shown) -> Row {
    let absent = || ABSENT.to_owned();
    let node_id = match device.node_id {
        Some(node_id) => format!("0x{node_id:02X}"),
        None if device.powered => "none".to_owned(),
        None => absent(),
    };
    let states: Vec<&str> =
        [&device.nmt, &device.dsm, &device.command].into_iter().filter_map(Option::as_deref).collect();
    let state = if device.powered { states.join(", ") } else { "no power".to_owned() };
    let set_point = match &device.set_point {
        Some(Value::String(word)) => word.clone(),
        Some(position) => position.to_string(),
        None => absent(),
    };
    let position = device.position.map_or_else(absent, |position| position.to_string());
    let led = device.led.as_ref().map_or_else(absent, |led| {
        let flashing = if led.flashing { " flashing" } else { "" };
        format!("{}{flashing}", led.color)
    });
    let active: Vec<&str> =
        device.faults.iter().filter(|fault| fault.active).map(|fault| fault.fault.as_str()).collect();
    let faults = if active.is_empty() { "none".to_owned() } else { active.join(" ") };
    // Another program at that address could send control characters to the terminal.
    [device.name.clone(), device.kind.clone(), node_id, state, set_point, position, led, faults]
        .map(|cell| in_one_line(&cell))
}
