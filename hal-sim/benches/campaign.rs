//! The time of a campaign of 10,000 cells: two valves, a boom with its sensor, and a scripted master, on two threads,
//! with forks and without, on an otherwise idle machine:
//!
//! ```sh
//! cargo bench --package hal-sim --features campaign --bench campaign
//! ```
//!
//! Prints figures without limits, because they depend on the machine. The absolute path of a plan after `--` measures
//! that plan.

#![allow(missing_docs, reason = "a program")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use std::{env, fs, thread};

use hal_sim::campaign::{Campaign, Plan, Verdict};

const SCENARIO: &str = r#"
devices = ["pvea-canopen@0x20,name=lift", "pvea-canopen@0x21,name=tilt", "hat1000@1,bit-rate=250k,name=boom"]
links = ["lift=boom"]
reactions = [
  { on = "0A0", from_ms = 100, send = "000#0200" },
  { on = "0A1", from_ms = 100, send = "000#0200" },
  { missing = "1A0", for_ms = 120, send = "000#0200" },
]
steps = [
  { expect = ["701#00", "720#00", "721#00", "0A0", "0A1"], any_order = true },
  { send = "601#2300 1801 8101 0000", expect = "581#6000 1801 0000 0000" },
  { send = "601#2B00 1805 3200 0000", expect = "581#6000 1805 0000 0000" },
  { send = "000#0100" },
  { send = "220#0F00 0010", every_ms = 50 },
  { send = "221#0F00 00F0", every_ms = 50 },
  { at_ms = 5000 },
]
"#;

/// 25 faults at 401 instants: 10,025 cells, which end between 3 s and 5 s.
const PLAN: &str = r#"
scenario = "boom.toml"
faults = [
  { plant = { supply_mv = [8000, 40000], internal_fault = [false, true] }, device = ["lift", "tilt"] },
  { plant = { spool = ["stuck", "slow", "drifting"] }, device = ["lift", "tilt"] },
  { power = { on = false }, device = ["lift", "tilt", "boom"] },
  { lose = ["220", "221", "1A0", "181"], count = [1, 10] },
]
instants = { from_ms = 2000, to_ms = 4000, step_ms = 5 }
detected = { expect = "000#02..", within_ms = 300 }
safe = { device = "lift", expect = { solenoids = false }, within_ms = 300 }
observe_ms = 1000
"#;

fn main() {
    let path = env::args().skip(1).find(|argument| argument.ends_with(".toml"));
    let plan = match &path {
        Some(path) => {
            let folder = Path::new(path).parent().expect("a folder");
            let read = |file: &str| fs::read_to_string(folder.join(file)).map_err(|error| error.to_string());
            Plan::parse(&fs::read_to_string(path).expect("a plan"), read).expect("a plan")
        }
        None => Plan::parse(PLAN, |_| Ok(SCENARIO.to_owned())).expect("a plan"),
    };
    let campaign = Campaign::new(&plan).unwrap_or_else(|error| panic!("{error}"));
    measure("forked", &campaign);
    if path.is_none() {
        measure("unforked", &campaign.without_forks());
    }
}

/// Runs all rows on two threads.
fn measure(name: &str, campaign: &Campaign<'_>) {
    let began = Instant::now();
    let next = AtomicUsize::new(0);
    let count = || {
        let mut counts: BTreeMap<(usize, Verdict), u64> = BTreeMap::new();
        loop {
            let row = next.fetch_add(1, Ordering::Relaxed);
            if row >= campaign.rows().len() {
                return counts;
            }
            campaign.row(row, &mut |cell| *counts.entry((row, cell.verdict)).or_default() += 1);
        }
    };
    let counts = thread::scope(|scope| {
        let threads = [scope.spawn(count), scope.spawn(count)];
        threads.map(|thread| thread.join().expect("no panic"))
    });
    let took = began.elapsed().as_secs_f64();
    let all: BTreeMap<_, _> = counts.into_iter().flatten().collect();
    if name == "forked" {
        for ((row, verdict), cells) in &all {
            println!("{:<60} {cells:>5} {verdict}", campaign.rows()[*row].fault());
        }
    }
    println!("{name}: {} cells ({} of the grid) in {took:.2} s", all.values().sum::<u64>(), campaign.cells());
}
