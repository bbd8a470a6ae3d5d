//! The imports that docs/architecture.md allows: between crates, between the modules of a crate; and no circle between files.
//!
//! The modules are followed from `lib.rs` on; what is compiled for tests alone is left out.

#[path = "architecture/imports.rs"]
mod imports;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

use imports::{Crate, Module};

/// A block of the page: from the ground up, each name with those that it may import, which stand before it.
struct Table {
    /// The first line of the block: the folder of the sources.
    sources: String,
    rows: Vec<(String, Vec<String>)>,
}

/// The folders with a table of modules.
const SOURCES: [&str; 3] = ["protocol-core/src", "hal-sim/src", "pve-sim/src"];

/// The first line of the table of crates.
const CRATES: &str = "crates";

/// Names of the crate itself stand at its root.
const ROOT: &str = "";

fn file(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

impl Table {
    /// Reads the block of the page that begins with this line.
    fn read(title: &str) -> Self {
        let page = file("docs/architecture.md");
        let block = page.split("```").find_map(|block| block.strip_prefix(&format!("text\n{title}\n")));
        let block = block.unwrap_or_else(|| panic!("docs/architecture.md has no block {title}"));
        let row = |line: &str| {
            let (name, imports) = line.split_once('→').unwrap_or_else(|| panic!("{title}: {line} has no arrow"));
            (name.trim().to_owned(), imports.split_whitespace().map(str::to_owned).collect())
        };
        let rows = block.lines().rev().map(row).collect();
        Self { sources: title.to_owned(), rows }
    }

    /// Compares the table with the imports that there are: all are in it, each from below, and no others.
    fn check(&self, imports: impl IntoIterator<Item = (String, String, String)>) {
        let Self { sources, rows } = self;
        let place = |name: &str| {
            let place = rows.iter().position(|(known, _)| known == name);
            place.unwrap_or_else(|| panic!("{sources}: {name} is not in docs/architecture.md"))
        };
        let mut used = BTreeSet::new();
        for (from, to, what) in imports {
            let (here, there) = (place(&from), place(&to));
            let is_allowed = rows[here].1.contains(&to) && there < here;
            assert!(is_allowed, "{sources}: {what}: no arrow down from {from} to {to} in docs/architecture.md");
            used.insert((from, to));
        }
        // A line that allows more than there is would let an import in unseen.
        for (from, below) in rows {
            for to in below {
                let is_used = used.contains(&(from.clone(), to.clone()));
                assert!(is_used, "{sources}: {from} does not import {to} any more");
            }
        }
    }
}

#[test]
fn crates_depend_on_what_stands_below_them() {
    let table = Table::read(CRATES);
    let names: Vec<&String> = table.rows.iter().map(|(name, _)| name).collect();
    let mut found = Vec::new();
    for from in &names {
        let manifest = file(&format!("{from}/Cargo.toml"));
        let sections = manifest.split("\n[").filter(|section| {
            let title = section.split(']').next().unwrap_or_default();
            title.ends_with("dependencies") && !title.ends_with("dev-dependencies")
        });
        let keys = sections.flat_map(|section| section.lines().filter_map(|line| line.split(['.', ' ']).next()));
        let keys: BTreeSet<&str> = keys.collect();
        let own = names.iter().filter(|name| keys.contains(name.as_str()));
        found.extend(own.map(|to| ((*from).clone(), (*to).clone(), format!("{from}/Cargo.toml"))));
    }
    table.check(found);
}

#[test]
fn modules_import_what_stands_below_them() {
    for sources in SOURCES {
        let imports = Crate::read(sources).imports().into_iter().filter_map(|(from, to)| {
            let (here, there) = (from.top().to_owned(), to.top().to_owned());
            let is_between = here != there && here != ROOT && there != ROOT;
            is_between.then(|| (here, there, format!("{from} imports {to}")))
        });
        Table::read(sources).check(imports);
    }
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    for sources in SOURCES {
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
