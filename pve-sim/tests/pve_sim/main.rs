//! The program as users run it: exit codes, the ready line, clients on real sockets, signals. Reads have time limits;
//! nothing sleeps.
//!
//! Only for Unix: signals end the program.
#![cfg(unix)]

mod browser;
mod bus;
mod campaign;
mod console;
mod control;
mod cut;
mod ends;
mod files;
mod mutations;
mod options;
mod recordings;
mod remote;
mod scenario;
mod shell;
mod simulator;
mod slcan;
#[cfg(target_os = "linux")]
mod typing;
mod use_cases;

use std::fs;
use std::net::TcpListener;

use simulator::{output, refusal};

#[test]
fn wrong_usage_is_exit_2_with_one_line() {
    let text = refusal(&["--device", "pvea"], 2);
    assert!(
        text.starts_with("pve-sim: ")
            && text.contains("accepted: pvea-canopen, pveo-canopen, pvea-isobus, pveo-isobus"),
        "{text}"
    );
    for (devices, line) in [
        (&["pvex-canopen"][..], "unknown kind 'pvex-canopen'"),
        (&["pvea-canopen@0"], "'0' is not a valid node ID"),
        (&["pvea-canopen@128"], "accepted: 1–127"),
        (&["pvea-isobus@0x90"], "0x80–0x8F"),
        (&["pvea-canopen@5", "pveo-canopen@5"], "both have node ID 0x05"),
        (&["pvea-canopen@5,name=a", "pveo-canopen@6,name=a"], "duplicate device name 'a'"),
    ] {
        let dir = tempfile::tempdir().expect("a folder");
        let state = dir.path().join("state");
        let mut arguments = vec!["--bus", "socketcand://127.0.0.1:0/pve0", "--state", state.to_str().expect("text")];
        arguments.extend(devices.iter().flat_map(|device| ["--device", device]));
        let text = refusal(&arguments, 2);
        assert!(text.starts_with("pve-sim: ") && text.contains(line), "{text}");
        assert!(!state.exists(), "{text}");
    }
    refusal(&["--colour"], 2);
    refusal(&["walk"], 2);
    refusal(&["use-case", "9"], 2);
}

#[test]
fn a_port_in_use_is_exit_1_and_touches_no_file() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let url = format!("socketcand://{}/pve0", taken.local_addr().expect("its address"));
    let dir = tempfile::tempdir().expect("a folder");
    let (log, state) = (dir.path().join("frames.log"), dir.path().join("state"));
    fs::write(&log, "of the first simulator").expect("a file");
    let (log_name, state_name) = (log.to_str().expect("text"), state.to_str().expect("text"));
    let text = refusal(&["--bus", &url, "--log", log_name, "--state", state_name], 1);
    assert!(text.contains(&url), "{text}");
    assert_eq!(fs::read_to_string(&log).expect("the log"), "of the first simulator");
    assert!(!state.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn an_interface_that_is_not_there_is_exit_1() {
    let text = refusal(&["--bus", "socketcan:pve-sim-none"], 1);
    assert!(text.contains("socketcan:pve-sim-none: "), "{text}");
}

#[test]
fn the_use_cases_are_played_and_printed() {
    let output = output(&["use-case", "all"]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).expect("text");
    for name in ["1", "2", "3", "4", "5", "6", "isobus", "hat"] {
        let verdict = format!("\nok   scenarios/use-case-{name}.toml: Use case {name}: ");
        assert!(text.contains(&verdict), "{text}");
    }
    assert!(text.starts_with("-- 1. Power up the valve\n") && text.contains("  <-  720: 00  "), "{text}");
    assert!(text.ends_with("\n8 passed, 0 failed\n"), "{text}");
}

#[test]
fn help_goes_to_stdout() {
    let output = output(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8(output.stdout).expect("text").contains("--device"));
}
