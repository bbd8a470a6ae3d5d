//! `--log` in every format, `decode` and `replay`: commands read each other's files.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::Stdio;

use rustix::process::Signal;

use super::simulator::*;

/// Runs a valve with a reading client and a log; returns its trace.
fn log(path: &Path) -> String {
    let mut simulator = Simulator::serve(&["--log", path.to_str().expect("text")]);
    let booted = simulator.line();
    let mut client = simulator.join();
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    booted + &simulator.end(Signal::TERM).0
}

/// Returns the output and the exit code of a command.
fn run(arguments: &[&str]) -> (String, String, Option<i32>) {
    let output = output(arguments);
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (text(output.stdout), text(output.stderr), output.status.code())
}

#[test]
fn every_format_is_decoded_as_it_was_traced_and_replays() {
    let dir = tempfile::tempdir().expect("a folder");
    for name in ["frames.log", "frames.asc", "frames.pcapng"] {
        let path = dir.path().join(name);
        let trace = log(&path);
        let path = path.to_str().expect("text");
        assert_eq!(trace.lines().count(), 4, "{trace}");
        let (decoded, errors, code) = run(&["decode", path, "--device", "pvea-canopen@0x20"]);
        assert_eq!((errors.as_str(), code), ("", Some(0)), "{name}");
        // A log does not reveal that the gateway's client is not a master; ASC has no name of the bus.
        assert_eq!(decoded.replace(" can0 ", " pve0 "), trace, "{name}");
        let (report, errors, code) = run(&["replay", path, "--device", "pvea-canopen"]);
        assert_eq!((errors.as_str(), code), ("", Some(0)), "{name}: {report}");
        let summary = "3 frames of pvea-canopen compared within 5 ms: no differences; 1 frame of other nodes sent";
        let line = if name == "frames.asc" { 6 } else { 1 };
        assert_eq!(report, format!("{summary}; power-up not compared: pvea-canopen aligned with line {line}\n"));
    }
}

/// The content of a file determines its format.
#[test]
fn a_log_is_read_whatever_its_name_is() {
    let dir = tempfile::tempdir().expect("a folder");
    for name in ["frames.log", "frames.asc", "frames.pcapng"] {
        let path = dir.path().join(name);
        let trace = log(&path);
        let other = path.with_extension("dat");
        fs::rename(&path, &other).expect("a file");
        let (decoded, errors, code) = run(&["decode", other.to_str().expect("text")]);
        assert_eq!((errors.as_str(), code, decoded.lines().count()), ("", Some(0), trace.lines().count()), "{name}");
    }
}

#[test]
fn one_byte_that_differs_is_told() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("frames.log");
    log(&path);
    let text = fs::read_to_string(&path).expect("a log").replace("5A0#4318100119000001", "5A0#4318100119000002");
    fs::write(&path, text).expect("a log");
    let (report, errors, code) = run(&["replay", path.to_str().expect("text"), "--device", "pvea-canopen"]);
    assert_eq!((errors.as_str(), code), ("", Some(1)));
    let lines: Vec<&str> = report.lines().collect();
    assert!(lines[0].ends_with(") line 4: different data"), "{report}");
    assert!(lines[1].contains("5A0: 43 18 10 01 19 00 00 02") && lines[1].ends_with("= 0x02000019"), "{report}");
    assert!(lines[2].contains("5A0: 43 18 10 01 19 00 00 01") && lines[2].ends_with("= 0x01000019"), "{report}");
    let summary = "3 frames of pvea-canopen compared within 5 ms: 1 difference; 1 frame of other nodes sent";
    assert_eq!(lines[3], format!("{summary}; power-up not compared: pvea-canopen aligned with line 1"));
    assert_eq!(lines.len(), 4);
}

#[test]
fn a_line_that_is_none_is_named() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("frames.log");
    fs::write(&path, "(1.000000) can0 720#00\nnonsense\n(1.500000) can0 720#7F\n").expect("a log");
    let path = path.to_str().expect("text");
    let (decoded, errors, code) = run(&["decode", path]);
    assert_eq!(decoded.lines().count(), 2);
    assert!(decoded.starts_with("(1.000000) can0 720#00  node 0x20: boot-up\n"), "{decoded}");
    assert_eq!(errors, format!("pve-sim: {path}:2: not a candump line: \"nonsense\"\n"));
    assert_eq!(code, Some(1));
    let (_, errors, code) = run(&["replay", path, "--device", "pvea-canopen"]);
    assert!(errors.ends_with(":2: not a candump line: \"nonsense\"\n"), "{errors}");
    assert_eq!(code, Some(1));
}

#[test]
fn a_file_that_is_not_there_is_exit_1() {
    let dir = tempfile::tempdir().expect("a folder");
    let nowhere = dir.path().join("nowhere.log");
    for path in [&nowhere, dir.path()] {
        let path = path.to_str().expect("text");
        for line in [&["decode", path][..], &["replay", path, "--device", "pvea-canopen"]] {
            let (_, errors, code) = run(line);
            assert!(code == Some(1) && errors.starts_with(&format!("pve-sim: {path}: ")), "{errors}");
            assert_eq!(errors.lines().count(), 1, "{errors}");
        }
    }
}

/// A pipe is explained while it is written, and a reader that has seen enough ends it.
#[test]
fn a_pipe_is_explained_as_it_comes() {
    let (mut process, _watch) = spawn(pve_sim(&["decode", "-"]).stdin(Stdio::piped()));
    let mut stdin = process.stdin.take().expect("a pipe");
    let mut stdout = BufReader::new(process.stdout.take().expect("a pipe"));
    let mut line = String::new();
    for _ in 0..3 {
        line.clear();
        stdin.write_all(b" (1700000000.000000)  can0  080   [0]\n").expect("it reads");
        stdout.read_line(&mut line).expect("it answers");
        assert_eq!(line, "(1700000000.000000) can0 080#  SYNC\n");
    }
    drop(stdout);
    // An end by the reader is not reported.
    while stdin.write_all(&b"(1.0) can0 080#\n".repeat(1000)).is_ok() {}
    let mut errors = String::new();
    process.stderr.take().expect("a pipe").read_to_string(&mut errors).expect("text");
    assert_eq!((process.wait().expect("it ends").code(), errors.as_str()), (Some(0), ""));
}
