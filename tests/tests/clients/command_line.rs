//! Wrong usage as a script sees it: the exit code, one line on stderr that names what is wrong, nothing on stdout, and
//! nothing that was stored is touched. What `pve-sim/tests/pve_sim/` has is not here again.

use std::fs;
use std::process::Command;

use crate::programs::output;
use crate::simulator::PVE_SIM;

const ANY_PORT: &str = "socketcand://127.0.0.1:0/pve0";

/// Runs it with these options; it ends by itself, with this exit code and one line that has all these words.
fn refused(code: i32, options: &[&str], words: &[&str]) {
    let output = output(Command::new(&*PVE_SIM).args(options));
    let stderr = String::from_utf8(output.stderr).expect("text");
    assert_eq!(output.status.code(), Some(code), "{options:?}: {stderr}");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "", "{options:?}");
    assert_eq!(stderr.lines().count(), 1, "{options:?}: {stderr}");
    for word in words {
        assert!(stderr.contains(word), "{options:?}: {stderr}");
    }
}

#[test]
fn wrong_usage_is_exit_2() {
    for (options, words) in [
        (&["run", "--device", "pvea-canopen@0"][..], &["'0'", "1–127"][..]),
        (&["--device", "pvea-canopen@0x80"], &["0x80", "0x01–0x7F"]),
        (&["--device", "pvea-canopen@0x20", "--device", "pveo-canopen@32"], &["0x20", "--allow-clash"]),
        (&["--device", "pvea-canopen@1,name=a", "--device", "pvea-canopen@2,name=a"], &["'a'", "name="]),
        (&["--device", "pvea-canopen@1,blank"], &["blank"]),
        (&["--bus", "socketcand://127.0.0.1:0"], &["socketcand://"]),
        (&["--bit-rate", "300k"], &["250000"]),
        (&["--speed", "0"], &["above 0"]),
    ] {
        refused(2, options, words);
    }
}

#[test]
fn an_address_of_another_machine_is_exit_1() {
    let url = "socketcand://192.0.2.1:29536/pve0";
    refused(1, &["--no-http", "--bus", url], &[url]);
}

/// Each device of a bus has its own file: one that is wrong refuses them all, and none is written.
#[test]
fn a_state_file_that_cannot_be_used_is_exit_1() {
    let folder = tempfile::tempdir().expect("a folder");
    let state = folder.path().to_str().expect("text");
    let simulator = crate::Simulator::start(&["--state", state, "--device", "pveo-canopen,name=wrong"]);
    simulator.terminate();
    let wrong = folder.path().join("wrong.nvm");
    let before = fs::read(&wrong).expect("a state file");
    let options = ["--no-http", "--bus", ANY_PORT, "--state", state];
    let devices = ["--device", "pvea-canopen@1,name=right", "--device", "pvea-canopen@2,name=wrong"];
    refused(1, &[&options[..], &devices[..]].concat(), &["wrong.nvm", "pveo-canopen", "pvea-canopen"]);
    assert_eq!(fs::read(&wrong).expect("a state file"), before);
    assert!(!folder.path().join("right.nvm").exists());

    // one that cannot be read is never taken for one that is not there
    let unreadable = folder.path().join("folder.nvm");
    fs::create_dir(&unreadable).expect("a folder in the way");
    refused(1, &[&options[..], &["--device", "pvea-canopen@1,name=folder"]].concat(), &["folder.nvm"]);
    assert_eq!(fs::read_dir(&unreadable).expect("it is still there").count(), 0);
}
