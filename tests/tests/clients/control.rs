//! The scripts that break valves over the control interface, in stepped time: every run is the same.

use std::process::Command;

use crate::programs::output;
use crate::simulator::{Simulator, python, root};

const OPTIONS: [&str; 8] = [
    "--http",
    "127.0.0.1:0",
    "--speed",
    "step",
    "--device",
    "pvea-canopen@0x20,name=boom",
    "--device",
    "pvea-isobus@0x80,name=arm",
];

/// Runs a script of `examples/` twice against one simulator; returns what it printed each time.
fn printed(command: &mut Command, script: &str) -> String {
    let simulator = Simulator::start(&OPTIONS);
    command.arg(root().join("examples").join(script)).arg(simulator.http());
    let mut run = || {
        let run = output(command);
        let stderr = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.success(), "{script}: {}\n{stderr}\n{}", run.status, simulator.said());
        String::from_utf8(run.stdout).expect("text")
    };
    let first = run();
    assert_eq!(run(), first);
    simulator.terminate();
    first
}

/// The description in OpenAPI says what is accepted and answered, and all of it.
#[test]
fn schemathesis_finds_nothing() {
    let devices = ["--device", "pvea-canopen@0x20,name=boom", "--device", "hat1000,bit-rate=250k,name=angle"];
    let simulator = Simulator::start(&[&["--http", "127.0.0.1:0", "--speed", "step"], &devices[..]].concat());
    let printed = simulator.serve("openapi.py", &[simulator.http()]);
    assert!(printed.contains(" passed") && printed.contains("Operations:       18 selected"), "{printed}");
    simulator.terminate();
}

#[test]
fn every_fault_on_both_protocols_with_curl_alone() {
    let printed = printed(&mut Command::new("sh"), "faults.sh");
    assert_eq!(printed.lines().count(), 18, "{printed}");
}

#[test]
fn every_fault_on_both_protocols_with_python_alone() {
    let printed = printed(&mut Command::new(python()), "faults.py");
    assert_eq!(printed.lines().count(), 18, "{printed}");
    assert!(printed.contains("arm: supply-low after 2000 ms\n"), "{printed}");
}
