//! Masters in the eight communication errors of IEC 61784-3: the table of docs/faults.md says what they did.

use std::fs;

use crate::simulator::{Simulator, root};

/// Returns the cells of the page's table: an error each, and what the master of this column does.
fn table(column: usize) -> Vec<(String, String)> {
    let page = fs::read_to_string(root().join("docs/faults.md")).expect("the page");
    let (_, table) = page.split_once("\n| error | python-canopen").expect("the table");
    let rows = table.lines().skip(2).take_while(|line| line.starts_with("| "));
    let cells = rows.map(|row| row.split('|').map(str::trim).collect::<Vec<_>>());
    let cells: Vec<_> = cells.map(|cells| (cells[1].to_owned(), cells[column].to_owned())).collect();
    assert_eq!(cells.len(), 8, "{cells:?}");
    cells
}

/// Runs a script against two valves of a kind, and compares what it prints with the page.
fn run(script: &str, devices: [&str; 2], column: usize) {
    let options: Vec<&str> = devices.into_iter().flat_map(|device| ["--device", device]).collect();
    let simulator = Simulator::start_wound(&options);
    let printed = simulator.serve(script, &[simulator.http()]);
    simulator.terminate();
    for (error, told) in table(column) {
        assert!(printed.lines().any(|line| line == format!("{error}: {told}")), "{error}: {told}, not in\n{printed}");
    }
}

#[test]
fn a_python_canopen_master_in_the_eight_errors() {
    run("eight_errors.py", ["pvea-canopen@0x20,name=boom", "pvea-canopen@0x21,name=arm"], 2);
}

#[test]
fn a_can_j1939_tractor_in_the_eight_errors() {
    run("isobus_eight_errors.py", ["pvea-isobus@0x83,name=boom", "pvea-isobus@0x84,name=arm"], 3);
}
