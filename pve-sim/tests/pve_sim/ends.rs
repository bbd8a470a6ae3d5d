//! The ends of a run: signals, a closed stdout, and stored records.

#[cfg(target_os = "linux")]
use std::net::TcpListener;
use std::process::{Command, Stdio};

#[cfg(target_os = "linux")]
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, Signal, kill_process};

use super::simulator::*;

/// As in `pve-sim
/// head`, with an idle bus.
#[test]
fn a_closed_stdout_ends_it() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    for speed in ["0.0001", "1", "1e9"] {
        let mut simulator = Simulator::serve(&["--state", state, "--speed", speed]);
        drop(simulator.stdout.take());
        assert_eq!(simulator.process.wait().expect("it ends").code(), Some(0), "{speed}");
    }
    assert!(dir.path().join("pvea-canopen.nvm").exists());
}

#[test]
fn a_signal_ends_it_at_any_speed_and_while_devices_start() {
    for speed in ["0.000001", "1", "1e12"] {
        for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
            Simulator::serve(&["--speed", speed]).end(signal);
        }
    }
}

/// Returns a full pipe without a reader.
#[cfg(target_os = "linux")]
fn full_pipe() -> (std::io::PipeReader, std::io::PipeWriter) {
    use std::io::Write as _;

    let (reader, mut writer) = std::io::pipe().expect("a pipe");
    let full = rustix::pipe::fcntl_getpipe_size(&writer).expect("a size");
    writer.write_all(&vec![b'x'; full]).expect("room");
    (reader, writer)
}

/// Even the hint is blocked, and the trace behind it: stdout is incomplete.
#[cfg(target_os = "linux")]
#[test]
fn a_stderr_that_nobody_reads_does_not_hold_it_up() {
    let (reader, writer) = full_pipe();
    let arguments = ["--no-http", "--bus", "socketcand://127.0.0.1:0/pve0"];
    let mut simulator = Simulator::spawn(pve_sim(&arguments).stderr(writer));
    let mut client = simulator.join();
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    kill_process(Pid::from_child(&simulator.process), Signal::TERM).expect("it still runs");
    assert_eq!(simulator.process.wait().expect("it ends").code(), Some(1));
    drop(reader);
}

/// The line about the port in use is blocked.
#[cfg(target_os = "linux")]
#[test]
fn a_refusal_that_nobody_reads_does_not_hold_up_its_end() {
    let (reader, writer) = full_pipe();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("its address").to_string();
    for (arguments, code) in [(["--http", &address], 1), (["--speed", "none"], 2)] {
        let mut command = pve_sim(&[&arguments[..], &["--bus", "socketcand://127.0.0.1:0/pve0"]].concat());
        let (mut process, _watch) = spawn(command.stderr(writer.try_clone().expect("a descriptor")));
        let stdout = process.stdout.take().expect("a pipe");
        let patience = Timespec::try_from(PATIENCE).expect("a time");
        // The end of the process closes stdout.
        let ended = poll(&mut [PollFd::new(&stdout, PollFlags::IN)], Some(&patience)).expect("a pipe");
        let _ = process.kill();
        let status = process.wait().expect("it ends");
        assert_eq!((ended, status.code()), (1, Some(code)), "{arguments:?}");
    }
    drop(reader);
}

/// The remedy for the first port does not lead to a conflict on the second one.
#[test]
fn a_second_simulator_is_told_both_ports_that_are_in_use() {
    let first = Simulator::serve(&["--http", "127.0.0.1:0"]);
    let (bus, http) = (format!("socketcand://127.0.0.1:{}/pve0", first.ports()[0]), first.http());
    let told = refusal(&["--bus", &bus, "--http", http], 1);
    assert!(told.contains("--bus socketcand://127.0.0.1:0/pve0 selects a free port"), "{told}");
    assert!(told.ends_with(&format!("; {http} is also in use: --http 127.0.0.1:0 selects a free port")), "{told}");
    let told = refusal(&["--bus", &bus, "--http", "127.0.0.1:0"], 1);
    assert!(told.ends_with("selects a free port"), "{told}");
}

const UNREAD: &str = "pve-sim: stdout was not read in time: the end of the trace is missing\n";

/// Even the ready line is blocked.
#[cfg(target_os = "linux")]
#[test]
fn a_signal_ends_it_while_its_ready_line_waits_for_a_reader() {
    let (reader, writer) = full_pipe();
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join("frames.log");
    let arguments = ["--no-http", "--bus", "socketcand://127.0.0.1:0/pve0", "--log", log.to_str().expect("text")];
    let (mut process, _watch) = spawn(pve_sim(&arguments).stdout(writer));
    // The devices start after the ready line.
    while !std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
        assert_eq!(process.try_wait().expect("a process"), None);
        std::thread::yield_now();
    }
    kill_process(Pid::from_child(&process), Signal::TERM).expect("it still runs");
    let output = process.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).expect("text").ends_with(UNREAD), "the cause is told");
    drop(reader);
}

/// A valve writes its fault log some time after the fault: at the end of the run, at once.
#[test]
fn what_waits_to_be_stored_is_stored_at_the_end() {
    let dir = tempfile::tempdir().expect("a folder");
    let arguments = ["--state", dir.path().to_str().expect("text")];
    for count in 1..=2 {
        let simulator = Simulator::serve(&arguments);
        let mut client = simulator.join();
        say(&mut client, "< send 0 2 1 0 >");
        for _ in 0..3 {
            say(&mut client, "< send 220 4 f 0 0 0 >");
        }
        // No further set-point: time guarding.
        await_frame(&mut client, &format!("0A0#0380910{count}00000000"));
        simulator.end(Signal::HUP);
    }
}

#[test]
fn a_hangup_that_is_ignored_does_not_end_it() {
    let mut shell = Command::new("sh");
    let script = "trap '' HUP; exec \"$0\" --no-http --bus socketcand://127.0.0.1:0/pve0";
    shell.args(["-c", script, env!("CARGO_BIN_EXE_pve-sim")]);
    let simulator = Simulator::spawn(shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut client = simulator.join();
    kill_process(Pid::from_child(&simulator.process), Signal::HUP).expect("it runs");
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    simulator.end(Signal::TERM);
}

#[test]
fn a_stdout_that_nobody_reads_does_not_hold_it_up() {
    let mut simulator = Simulator::serve(&["--speed", "100"]);
    let unread = simulator.stdout.take();
    let mut client = simulator.join();
    // a heartbeat each 10 ms of virtual time: far more lines than a pipe takes
    say(&mut client, "< send 620 8 2b 17 10 0 a 0 0 0 >");
    for _ in 0..5000 {
        frame(&mut client);
    }
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    drop(client);
    kill_process(Pid::from_child(&simulator.process), Signal::TERM).expect("it still runs");
    let stderr = std::io::read_to_string(simulator.process.stderr.take().expect("a pipe")).expect("text");
    assert_eq!(simulator.process.wait().expect("it ends").code(), Some(1), "stdout is cut");
    assert!(stderr.ends_with(UNREAD), "{stderr}");
    drop(unread);
}
