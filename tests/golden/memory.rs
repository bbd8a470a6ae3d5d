//! What becomes of a state file: whether it is taken, what the device has of it, and what is left in the folder.
//!
//! The files in `state/LAYOUT/` were written by the program when that was its layout, and are never written again: every
//! later program has to read them. `cargo test --test golden -- --ignored` writes those that are missing, for a new
//! layout into a new folder.

mod damage;
mod dump;
mod stories;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use super::expected::{check, folder};
use super::program::Simulator;
use super::rig::{KINDS, NAME, Rig};
use stories::Story;

/// The layout that the program writes.
const LAYOUT: &str = "v2";
/// The layouts that programs before it wrote.
const EARLIER: [&str; 1] = ["v1"];

/// How long a device has to start, and to tell what it found.
const START: &str = "advance 500";

/// The device: a file that is there has the rest of it.
fn device(kind: &str) -> String {
    format!("{kind},name={NAME}")
}

/// The bytes of a file of a kind, as a story left it.
fn written(kind: &str, story: &str) -> Vec<u8> {
    written_in(LAYOUT, kind, story)
}

fn written_in(layout: &str, kind: &str, story: &str) -> Vec<u8> {
    let path = folder().join(format!("state/{layout}/{kind}-{story}.hex"));
    dump::parse(&fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
}

/// A folder with a state file.
struct Folder(tempfile::TempDir);

impl Folder {
    fn with(content: &[u8]) -> Self {
        let folder = Self::empty();
        fs::write(folder.file(), content).expect("a file");
        folder
    }

    fn empty() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn file(&self) -> std::path::PathBuf {
        self.0.path().join(format!("{NAME}.nvm"))
    }

    fn path(&self) -> &str {
        self.0.path().to_str().expect("text")
    }

    /// What a program said, without the name of the folder, and without what every run says.
    fn said(&self, stderr: &str) -> String {
        let lines = stderr.replace(self.path(), "DIR");
        lines.lines().filter(|line| line.starts_with("pve-sim: ")).map(|line| format!("stderr: {line}\n")).collect()
    }

    /// What is in it, and whether that is what was there in the beginning.
    fn content(&self, before: &[u8]) -> String {
        let mut names: Vec<String> = fs::read_dir(self.0.path())
            .expect("a folder")
            .map(|entry| entry.expect("a file").file_name().into_string().expect("text"))
            .filter(|name| !name.ends_with(".lock"))
            .collect();
        names.sort();
        let is_same = |name: &String| fs::read(self.0.path().join(name)).expect("a file") == before;
        let line = |name: &String| format!("file: {name}{}\n", if is_same(name) { " as it was" } else { "" });
        names.iter().map(line).collect()
    }
}

/// Values that are other than those of another device, a line each.
fn other_than(values: &BTreeMap<String, String>, usual: &BTreeMap<String, String>) -> String {
    let mut text = String::new();
    for (name, value) in values.iter().filter(|(name, value)| usual.get(*name) != Some(value)) {
        let _ = writeln!(text, "  {name} = {value}");
    }
    text
}

/// A start with a file, told from outside: its frames, its state, the values that are not usual, and the folder.
fn start(kind: &str, content: &[u8], usual: &BTreeMap<String, String>) -> (String, BTreeMap<String, String>) {
    let folder = Folder::with(content);
    let arguments = ["--state", folder.path(), "--device", &device(kind)];
    let (mut text, values) = match Simulator::start(&arguments) {
        Err(ended) => {
            let code = ended.code.expect("no signal ends it");
            (format!("exit {code}\n{}", folder.said(&ended.stderr)), BTreeMap::new())
        }
        Ok(simulator) => {
            let rig = Rig::new(simulator, kind);
            rig.play(&[START]);
            let (mut text, state, values) = (rig.trace(), rig.state(), rig.values());
            text += &state;
            text += &other_than(&values, usual);
            text += &folder.said(&rig.simulator.end().stderr);
            (text, values)
        }
    };
    text += &folder.content(content);
    (text, values)
}

/// What a device keeps that goes on with a file: it stores once more, and starts again.
fn goes_on(kind: &str, content: &[u8], usual: &BTreeMap<String, String>) -> String {
    let folder = Folder::with(content);
    let run = |lines: &[String]| {
        let rig = Rig::new(Simulator::started(&["--state", folder.path(), "--device", &device(kind)]), kind);
        rig.play(&[START]);
        rig.play(lines);
        let values = rig.values();
        let ended = rig.simulator.end();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        (values, folder.said(&ended.stderr))
    };
    let node = node_id(kind, &folder);
    let (_, said) = run(&one_more(kind, node));
    let (after, later) = run(&[]);
    format!("{said}{later}{}", other_than(&after, usual))
}

/// What makes a device of this node ID store once more.
fn one_more(kind: &str, node: Option<u64>) -> Vec<String> {
    let node = node.unwrap_or(0x2C) as u32;
    let lss = ["send 7E5#0401000000000000", "ask 7E5#112C000000000000 7E4", "ask 7E5#1700000000000000 7E4"];
    let lss = lss.map(str::to_owned);
    if kind.ends_with("isobus") {
        return vec![stories::address(node, 0x8E)];
    }
    if node == 0x2C {
        return lss.to_vec();
    }
    let sdo = |data: &str| format!("ask {:03X}#{data} {:03X}", 0x600 + node, 0x580 + node);
    vec![sdo("2B17100010270000"), sdo("2310100173617665")]
}

/// The node ID that a device has with a file.
fn node_id(kind: &str, folder: &Folder) -> Option<u64> {
    let rig = Rig::new(Simulator::started(&["--state", folder.path(), "--device", &device(kind)]), kind);
    rig.play(&[START]);
    let state = rig.simulator.done("GET", &format!("/devices/{NAME}"), "");
    rig.simulator.end();
    state["node_id"].as_u64()
}

/// What becomes of the files of a kind, of files that are none, and of damaged ones.
fn of_kind(kind: &str, other: &str, damaged: &[(String, Vec<u8>)]) {
    let mut text = String::new();
    let (told, usual) = start(kind, &written(kind, "new"), &BTreeMap::new());
    let _ = write!(text, "== new\n{told}\n");
    for Story { name, .. } in stories::of(kind).iter().filter(|story| story.name != "new") {
        let content = written(kind, name);
        let (told, _) = start(kind, &content, &usual);
        let _ = write!(text, "== {name}\n{told}-- stores once more\n{}\n", goes_on(kind, &content, &usual));
    }
    for layout in EARLIER {
        for Story { name, .. } in stories::of(kind) {
            let content = written_in(layout, kind, name);
            let (told, _) = start(kind, &content, &usual);
            let goes_on = goes_on(kind, &content, &usual);
            let _ = write!(text, "== {name}, of {layout}\n{told}-- stores once more\n{goes_on}\n");
        }
    }
    let mut seen = BTreeMap::new();
    for (name, content) in damage::of_the_file(kind, other).iter().chain(damaged) {
        let (told, _) = start(kind, content, &usual);
        // Much damage has one outcome.
        match seen.get(&told) {
            Some(earlier) => drop(write!(text, "== {name}: as {earlier}\n\n")),
            None => {
                let _ = write!(text, "== {name}\n{told}\n");
                seen.insert(told, name);
            }
        }
    }
    check(&format!("state/{kind}.txt"), &text);
}

#[test]
fn pvea_canopen() {
    of_kind("pvea-canopen", "pveo-canopen", &damage::of_the_flash("pvea-canopen"));
}

/// Of two kinds with one memory, the damage of one will do.
#[test]
fn pveo_canopen() {
    of_kind("pveo-canopen", "pvea-canopen", &[]);
}

#[test]
fn pvea_isobus() {
    of_kind("pvea-isobus", "pvea-canopen", &damage::of_the_flash("pvea-isobus"));
}

#[test]
fn pveo_isobus() {
    of_kind("pveo-isobus", "pvea-isobus", &[]);
}

#[test]
fn hat1000() {
    of_kind("hat1000", "hat3000", &damage::of_the_flash("hat1000"));
}

#[test]
fn hat3000() {
    of_kind("hat3000", "hat1000", &[]);
}

/// The board keeps its records in the same way: its sectors behind the header of a file are the same device.
#[test]
fn memories_of_boards() {
    let mut text = String::new();
    for kind in KINDS {
        let (_, usual) = start(kind, &written(kind, "new"), &BTreeMap::new());
        for layout in EARLIER.into_iter().chain([LAYOUT]) {
            for story in ["new", "set"] {
                let path = folder().join(format!("board/{layout}/{kind}-{story}.hex"));
                let sectors = dump::parse(&fs::read_to_string(path).expect("the memory of a board"));
                let header = &written_in(layout, kind, story)[..damage::HEADER];
                let (told, _) = start(kind, &[header, &sectors].concat(), &usual);
                let _ = write!(text, "== {kind}, {story}, of {layout}\n{told}\n");
            }
        }
    }
    check("board/read-by-the-program.txt", &text);
}

/// Writes the files that are missing, and no other.
#[test]
#[ignore = "writes the state files of a new layout"]
fn write_what_is_missing() {
    for kind in KINDS {
        for story in stories::of(kind) {
            let path = folder().join(format!("state/{LAYOUT}/{kind}-{}.hex", story.name));
            if !path.exists() {
                fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
                fs::write(&path, dump::print(&tell(kind, &story))).expect("a file");
            }
        }
    }
}

/// Plays a story; the file that it leaves.
fn tell(kind: &str, story: &Story) -> Vec<u8> {
    let folder = Folder::empty();
    let device = format!("{}{}", device(kind), if story.blank { ",blank" } else { "" });
    let rig = Rig::new(Simulator::started(&["--state", folder.path(), "--device", &device]), kind);
    rig.play(&story.lines);
    let ended = rig.simulator.end();
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    read(&folder.file())
}

fn read(path: &Path) -> Vec<u8> {
    fs::read(path).expect("a state file")
}
