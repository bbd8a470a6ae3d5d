//! The time of 1,000 scenarios of 10 s virtual time: `cargo bench --package pve-sim --bench scenarios`, on an otherwise
//! idle machine. Prints figures without limits, because they depend on the machine.

#![allow(missing_docs, reason = "a program")]

use std::fs;
use std::process::Command;
use std::time::Instant;

/// The number of files on one command line.
const FILES: usize = 1_000;

/// Ten seconds of a moving valve: set-points every 100 ms, a fault of the supply, and the recovery.
const VALVE: &str = r#"
devices = ["pvea-canopen@0x20"]
steps = [
  { expect = ["720#00", "0A0#0000 0000 0000 0000"] },
  { send = "000#0100" },
  { send = "220#0F00 0010", every_ms = 100, expect = { dsm = "active", position = 4096 } },
  { at_ms = 4000, plant = { supply_mv = 8500 }, expect = "0A0#1234 0501 0000 0000", within_ms = 2001 },
  { stop = "220" },
  { plant = { supply_mv = 24000 }, expect = "0A0#0000 0000 0000 0000" },
  { send = "220#0300 0000", expect = "1A0#0300 ????" },
  { send = "220#0B00 0000", expect = "1A0#0B00 ????" },
  { send = "220#0F00 0010", every_ms = 100, expect = { dsm = "active", position = 4096 } },
  { never = "0A0" },
  { at_ms = 10000 },
]
"#;

/// Ten seconds of a boom and its sensor, with a TPDO every 10 ms.
const BOOM: &str = r#"
devices = ["pvea-canopen@0x20,name=valve", "hat1000@1,bit-rate=250k,name=boom"]
links = ["valve=boom"]
steps = [
  { expect = ["701#00", "720#00", "0A0#0000 0000 0000 0000"], any_order = true },
  { send = "601#2300 1801 8101 0000", expect = "581#6000 1801 0000 0000" },
  { send = "601#2B00 1805 0A00 0000", expect = "581#6000 1805 0000 0000" },
  { send = "000#0100" },
  { send = "220#0F00 0040", every_ms = 50 },
  { device = "boom", expect = { position = 4096 }, within_ms = 5000 },
  { never = ["081", "0A0"] },
  { at_ms = 10000 },
]
"#;

fn main() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("valve", VALVE), ("boom", BOOM)] {
        let files: Vec<_> = (0..FILES).map(|number| folder.path().join(format!("{name}-{number}.toml"))).collect();
        for file in &files {
            fs::write(file, text).expect("a file");
        }
        let began = Instant::now();
        let output =
            Command::new(env!("CARGO_BIN_EXE_pve-sim")).arg("scenario").args(&files).output().expect("pve-sim runs");
        let took = began.elapsed();
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{}{}", told, String::from_utf8_lossy(&output.stderr));
        println!("{name}: {FILES} scenarios of 10 s in {:.2} s", took.as_secs_f64());
    }
}
