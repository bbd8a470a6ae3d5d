//! State files and logs: kept, refused, and never replaced.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;

use rustix::process::Signal;

use super::simulator::*;

#[test]
fn files_that_cannot_be_opened_are_exit_1_and_named() {
    let bus = ["--bus", "socketcand://127.0.0.1:0/pve0"];
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join("nowhere/frames.log");
    let log = log.to_str().expect("text");
    let text = refusal(&[&bus[..], &["--log", log]].concat(), 1);
    assert!(text.contains(log), "{text}");
    let file = dir.path().join("file");
    fs::write(&file, "").expect("a file");
    let file = file.to_str().expect("text");
    let text = refusal(&[&bus[..], &["--state", file]].concat(), 1);
    assert!(text.contains(file), "{text}");
}

#[test]
fn a_state_file_of_another_kind_is_exit_1_and_not_touched() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=valve"]).end(Signal::TERM);
    let file = dir.path().join("valve.nvm");
    let before = fs::read(&file).expect("a state file");
    let bus = "socketcand://127.0.0.1:0/pve0";
    let text = refusal(&["--bus", bus, "--state", state, "--device", "pveo-canopen,name=valve"], 1);
    assert!(text.contains("valve.nvm: holds the memory of a pvea-canopen, not of a pveo-canopen"), "{text}");
    assert!(fs::read(&file).expect("a state file") == before, "not touched");
}

/// The state of a sensor is kept, and belongs to its kind; its first bit rate is in it.
#[test]
fn a_sensor_has_a_state_file() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let sensor = |kind: &str| Simulator::serve(&["--state", state, "--device", kind]);
    sensor("hat1000@5,name=angle,bit-rate=125k").end(Signal::TERM);
    let mut second = sensor("hat1000,name=angle");
    // A request before the boot-up has no answer.
    while !second.line().contains("boot-up") {}
    let mut client = second.join();
    for (index, answer) in [("1", "5"), ("2", "4")] {
        say(&mut client, &format!("< send 605 8 40 {index} 20 1 0 0 0 0 >"));
        await_frame(&mut client, &format!("585#4F0{index}20010{answer}000000"));
    }
    second.end(Signal::TERM);
    let bus = "socketcand://127.0.0.1:0/pve0";
    let text = refusal(&["--bus", bus, "--state", state, "--device", "hat3000,name=angle"], 1);
    assert!(text.contains("angle.nvm: holds the memory of a hat1000, not of a hat3000"), "{text}");
}

#[test]
fn a_state_file_has_one_simulator() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let two = ["--device", "pvea-canopen@5,name=boom", "--device", "pvea-canopen@6,name=arm"];
    let second = [&["--bus", "socketcand://127.0.0.1:0/pve0", "--state", state][..], &two].concat();
    // With a new file, and with an existing one.
    for _ in 0..2 {
        let first = Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=arm"]);
        // A new valve writes its factory record first; a save is written afterwards.
        let mut client = first.join();
        say(&mut client, "< send 620 8 22 10 10 1 73 61 76 65 >");
        await_frame(&mut client, "5A0#6010100100000000");
        let file = dir.path().join("arm.nvm");
        let before = fs::read(&file).expect("a state file");
        let text = refusal(&second, 1);
        assert_eq!(text, format!("pve-sim: {} is in use by another pve-sim", file.display()));
        assert!(fs::read(&file).expect("a state file") == before, "not touched");
        assert!(!dir.path().join("boom.nvm").exists(), "not even what it could have had");
        // Another name is another file.
        Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=boom"]).end(Signal::TERM);
        fs::remove_file(dir.path().join("boom.nvm")).expect("a state file");
        // Any end of the process ends the lock.
        drop(first);
    }
    Simulator::serve(&[&["--state", state][..], &two].concat()).end(Signal::TERM);
}

#[test]
fn a_state_file_that_cannot_be_read_is_exit_1_and_not_touched() {
    let dir = tempfile::tempdir().expect("a folder");
    let (state, file) = (dir.path().to_str().expect("text"), dir.path().join("valve.nvm"));
    let refused = |why: &str| {
        let bus = "socketcand://127.0.0.1:0/pve0";
        let text = refusal(&["--bus", bus, "--state", state, "--device", "pvea-canopen,name=valve"], 1);
        assert!(text.contains("valve.nvm: cannot") && text.contains(why), "{text}");
    };
    fs::create_dir(&file).expect("a folder");
    refused("not a file");
    fs::remove_dir(&file).expect("still there, and empty");

    let nowhere = dir.path().join("nowhere");
    std::os::unix::fs::symlink(&nowhere, &file).expect("a link");
    refused("resolve the link");
    assert!(!nowhere.exists());
    assert_eq!(fs::read_link(&file).expect("still a link"), nowhere);
    fs::remove_file(&file).expect("a link");

    fs::write(&file, "of somebody else").expect("a file");
    fs::set_permissions(&file, fs::Permissions::from_mode(0o000)).expect("permissions");
    if fs::File::open(&file).is_err() {
        refused("read");
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).expect("permissions");
        assert_eq!(fs::read_to_string(&file).expect("a file"), "of somebody else");
    } else {
        // Root reads everything: the file is damaged, and kept.
        Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=valve"]).end(Signal::TERM);
        let aside = dir.path().join("valve.nvm.bad");
        assert_eq!(fs::read_to_string(aside).expect("a file"), "of somebody else");
    }
}

#[test]
fn a_damaged_state_file_is_one_warning() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let start = || Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=valve"]);
    start().end(Signal::TERM);
    let file = dir.path().join("valve.nvm");
    let good = fs::read(&file).expect("a state file");
    let contents = [b"noise".to_vec(), Vec::new(), good[..good.len() / 2].to_vec(), [&good[..], b"more"].concat()];
    for (number, content) in contents.iter().enumerate() {
        fs::write(&file, content).expect("a file");
        let (_, stderr) = start().end(Signal::TERM);
        let warnings: Vec<&str> = stderr.lines().filter(|line| line.contains("valve.nvm")).collect();
        assert_eq!(warnings.len(), 1, "{stderr}");
        assert!(warnings[0].starts_with("pve-sim: ") && warnings[0].contains("valve.nvm is damaged"), "{stderr}");
        let (_, stderr) = start().end(Signal::TERM);
        assert!(!stderr.contains("damaged"), "told once: {stderr}");
        // Earlier files put aside stay as they are.
        for (earlier, content) in contents[..=number].iter().enumerate() {
            let ending = if earlier == 0 { "bad".to_owned() } else { format!("bad.{}", earlier + 1) };
            let aside = dir.path().join(format!("valve.nvm.{ending}"));
            assert!(fs::read(aside).expect("what was put aside") == *content, "{ending}");
        }
    }
}

#[test]
fn a_log_replaces_nothing_that_is_not_meant() {
    let dir = tempfile::tempdir().expect("a folder");
    let (state, log) = (dir.path().join("state"), dir.path().join("frames.log"));
    let state_name = state.to_str().expect("text");
    let refused = |path: &Path, more: &[&str], why: &str| {
        let bus = "socketcand://127.0.0.1:0/pve0";
        let path = path.to_str().expect("text");
        let text = refusal(&[&["--bus", bus, "--state", state_name, "--log", path], more].concat(), 1);
        assert!(text.contains(path) && text.contains(why), "{text}");
    };
    fs::write(&log, "of yesterday").expect("a file");
    refused(&log, &[], "--log-overwrite");
    refused(Path::new("/dev/null"), &["--log-overwrite"], "regular file");
    let pipe = dir.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
    refused(&pipe, &[], "regular file");
    refused(&state.join("frames.log"), &[], "--state");
    assert!(!state.exists(), "nothing is made for a log that is refused");
    assert_eq!(fs::read_to_string(&log).expect("the log"), "of yesterday");

    let overwrite = ["--state", state_name, "--log", log.to_str().expect("text"), "--log-overwrite"];
    let simulator = Simulator::serve(&overwrite);
    let mut client = simulator.join();
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    simulator.end(Signal::TERM);
    assert!(fs::read_to_string(&log).expect("the log").starts_with('('));
    refused(&state.join("pvea-canopen.nvm"), &["--log-overwrite"], "--state");
}

/// As in `pve-sim --log frames.log > frames.log`.
#[test]
fn a_log_is_not_a_file_of_stdout_or_stderr() {
    let dir = tempfile::tempdir().expect("a folder");
    let (log, link) = (dir.path().join("frames.log"), dir.path().join("link.log"));
    std::os::unix::fs::symlink(&log, &link).expect("a link");
    for path in [&log, &link] {
        let file = fs::File::create(&log).expect("a file");
        let bus = "socketcand://127.0.0.1:0/pve0";
        let path = path.to_str().expect("text");
        let arguments = ["--no-http", "--bus", bus, "--log", path, "--log-overwrite"];
        let refused = end_of(pve_sim(&arguments).stdout(file.try_clone().expect("a descriptor")));
        let line = format!("pve-sim: {path}: a log must not be the file of stdout or stderr\n");
        assert_eq!(String::from_utf8(refused.stderr).expect("text"), line);
        assert_eq!(refused.status.code(), Some(1));
        assert_eq!(fs::read(&log).expect("a file"), b"");
        let refused = end_of(pve_sim(&arguments).stderr(file));
        assert_eq!((refused.status.code(), refused.stdout), (Some(1), Vec::new()));
        assert_eq!(fs::read_to_string(&log).expect("a file"), line);
    }
}

#[test]
fn what_was_stored_is_there_the_next_time() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let node = |folder: &Path| folder.join("pvea-canopen.nvm").exists();
    let simulator = Simulator::serve(&["--state", state]);
    let mut client = simulator.join();
    say(&mut client, "< send 7e5 8 4 1 0 0 0 0 0 0 >< send 7e5 8 11 17 0 0 0 0 0 0 >< send 7e5 8 17 0 0 0 0 0 0 0 >");
    await_frame(&mut client, "7E4#1700000000000000");
    simulator.end(Signal::TERM);
    assert!(node(dir.path()));
    // The memory decides, not the option.
    let simulator = Simulator::serve(&["--state", state, "--device", "pvea-canopen@5"]);
    let mut client = simulator.join();
    say(&mut client, "< send 617 8 40 18 10 1 0 0 0 0 >");
    await_frame(&mut client, "597#4318100119000001");
}
