//! The rooms of the crates and the imports between them, as docs/architecture.md describes them, and no circle between files.
//!
//! The modules are followed from `lib.rs` on; what is compiled for tests alone is left out.

#[path = "architecture/imports.rs"]
mod imports;

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use imports::{Crate, Module};

/// The rooms of a crate from the ground up: each may import the rooms named beside it, which stand above it in the list.
struct House {
    sources: &'static str,
    rooms: &'static [(&'static str, &'static str)],
}

const HOUSES: [House; 3] = [
    House {
        sources: "protocol-core/src",
        rooms: &[
            ("time", ""),
            ("frame", ""),
            ("outcome", ""),
            ("memory", ""),
            ("controller", "frame"),
            ("answers", "controller frame"),
            ("wire", "frame"),
            ("actuator", "time"),
            ("encoder", "time"),
            ("uds", "frame wire"),
            ("canopen", "answers controller frame outcome time wire"),
            ("isobus", "answers controller frame time wire"),
            ("device", "actuator canopen controller encoder frame isobus memory time uds wire"),
            ("pump", "controller device time"),
        ],
    },
    House {
        sources: "hal-sim/src",
        rooms: &[
            ("text", ""),
            ("bus", ""),
            ("memory", ""),
            ("world", "bus memory"),
            ("log", ""),
            ("explain", "bus log"),
            ("trace", "bus explain log"),
            ("devices", "memory world"),
            ("state", "bus world"),
            ("simulation", "bus devices explain log memory state trace world"),
            ("describe", "explain"),
            ("recording", "log"),
            ("decode", "devices explain log recording"),
            ("replay", "bus devices explain log memory recording world"),
            ("scenario", "bus devices memory simulation state text trace world"),
        ],
    },
    House {
        sources: "pve-sim/src",
        rooms: &[
            ("speed", ""),
            ("output", ""),
            ("state_file", ""),
            ("use_case", ""),
            ("batch", "use_case"),
            ("remote", ""),
            ("control", "speed"),
            ("inbox", "control"),
            ("gateway", "inbox"),
            ("http", "control inbox"),
            ("run", "control gateway http inbox speed state_file"),
            ("cli", "batch gateway remote run speed use_case"),
        ],
    },
];

/// Names of the crate itself stand at its root.
const ROOT: &str = "";

#[test]
fn rooms_import_what_stands_below_them() {
    for House { sources, rooms } in HOUSES {
        let house = Crate::read(sources);
        let row = |room: &str| rooms.iter().position(|(name, _)| *name == room);
        let mut used = BTreeSet::new();
        for (from, to) in house.imports() {
            let (from_room, to_room) = (from.room(), to.room());
            if from_room == to_room || from_room == ROOT || to_room == ROOT {
                continue;
            }
            let here = row(from_room).unwrap_or_else(|| panic!("{sources}: {from_room} is not in the table"));
            let there = row(to_room).unwrap_or_else(|| panic!("{sources}: {to_room} is not in the table"));
            let is_named = rooms[here].1.split(' ').any(|name| name == to_room) && there < here;
            assert!(is_named, "{sources}: {from} imports {to}: {to_room} is not below {from_room}");
            used.insert((here, to_room.to_owned()));
        }
        // A line that allows more than there is would let an import in unseen.
        for (here, (name, below)) in rooms.iter().enumerate() {
            for room in below.split(' ').filter(|room| !room.is_empty()) {
                assert!(used.contains(&(here, room.to_owned())), "{sources}: {name} does not import {room} any more");
            }
        }
    }
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    for House { sources, .. } in HOUSES {
        let mut imports: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
        for (from, to) in Crate::read(sources).imports() {
            // A folder's own file and those in it are one subject.
            if !from.is_within(&to) && !to.is_within(&from) {
                imports.entry(from).or_default().insert(to);
            }
        }
        for module in imports.keys() {
            let circle = way(&imports, module, module, &mut BTreeSet::new());
            assert!(circle.is_none(), "{sources}: a circle of imports: {}", circle.unwrap_or_default());
        }
    }
}

/// A Rust user's tests wait for what hal-sim brings: without features at most ten crates beyond those of the core and the
/// memory.
#[test]
fn hal_sim_brings_few_crates() {
    let crates = |package: &str| -> BTreeSet<String> {
        let mut tree = Command::new(env!("CARGO"));
        tree.args(["tree", "--offline", "--edges", "normal", "--prefix", "none", "--package", package]);
        let output = tree.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let words = String::from_utf8(output.stdout).expect("names");
        words.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
    };
    let below = &crates("protocol-core") | &crates("nvm");
    let added = &crates("hal-sim") - &below;
    assert!(added.contains("fastrand"), "{added:?}");
    assert!(added.len() <= 11, "hal-sim and ten: {added:?}");
}

/// Returns the way from a module to another one, import by import.
fn way(
    imports: &BTreeMap<Module, BTreeSet<Module>>,
    from: &Module,
    to: &Module,
    seen: &mut BTreeSet<Module>,
) -> Option<String> {
    imports.get(from)?.iter().find_map(|next| {
        let rest = if next == to {
            Some(to.to_string())
        } else if seen.insert(next.clone()) {
            way(imports, next, to, seen)
        } else {
            None
        };
        rest.map(|rest| format!("{from} → {rest}"))
    })
}
