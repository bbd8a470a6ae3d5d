//! `pve-sim campaign`: verdicts, results files, shards, interruptions and refusals.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

use rustix::process::{Pid, Signal, kill_process};

use crate::simulator::{end_of, output, pve_sim, refusal, spawn};

/// A valve in ACTIVE, whose set-point comes every 50 ms.
const SCENARIO: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
steps = [
  { expect = "720#00" },
  { send = "000#0100" },
  { send = "220#0F00 0010", every_ms = 50 },
  { at_ms = 1500, expect = { dsm = "active", position = 4096 } },
]
"#;

/// The valve shuts down 2 s after a low supply, and after 250 ms without set-points; one set-point fewer is nothing.
const PLAN: &str = r#"
title = "Shutdown"
scenario = "drive.toml"
faults = [
  { plant = { supply_mv = [8000, 40000] } },
  { lose = "220", count = [1, 20], reference = "IEC 61784-3: loss" },
]
instants = { from_ms = 500, to_ms = 700, step_ms = 50 }
safe = { expect = { dsm = "fault-hold", solenoids = false }, within_ms = 2100 }
"#;

/// A folder with a scenario and plans.
struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Self {
        let files = Self(tempfile::tempdir().expect("a folder"));
        files.write("drive.toml", SCENARIO);
        files.write("plan.toml", PLAN);
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).to_str().expect("text").to_owned()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).expect("a file");
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("text")
    }

    /// Runs `campaign` in the folder; returns the exit code, stdout and stderr.
    fn run(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        let ended = end_of(pve_sim(&[&["campaign"], arguments].concat()).current_dir(self.0.path()));
        let text = |bytes| String::from_utf8(bytes).expect("text");
        (ended.status.code(), text(ended.stdout), text(ended.stderr))
    }
}

#[test]
fn each_fault_has_its_verdict_and_its_command_gives_the_same() {
    let files = Files::new();
    let (code, told, errors) = files.run(&["plan.toml"]);
    assert_eq!((code, errors.as_str()), (Some(0), ""), "{told}");
    let starts = |line: &str| told.lines().filter(|told| told.starts_with(line)).count();
    assert_eq!(starts("ok   valve: supply_mv = "), 2, "{told}");
    assert_eq!(starts("ok   lose 220, count 1: 5 cells: 5 no-effect"), 1, "{told}");
    assert_eq!(starts("       worst: safe at "), 3, "{told}");
    assert!(told.contains(", safe after 2000.000 ms\n") && told.ends_with(" passed, 0 failed\n"), "{told}");

    files.write("strict.toml", &PLAN.replace("2100", "1900"));
    let (code, told, _) = files.run(&["strict.toml", "--csv", "cells.csv"]);
    assert_eq!(code, Some(1), "{told}");
    assert!(told.contains("FAIL valve: supply_mv = 8000: "), "{told}");
    let commands: Vec<&str> = told.lines().filter_map(|line| line.trim().strip_prefix("pve-sim campaign ")).collect();
    assert_eq!(commands.len(), 2, "{told}");
    for command in commands {
        let (code, told, _) = files.run(&command.split(' ').collect::<Vec<_>>());
        assert_eq!(code, Some(1), "{told}");
        let last = told.lines().last().expect("a line");
        assert!(last.starts_with("FAIL valve: supply_mv = ") && last.contains(": late at "), "{told}");
        assert!(told.contains("EMCY: supply too "), "{told}");
    }
    // Each cell of the grid, alone, is as in the campaign.
    for line in files.read("cells.csv").lines().skip(1).filter(|line| line.split(',').nth(1) != Some("")).step_by(3) {
        let fields: Vec<&str> = line.split(',').collect();
        let (_, told, _) = files.run(&["strict.toml", "--cell", fields[1]]);
        let word = fields.iter().find(|field| ["late", "safe", "no-effect"].contains(field)).expect("a verdict");
        assert!(told.lines().last().expect("a line").contains(&format!(": {word} at ")), "{line}\n{told}");
    }
}

#[test]
fn forks_shards_and_jobs_change_nothing() {
    let files = Files::new();
    assert_eq!(files.run(&["plan.toml", "--jobs", "1", "--html", "one.html"]).0, Some(0));
    let whole = files.read("plan.results.jsonl");
    assert_eq!(files.run(&["plan.toml", "--jobs", "3", "--results", "three"]).0, Some(0));
    assert!(files.read("three") == whole);
    assert_eq!(files.run(&["plan.toml", "--no-fork", "--results", "slow"]).0, Some(0));
    assert!(files.read("slow").replace("\"forked\":false", "\"forked\":true") == whole);
    for part in ["3/4", "1/4", "4/4", "2/4"] {
        assert_eq!(files.run(&["plan.toml", "--shard", part]).0, Some(0), "{part}");
    }
    let parts = ["4", "2", "1", "3"].map(|part| format!("plan.{part}-of-4.results.jsonl"));
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let merge =
        |parts: &[&str]| files.run(&[&["merge", "--results", "merged", "--html", "merged.html"], parts].concat());
    assert_eq!(merge(&parts).0, Some(0));
    assert!(files.read("merged") == whole);
    assert!(files.read("merged.html") == files.read("one.html"));
    let (code, told, _) = merge(&parts[1..]);
    assert_eq!(code, Some(1));
    assert!(told.contains("\nmissing: 1 of 4 rows, with all their cells: 3\n"), "{told}");
}

#[test]
fn an_interrupted_campaign_goes_on() {
    let files = Files::new();
    // So many cells that it does not end by itself.
    files.write(
        "long.toml",
        &PLAN
            .replace("to_ms = 700, step_ms = 50", "to_ms = 600, step_ms = 10")
            .replace("[1, 20]", "[1, 2, 3, 4, 5, 6, 7, 8, 9]"),
    );
    let mut command = pve_sim(&["campaign", "long.toml", "--jobs", "1"]);
    let (process, _watch) = spawn(command.current_dir(files.0.path()));
    let rows =
        || fs::read_to_string(files.path("long.results.jsonl")).unwrap_or_default().matches("{\"row\":{").count();
    while rows() == 0 {
        thread::yield_now();
    }
    kill_process(Pid::from_child(&process), Signal::INT).expect("it still runs");
    let ended = process.wait_with_output().expect("its end");
    assert_eq!((ended.status.code(), ended.stdout.len()), (Some(1), 0));
    let line =
        "pve-sim: interrupted; the complete rows are in long.results.jsonl; the same command with --resume continues\n";
    assert_eq!(String::from_utf8(ended.stderr).expect("text"), line);
    let before = files.read("long.results.jsonl");
    assert!((1..11).contains(&rows()), "{}", rows());

    let (code, told, _) = files.run(&["long.toml", "--resume"]);
    assert_eq!(code, Some(0), "{told}");
    assert_eq!(rows(), 11);
    assert!(files.read("long.results.jsonl").starts_with(&before));
    // Nothing is left to do.
    let begun = files.read("long.results.jsonl");
    assert_eq!(files.run(&["long.toml", "--resume"]), (Some(0), told, String::new()));
    assert!(files.read("long.results.jsonl") == begun);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_exit_1_with_one_line() {
    let files = Files::new();
    for option in ["--results", "--html", "--csv", "--json", "--junit"] {
        let (code, _, errors) = files.run(&["plan.toml", option, "/dev/full"]);
        assert_eq!(code, Some(1), "{option}");
        assert!(errors.ends_with("/dev/full: No space left on device (os error 28)\n"), "{option}: {errors}");
        assert_eq!(errors.lines().count(), 1, "{errors}");
    }
    files.write("notes", "mine");
    let (code, _, errors) = files.run(&["plan.toml", "--results", "notes"]);
    assert_eq!(
        (code, errors.as_str()),
        (Some(1), "pve-sim: notes: not a results file, so it is not replaced; use another --results\n")
    );
    assert_eq!(files.read("notes"), "mine");
}

#[test]
fn a_plan_that_cannot_be_read_is_exit_2_before_anything_runs() {
    let files = Files::new();
    let instants = "from_ms = 0, to_ms = 99999999, step_ms = 1";
    for (name, text, said) in [
        ("typo.toml", PLAN.replace("faults", "fault"), ":4: unknown key 'fault'; did you mean 'faults'?"),
        ("word.toml", PLAN.replace("supply_mv", "suply_mv"), ":5: "),
        ("many.toml", PLAN.replace("from_ms = 500, to_ms = 700, step_ms = 50", instants), ""),
        ("never.toml", PLAN.replace("fault-hold\"", "fault-holding\""), ":9: "),
        ("none.toml", PLAN.replace("drive.toml", "away.toml"), ":3: scenario: away.toml: No such file"),
    ] {
        files.write(name, &text);
        let file = files.text(name);
        let line = refusal(&["campaign", &file, "--results", &files.text("results")], 2);
        assert!(line.starts_with(&format!("pve-sim: {file}:")) && line.contains(said), "{line}");
    }
    assert!(!files.path("results").exists());
    refusal(&["campaign", "nowhere.toml"], 2);
    let plan = files.text("plan.toml");
    refusal(&["campaign", &plan, "--html", &plan], 2);
    refusal(&["campaign", &plan, "--cell", "1000"], 2);
    refusal(&["campaign", &plan, "--shard", "5/4"], 2);
    refusal(&["campaign", "merge", &plan], 1);
}

#[test]
fn a_run_without_a_fault_that_fails_is_exit_1() {
    let files = Files::new();
    files.write("drive.toml", &SCENARIO.replace("position = 4096", "position = 4097"));
    let (code, told, errors) = files.run(&["plan.toml"]);
    assert_eq!((code, told.as_str()), (Some(1), ""));
    assert!(errors.starts_with("pve-sim: plan.toml: ") && errors.contains("4097"), "{errors}");
    assert!(!files.path("plan.results.jsonl").exists());
}

#[test]
fn the_schema_is_that_of_the_page() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/campaign.schema.json");
    let told = String::from_utf8(output(&["campaign", "--schema"]).stdout).expect("text");
    assert!(
        told == fs::read_to_string(path).expect("the copy"),
        "pve-sim campaign --schema > docs/campaign.schema.json"
    );
}

/// A plan whose controller is a program.
fn with_program(words: &str) -> String {
    PLAN.replace("from_ms = 500, to_ms = 700", "from_ms = 20, to_ms = 20").replace("[8000, 40000]", "8000")
        + &format!("controller = {words}\nspeed = 10\nobserve_ms = 2200\n")
}

#[test]
fn a_program_is_the_controller_and_its_end_is_a_verdict() {
    let files = Files::new();
    files.write(
        "ends.toml",
        &with_program("[\"sh\", \"-c\", \"echo on $0; echo No module; exit 3\", \"{bus}\"]").replace("[1, 20]", "1"),
    );
    let (code, told, errors) = files.run(&["ends.toml", "--json", "ends.json"]);
    assert_eq!((code, errors.as_str()), (Some(1), ""), "{told}");
    assert!(told.ends_with("0 passed, 2 failed\n") && told.contains("1 hung"), "{told}");
    assert_eq!(told.matches("\n       controller: No module\n       pve-sim campaign ").count(), 2, "{told}");
    assert!(files.read("ends.json").contains("on socketcand://127.0.0.1:"), "its output is kept");

    files.write("silent.toml", &with_program("[\"true\"]"));
    let (_, told, _) = files.run(&["silent.toml"]);
    assert!(told.contains("1 hung") && !told.contains("controller"), "{told}");

    files.write("none.toml", &with_program("[\"no-such-program\"]"));
    let (code, _, errors) = files.run(&["none.toml"]);
    assert_eq!(code, Some(1));
    assert!(errors.starts_with("pve-sim: controller no-such-program: No such file"), "{errors}");
}

/// Sends 77F when it has received the boot-up and, later, an EMCY.
#[cfg(target_os = "linux")]
const LISTENER: &str = r#"
port=${1##*:}
exec 3<>"/dev/tcp/127.0.0.1/${port%/*}"
printf '< open pve0 >< rawmode >' >&3
while read -r -d '>' message <&3; do
  case $message in
    *'frame 720 '*) heard=boot-up ;;
    *'frame 0A0 '*) heard=$heard,emcy ;;
  esac
  [ "$heard" != boot-up,emcy,emcy ] || printf '< send 77F 0 >' >&3
done
"#;

#[cfg(target_os = "linux")]
#[test]
fn time_begins_when_the_program_listens_and_its_folder_is_that_of_the_plan() {
    let files = Files::new();
    files.write("listener.sh", LISTENER);
    // The valve itself notices the low supply. The program may take a minute of the wall clock.
    let plan = with_program("[\"bash\", \"listener.sh\", \"{bus}\", \"{speed}\"]").replace("2200", "700000");
    let plan = plan.replace("within_ms = 2100", "for_ms = 1, within_ms = 2100");
    files.write("listens.toml", &(plan + "detected = { expect = \"77F#\", within_ms = 600000 }\n"));
    let ended = output(&["campaign", &files.text("listens.toml"), "--cell", "0"]);
    let told = String::from_utf8(ended.stdout).expect("text");
    assert!(
        told.contains(": safe at 20.000 ms, detected after ") && told.ends_with(", safe after 2000.000 ms\n"),
        "{told}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_proof_that_holds_without_the_fault_and_with_the_program_proves_nothing() {
    let files = Files::new();
    // The program does not start the valve; the scenario does.
    files.write("idle.sh", &LISTENER.replace("heard=$heard,emcy", ":"));
    let plan = with_program("[\"bash\", \"idle.sh\", \"{bus}\"]").replace("ms = 20", "ms = 500");
    files.write("idle.toml", &(plan + "detected = { expect = { nmt = \"pre-operational\" }, within_ms = 10 }\n"));
    let ended = output(&["campaign", &files.text("idle.toml"), "--cell", "0"]);
    let told = String::from_utf8(ended.stdout).expect("text");
    let reason = "\n-- detected: the proof holds without a fault, at 500 ms (seed 1), and so proves nothing\n";
    assert!(told.contains(reason) && told.contains(": not-injected at 500.000 ms"), "{told}");
}

#[cfg(target_os = "linux")]
#[test]
fn programs_end_with_an_interrupted_campaign() {
    let files = Files::new();
    let script = "[\"sh\", \"-c\", \"sleep 1000 & echo $! > pid; mv pid child; wait\"]";
    files.write("long.toml", &with_program(script).replace("speed = 10", "speed = 0.001"));
    for (arguments, line) in
        [(&["--jobs", "1"], ": interrupted; the complete rows are in "), (&["--cell", "0"], ": interrupted\n")]
    {
        let words = [&["campaign", "long.toml"][..], arguments].concat();
        let (process, _watch) = spawn(pve_sim(&words).current_dir(files.0.path()));
        while !files.path("child").exists() {
            thread::yield_now();
        }
        kill_process(Pid::from_child(&process), Signal::INT).expect("it still runs");
        let ended = process.wait_with_output().expect("its end");
        assert_eq!(ended.status.code(), Some(1));
        assert!(String::from_utf8_lossy(&ended.stderr).contains(line), "{ended:?}");
        let stat = format!("/proc/{}/stat", files.read("child").trim());
        while fs::read_to_string(&stat).is_ok_and(|stat| !stat.contains(") Z ")) {
            thread::yield_now();
        }
        fs::remove_file(files.path("child")).expect("a file");
    }
}

/// A master that stops its valve when the spool is beyond 50 %, unless the answers are lost.
const RUNAWAY: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
reactions = [{ on = "1A0#0F00 ??2?", from_ms = 50, send = "000#0220" }, { on = "1A0#0F00 ??3?", send = "000#0220" }]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "000#0120" },
  { send = "220#0F00 0010", every_ms = 50, expect = { dsm = "active", position = 4096 } },
]
"#;

const PAIR: &str = r#"
scenario = "runaway.toml"
faults = [{ corrupt = "220", data = { toggle = "000000 20" } }, { lose = "1A0" }]
instants = { from_ms = 300, to_ms = 450, step_ms = 10 }
safe = { expect = { position = { min = -5000, max = 5000 } }, within_ms = 250 }
observe_ms = 400
"#;

impl Files {
    /// Searches until the first find and a signal. Returns stdout and stderr.
    fn explore(&self, jobs: &str) -> (String, String) {
        let mut command = pve_sim(&["campaign", "pair.toml", "--explore", "3600", "--seed", "1", "--jobs", jobs]);
        let (mut process, _watch) = spawn(command.current_dir(self.0.path()));
        let mut stdout = BufReader::new(process.stdout.take().expect("stdout"));
        let mut told = String::new();
        while !told.contains("pve-sim scenario ") && stdout.read_line(&mut told).expect("text") > 0 {}
        kill_process(Pid::from_child(&process), Signal::INT).expect("it still runs");
        stdout.read_to_string(&mut told).expect("text");
        let ended = process.wait_with_output().expect("its end");
        assert_eq!(ended.status.code(), Some(1), "{told}");
        (told, String::from_utf8(ended.stderr).expect("text"))
    }
}

#[test]
fn a_search_finds_a_pair_and_writes_its_scenario() {
    let files = Files::new();
    files.write("runaway.toml", RUNAWAY);
    files.write("pair.toml", PAIR);
    let (told, errors) = files.explore("1");
    assert_eq!(errors, "");
    assert!(told.starts_with("FIND not-safe: ") && told.ends_with(" until the signal\n"), "{told}");
    let first = files.read("pair.find-1.toml");
    let failed = end_of(pve_sim(&["scenario", "pair.find-1.toml", "--seed", "1"]).current_dir(files.0.path()));
    assert_eq!(failed.status.code(), Some(1), "{told}");
    assert!(told.contains("\n       pve-sim scenario pair.find-1.toml --seed 1\n"), "{told}");

    // No file is replaced, and the number of threads changes nothing.
    let finds = told.matches("FIND ").count();
    let (again, _) = files.explore("3");
    assert_eq!(files.read("pair.find-1.toml"), first);
    assert_eq!(files.read(&format!("pair.find-{}.toml", finds + 1)), first);
    assert_eq!(again.lines().next(), told.lines().next());
}

#[test]
fn a_search_that_finds_nothing_is_exit_0_and_needs_a_plan_without_a_program() {
    let files = Files::new();
    files.write("runaway.toml", RUNAWAY);
    let corrupt = "{ corrupt = \"220\", data = { toggle = \"000000 20\" } }";
    files.write("one.toml", &PAIR.replace(&format!("{corrupt}, "), ""));
    files.write("pair.toml", &PAIR.replace(corrupt, "{ plant = { temperature_c = 30 } }"));
    let (code, told, errors) = files.run(&["pair.toml", "--explore", "1"]);
    assert_eq!((code, errors.as_str()), (Some(0), ""), "{told}");
    assert!(told.ends_with("\n0 finds\n"), "{told}");

    let line = refusal(&["campaign", &files.text("one.toml"), "--explore", "1"], 2);
    assert!(line.contains("--explore: the plan has no two faults that can act together"), "{line}");
    files.write("program.toml", &with_program("[\"true\"]"));
    let (plan, program) = (files.text("pair.toml"), files.text("program.toml"));
    let line = refusal(&["campaign", &program, "--explore", "1"], 2);
    assert!(line.contains("--explore: the controller of the plan is a program"), "{line}");
    let line = refusal(&["campaign", &plan, "--explore", "1", "--finds", &files.text("away")], 2);
    assert!(line.contains("away: no such folder"), "{line}");
    for option in ["--shard=1/2", "--resume", "--no-fork", "--cell=1", "--list", "--html=x", "--results=x"] {
        refusal(&["campaign", &plan, "--explore", "1", option], 2);
    }
    refusal(&["campaign", &plan, "--explore", "0"], 2);
    refusal(&["campaign", &plan, "--finds", "."], 2);
}

/// Returns whether a process handles SIGINT.
#[cfg(target_os = "linux")]
fn handles_interrupts(id: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{id}/status")).expect("a process");
    let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).expect("a mask");
    u64::from_str_radix(mask.trim(), 16).expect("hex") & 1 << (Signal::INT.as_raw() - 1) != 0
}

#[cfg(target_os = "linux")]
#[test]
fn an_interrupted_search_without_a_find_has_not_passed() {
    let files = Files::new();
    files.write("runaway.toml", RUNAWAY);
    files.write(
        "pair.toml",
        &PAIR.replace("{ corrupt = \"220\", data = { toggle = \"000000 20\" } }", "{ plant = { temperature_c = 30 } }"),
    );
    let mut command = pve_sim(&["campaign", "pair.toml", "--explore", "3600"]);
    let (process, _watch) = spawn(command.current_dir(files.0.path()));
    while !handles_interrupts(process.id()) {
        thread::yield_now();
    }
    kill_process(Pid::from_child(&process), Signal::INT).expect("it still runs");
    let ended = process.wait_with_output().expect("its end");
    let told = String::from_utf8(ended.stdout).expect("text");
    assert!(told.ends_with("\n0 finds until the signal\n"), "{told}");
    assert_eq!(ended.status.code(), Some(1));
}

/// The name of a plan has at most 255 bytes, that of a find some more.
#[test]
fn a_find_that_cannot_be_written_does_not_end_the_search() {
    let files = Files::new();
    files.write("runaway.toml", RUNAWAY);
    let long = "a".repeat(250);
    files.write(&format!("{long}.toml"), PAIR);
    let (code, told, errors) = files.run(&[&format!("{long}.toml"), "--explore", "1"]);
    assert_eq!((code, errors.as_str()), (Some(1), ""), "{told}");
    let lines: Vec<&str> = told.lines().collect();
    assert!(lines[0].starts_with("FIND not-safe: "), "{told}");
    assert!(lines[1].starts_with(&format!("       {long}.find-1.toml: File name too long")), "{told}");
    assert!(told.contains(" states reached\n") && lines.last().expect("a line").contains(" find"), "{told}");
}

/// A name with each character that a shell treats specially.
const AWKWARD: &str = "it's \"a\" $HOME `plan` \\ & ~*?!";

/// Runs a printed command in a shell, which finds the program by its name. Returns the exit code and stdout.
fn pasted(files: &Files, command: &str) -> (Option<i32>, String) {
    let program = Path::new(env!("CARGO_BIN_EXE_pve-sim"));
    let path = format!("{}:/usr/bin:/bin", program.parent().expect("a folder").display());
    let mut shell = Command::new("sh");
    shell.args(["-c", command]).env("PATH", path).current_dir(files.0.path());
    let ended = end_of(shell.stdout(Stdio::piped()).stderr(Stdio::piped()));
    assert!(ended.stderr.is_empty(), "{command}: {}", String::from_utf8_lossy(&ended.stderr));
    (ended.status.code(), String::from_utf8(ended.stdout).expect("text"))
}

#[test]
fn printed_commands_run_in_a_shell_whatever_the_name_of_the_plan() {
    let files = Files::new();
    let name = format!("{AWKWARD}.toml");
    files.write(&name, &PLAN.replace("2100", "1900"));
    let (_, told, _) = files.run(&[&name]);
    let commands: Vec<&str> = told.lines().map(str::trim).filter(|line| line.starts_with("pve-sim ")).collect();
    assert_eq!(commands.len(), 2, "{told}");
    for command in commands {
        let (code, told) = pasted(&files, command);
        assert!(code == Some(1) && told.contains(": late at "), "{command}: {told}");
    }

    files.write("runaway.toml", RUNAWAY);
    files.write(&name, PAIR);
    let (_, told, _) = files.run(&[&name, "--explore", "1"]);
    let command = told.lines().map(str::trim).find(|line| line.starts_with("pve-sim ")).expect("a find");
    let (code, told) = pasted(&files, command);
    assert!(code == Some(1) && told.contains("FAIL "), "{command}: {told}");
}

#[test]
fn outputs_never_replace_an_input_under_another_name() {
    let files = Files::new();
    assert_eq!(files.run(&["plan.toml", "--shard", "1/2", "--results", "part"]).0, Some(0));
    let part = files.read("part");
    files.write("plan", PLAN);
    let same = files.path("../").join(files.0.path().file_name().expect("a name")).join("part");
    let same = same.to_str().expect("text");
    for arguments in [
        vec!["merge", "part", "--results", "./part"],
        vec!["merge", "part", "--csv", "./part"],
        vec!["merge", "part", "--csv", same],
        vec!["merge", "part", "--csv", "new", "--json", "./new"],
        vec!["plan", "--csv", "plan"],
        vec!["plan", "--results", "new", "--html", "./new"],
    ] {
        let (code, _, errors) = files.run(&arguments);
        assert!(code == Some(2) && errors.contains("this file is given twice"), "{arguments:?} {errors}");
    }
    assert!(files.read("part") == part && files.read("plan") == PLAN && !files.path("new").exists());
}

#[test]
fn an_empty_results_file_is_resumed_and_an_empty_part_fails() {
    let files = Files::new();
    files.write("results", "");
    assert_eq!(files.run(&["plan.toml", "--resume", "--results", "results"]).0, Some(0));
    assert!(files.read("results").contains("\"row\":3"));
    let (code, told, _) = files.run(&["plan.toml", "--shard", "5/5", "--html", "empty.html"]);
    assert_eq!(code, Some(1), "{told}");
    assert!(told.starts_with("nothing was run: part 5/5 of the 4 rows is empty\n"), "{told}");
}

#[test]
fn an_instant_outside_the_plan_is_no_cell() {
    let files = Files::new();
    for cell in ["0@499999", "0@700001", "0@18446744073709551615", "4@500000", "20"] {
        let (code, _, errors) = files.run(&["plan.toml", "--cell", cell]);
        assert!(code == Some(2) && errors.contains("no such cell"), "{cell}: {errors}");
    }
    assert_eq!(files.run(&["plan.toml", "--cell", "0@511500"]).0, Some(0));
}

/// Runs a ready plan as a whole. Returns its exit code, its last line, and the faults that did not pass.
fn ready(name: &str) -> (Option<i32>, String, Vec<String>) {
    let files = Files::new();
    let plan = format!("{}/../scenarios/campaigns/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let (code, told, errors) = files.run(&[&plan]);
    assert_eq!(errors, "", "{told}");
    let failed = told.lines().filter_map(|line| line.strip_prefix("FAIL ")?.split_once(": ")).map(|(fault, _)| fault);
    let failed = failed.map(str::to_owned).collect();
    (code, told.lines().last().unwrap_or_default().to_owned(), failed)
}

#[test]
fn the_careful_master_passes_the_faults_of_its_valve() {
    assert_eq!(ready("valve-careful"), (Some(0), "1072 passed, 0 failed".to_owned(), Vec::new()));
}

#[test]
fn the_careful_master_passes_a_cranked_engine() {
    assert_eq!(ready("cranking"), (Some(0), "1694 passed, 0 failed".to_owned(), Vec::new()));
}

#[test]
fn the_careless_master_fails_by_both_mistakes() {
    let (code, last, failed) = ready("valve-careless");
    assert_eq!((code, last.as_str()), (Some(1), "691 passed, 397 failed"));
    assert!(failed.iter().all(|fault| fault == "valve"), "{failed:?}");
}

/// docs/campaigns.md names this number.
#[test]
fn the_careful_master_fails_the_errors_that_a_valve_cannot_detect() {
    let (code, last, failed) = ready("communication");
    assert_eq!((code, last.as_str()), (Some(1), "1339 passed, 300 failed"));
    // Once inserted, and every 20 ms.
    let wanted = ["corrupt 220, data toggle 00000040", "swap 220 within 1000 ms", "insert 220", "insert 220"];
    assert_eq!(failed, wanted);
}
