//! Truncated output: by a full disk, by the file size limit, by another run; and by a reader that has seen enough.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use super::simulator::*;

/// Returns every command that ends by itself, with its output.
fn commands(dir: &Path) -> Vec<Vec<String>> {
    let text = |name: &str| dir.join(name).to_str().expect("text").to_owned();
    fs::write(text("frames.log"), "(1.000000) can0 720#00\n(1.500000) can0 720#7F\n").expect("a log");
    let scenario = "devices = [\"pvea-canopen@0x20\"]\n\n[[steps]]\nexpect = \"720#00\"\nwithin_ms = 500\n";
    fs::write(text("rest.toml"), scenario).expect("a scenario");
    let commands = [
        &["--help"][..],
        &["--version"],
        &["help", "replay"],
        &["run", "--help"],
        &["use-case"],
        &["use-case", "1"],
        &["use-case", "hat"],
        &["eds", "pvea-canopen"],
        &["dbc", "pvea-isobus"],
        &["completions", "bash"],
        &["man"],
    ];
    let mut commands: Vec<Vec<String>> =
        commands.iter().map(|words| words.iter().map(|word| (*word).to_owned()).collect()).collect();
    commands.push(vec!["scenario".to_owned(), text("rest.toml")]);
    commands.push(vec!["decode".to_owned(), text("frames.log")]);
    commands.push(vec!["replay".to_owned(), text("frames.log"), "--device".to_owned(), "pvea-canopen".to_owned()]);
    commands
}

fn words(command: &[String]) -> Vec<&str> {
    command.iter().map(String::as_str).collect()
}

/// Returns the exit code and stderr of a command with this stdout.
fn told(command: &mut Command, stdout: impl Into<Stdio>) -> (Option<i32>, String) {
    let output = end_of(command.stdout(stdout));
    (output.status.code(), String::from_utf8(output.stderr).expect("text"))
}

#[cfg(target_os = "linux")]
#[test]
fn every_command_tells_of_a_full_disk() {
    let dir = tempfile::tempdir().expect("a folder");
    for command in commands(dir.path()) {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("a full disk");
        let line = "pve-sim: stdout: No space left on device (os error 28)\n".to_owned();
        assert_eq!(told(&mut pve_sim(&words(&command)), full), (Some(1), line), "{command:?}");
    }
    let junit = dir.path().join("rest.toml");
    let arguments = ["scenario", junit.to_str().expect("text"), "--junit", "/dev/full"];
    let line = "pve-sim: --junit /dev/full: No space left on device (os error 28)\n".to_owned();
    assert_eq!(told(&mut pve_sim(&arguments), Stdio::piped()), (Some(1), line));
}

/// As in `pve-sim eds pvea-canopen | head`.
#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    let dir = tempfile::tempdir().expect("a folder");
    for command in commands(dir.path()) {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let is_same = told(&mut pve_sim(&words(&command)), Stdio::null());
        assert_eq!(told(&mut pve_sim(&words(&command)), writer), is_same, "{command:?}");
        assert_eq!(is_same.1, "");
    }
}

/// Returns a shell that limits files to some hundred bytes, and becomes `pve-sim`.
fn limited(arguments: &[&str]) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -f 1; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_pve-sim")]).args(arguments);
    shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    shell
}

/// The system would otherwise end it by a signal.
#[test]
fn the_largest_file_size_is_told() {
    let dir = tempfile::tempdir().expect("a folder");
    let sheet = fs::File::create(dir.path().join("sheet.eds")).expect("a file");
    let line = "pve-sim: stdout: File too large (os error 27)\n".to_owned();
    assert_eq!(told(&mut limited(&["eds", "pvea-canopen"]), sheet), (Some(1), line));
}

/// The run continues for its clients, and fails at the end. The log ends with a whole frame.
#[test]
fn a_log_that_is_cut_is_exit_1() {
    let dir = tempfile::tempdir().expect("a folder");
    for name in ["frames.log", "frames.asc", "frames.pcapng"] {
        let path = dir.path().join(name);
        let path = path.to_str().expect("text");
        let bus = "socketcand://127.0.0.1:0/pve0";
        let mut simulator = Simulator::spawn(&mut limited(&["--no-http", "--bus", bus, "--log", path]));
        let mut client = simulator.join();
        for _ in 0..100 {
            say(&mut client, READ_VENDOR);
            await_frame(&mut client, VENDOR);
        }
        kill_process(Pid::from_child(&simulator.process), Signal::TERM).expect("it still runs");
        let stderr = std::io::read_to_string(simulator.process.stderr.take().expect("a pipe")).expect("text");
        assert_eq!(simulator.process.wait().expect("it ends").code(), Some(1), "{name}: {stderr}");
        let lines: Vec<&str> = stderr.lines().filter(|line| line.contains(name)).collect();
        assert_eq!(lines, [format!("pve-sim: {path}: File too large (os error 27); logging has stopped")]);
        // It ends with a whole frame.
        let log = fs::read(path).expect("a log");
        assert!(name == "frames.pcapng" || log.ends_with(b"\n"), "{}", String::from_utf8_lossy(&log));
        let decoded = output(&["decode", path]);
        assert_eq!((decoded.status.code(), String::from_utf8_lossy(&decoded.stderr).as_ref()), (Some(0), ""), "{name}");
        let frames = String::from_utf8(decoded.stdout).expect("text").lines().count();
        assert!((3..100).contains(&frames), "{name}: {frames} frames");
    }
}

/// The trace is output, too.
#[cfg(target_os = "linux")]
#[test]
fn a_trace_that_is_cut_is_exit_1() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let full = fs::OpenOptions::new().write(true).open("/dev/full").expect("a full disk");
    let arguments = ["--no-http", "--bus", "socketcand://127.0.0.1:0/pve0", "--state", state];
    let (mut process, _watch) = spawn(pve_sim(&arguments).stdout(full));
    let mut stderr = std::io::BufReader::new(process.stderr.take().expect("a pipe"));
    let mut line = String::new();
    std::io::BufRead::read_line(&mut stderr, &mut line).expect("text");
    assert_eq!(line, "pve-sim: stdout: No space left on device (os error 28); the trace has stopped\n");
    kill_process(Pid::from_child(&process), Signal::TERM).expect("it still runs");
    assert_eq!(process.wait().expect("it ends").code(), Some(1));
}

/// Records pending at the end cannot be stored: the folder is gone.
#[test]
fn a_memory_that_is_not_kept_at_the_end_is_exit_1() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().join("state");
    let mut simulator = Simulator::serve(&["--state", state.to_str().expect("text")]);
    let mut client = simulator.join();
    say(&mut client, "< send 0 2 1 0 >");
    for _ in 0..3 {
        say(&mut client, "< send 220 4 f 0 0 0 >");
    }
    // No further set-point: time guarding, for the fault log.
    await_frame(&mut client, "0A0#0380910100000000");
    fs::remove_dir_all(&state).expect("a folder");
    kill_process(Pid::from_child(&simulator.process), Signal::TERM).expect("it still runs");
    let stderr = std::io::read_to_string(simulator.process.stderr.take().expect("a pipe")).expect("text");
    assert_eq!(simulator.process.wait().expect("it ends").code(), Some(1), "{stderr}");
    assert!(stderr.contains("pvea-canopen.nvm: cannot write: "), "{stderr}");
}

#[test]
fn a_log_has_one_writer() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("text").to_owned();
    let first = Simulator::serve(&["--log", &path("frames.log")]);
    std::os::unix::fs::symlink(path("frames.log"), path("link.log")).expect("a link");
    let bus = ["--bus", "socketcand://127.0.0.1:0/pve0"];
    for name in ["frames.log", "link.log"] {
        for overwrite in [&[][..], &["--log-overwrite"]] {
            let state = path("state");
            let log = path(name);
            let line = refusal(&[&bus[..], &["--state", &state, "--log", &log], overwrite].concat(), 1);
            assert_eq!(line, format!("pve-sim: {log}: another pve-sim is writing to this log"));
            assert!(!Path::new(&state).exists(), "nothing is made");
        }
    }
    first.end(Signal::TERM);
    assert!(fs::read_to_string(path("frames.log")).expect("a log").contains("720#00"));
    Simulator::serve(&["--log", &path("frames.log"), "--log-overwrite"]).end(Signal::TERM);
}
