//! Device states as a table, in the words of the console's `status`.

use std::iter::once;

use hal_sim::text::in_one_line;
use serde_json::Value;

const COLUMNS: usize = 8;

type Row = [String; COLUMNS];

const HEAD: [&str; COLUMNS] = ["name", "kind", "node_id", "state", "set_point", "position", "led", "faults"];

/// The cell of a member that does not exist for the kind or for an unpowered device.
const ABSENT: &str = "-";

/// Formats a response (the state of one device, or the list of all states) as a table with a line for each device.
///
/// # Errors
/// Fails if the response is not JSON or contains no device states.
pub(super) fn of(answer: &str) -> Result<String, String> {
    let answer: Value = serde_json::from_str(answer).map_err(|error| error.to_string())?;
    let devices = answer.as_array().map_or(std::slice::from_ref(&answer), Vec::as_slice);
    let rows: Option<Vec<Row>> = once(Some(HEAD.map(str::to_owned))).chain(devices.iter().map(row)).collect();
    let rows = rows.ok_or("the answer contains no device states")?;
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

/// Returns the cells of a device state; `None` if a member is missing.
fn row(device: &Value) -> Option<Row> {
    let is_powered = device.get("powered")?.as_bool()?;
    let node_id = match device["node_id"].as_u64() {
        Some(node_id) => format!("0x{node_id:02X}"),
        None if is_powered => "none".to_owned(),
        None => ABSENT.to_owned(),
    };
    let states: Vec<&str> = ["nmt", "dsm", "command"].iter().filter_map(|state| device[state].as_str()).collect();
    let state = if is_powered { states.join(", ") } else { "no power".to_owned() };
    let number_or_word = |value: &Value| match value {
        Value::Null => ABSENT.to_owned(),
        Value::String(word) => word.clone(),
        value => value.to_string(),
    };
    let flashing = if device["led"]["flashing"] == true { " flashing" } else { "" };
    let led = number_or_word(&device["led"]["color"]) + flashing;
    let active = device.get("faults")?.as_array()?.iter().filter(|fault| fault["active"] == true);
    let active: Vec<&str> = active.filter_map(|fault| fault["fault"].as_str()).collect();
    let faults = if active.is_empty() { "none".to_owned() } else { active.join(" ") };
    let [name, kind] = ["name", "kind"].map(|key| device[key].as_str().map(str::to_owned));
    let [set_point, position] = ["set_point", "position"].map(|key| number_or_word(&device[key]));
    // Another program at that address could send control characters to the terminal.
    Some([name?, kind?, node_id, state, set_point, position, led, faults].map(|cell| in_one_line(&cell)))
}
