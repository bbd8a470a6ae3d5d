//! The program as users run it: exit codes, the ready line, clients on real sockets, signals. Times are bounded by reads
//! that give up, nothing sleeps.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// How long anything may take that should come at once.
const PATIENCE: Duration = Duration::from_secs(20);

fn pve_sim(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pve-sim"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn output(arguments: &[&str]) -> Output {
    pve_sim(arguments).output().expect("pve-sim runs")
}

/// The one line with which it refuses to start.
fn refusal(arguments: &[&str], code: i32) -> String {
    // One that does start does not end by itself, but says that it is ready.
    let mut simulator = Simulator::start(arguments);
    assert_eq!(simulator.ready, "", "{arguments:?}");
    let mut stderr = String::new();
    simulator.process.stderr.take().expect("a pipe").read_to_string(&mut stderr).expect("text");
    let status = simulator.process.wait().expect("it ends");
    assert_eq!(status.code(), Some(code), "{arguments:?}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "{arguments:?}: {stderr}");
    stderr.trim_end().to_owned()
}

/// A simulator that is running.
struct Simulator {
    process: Child,
    stdout: Option<BufReader<ChildStdout>>,
    ready: String,
}

impl Simulator {
    fn start(arguments: &[&str]) -> Self {
        Self::spawn(&mut pve_sim(arguments))
    }

    fn spawn(command: &mut Command) -> Self {
        let mut process = command.spawn().expect("pve-sim starts");
        let mut stdout = BufReader::new(process.stdout.take().expect("a pipe"));
        let mut ready = String::new();
        stdout.read_line(&mut ready).expect("the ready line");
        Self { process, stdout: Some(stdout), ready: ready.trim_end().to_owned() }
    }

    fn serve(arguments: &[&str]) -> Self {
        Self::start(&[&["--bus", "socketcand://127.0.0.1:0/pve0"], arguments].concat())
    }

    /// The next line of its trace.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.stdout.as_mut().expect("a pipe").read_line(&mut line).expect("a line");
        assert!(!line.is_empty(), "it has ended");
        line
    }

    /// The ports of the ready line, in order.
    fn ports(&self) -> Vec<u16> {
        let words = self.ready.strip_prefix("pve-sim ready ").expect("a ready line").split(' ');
        let port = |word: &str| {
            let address = word.strip_prefix("bus=socketcand://127.0.0.1:").expect("a bus");
            address.split_once('/').expect("a name").0.parse().expect("a port")
        };
        words.map(port).collect()
    }

    fn connect(&self) -> TcpStream {
        connect(self.ports()[0])
    }

    /// A client that gets what is on the bus.
    fn join(&self) -> TcpStream {
        let mut client = self.connect();
        expect(&mut client, "< hi >");
        say(&mut client, "< open pve0 >");
        expect(&mut client, "< ok >");
        say(&mut client, "< rawmode >");
        expect(&mut client, "< ok >");
        client
    }

    /// Ends it as a user does; what is left of stdout and stderr.
    fn end(mut self, signal: Signal) -> (String, String) {
        kill_process(Pid::from_child(&self.process), signal).expect("it still runs");
        let (mut stdout, mut stderr) = (String::new(), String::new());
        if let Some(mut pipe) = self.stdout.take() {
            pipe.read_to_string(&mut stdout).expect("text");
        }
        self.process.stderr.take().expect("a pipe").read_to_string(&mut stderr).expect("text");
        let status = self.process.wait().expect("it ends");
        assert_eq!(status.code(), Some(0), "{stderr}");
        (stdout, stderr)
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn connect(port: u16) -> TcpStream {
    let client = TcpStream::connect(("127.0.0.1", port)).expect("a connection");
    client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    client
}

fn say(client: &mut TcpStream, text: &str) {
    client.write_all(text.as_bytes()).expect(text);
}

/// The next message.
fn message(client: &mut TcpStream) -> String {
    let mut message = Vec::new();
    while message.last() != Some(&b'>') {
        let mut byte = [0];
        client.read_exact(&mut byte).unwrap_or_else(|error| panic!("{error} after {message:?}"));
        message.push(byte[0]);
    }
    String::from_utf8(message).expect("text")
}

fn expect(client: &mut TcpStream, text: &str) {
    assert_eq!(message(client), text);
}

/// Identifier and data of the next message, which is a frame.
fn frame(client: &mut TcpStream) -> String {
    let message = message(client);
    let words: Vec<&str> = message.split(' ').collect();
    match words.as_slice() {
        ["<", "frame", id, _, data, ">"] => format!("{id}#{data}"),
        _ => panic!("no frame: {message}"),
    }
}

/// Reads until the frame comes; what else is on the bus all the time must not keep it up for ever.
fn await_frame(client: &mut TcpStream, expected: &str) {
    let start = Instant::now();
    let mut others = Vec::new();
    loop {
        let frame = frame(client);
        if frame == expected {
            return;
        }
        others.push(frame);
        assert!(start.elapsed() < PATIENCE, "{expected} did not come, but {others:?}");
    }
}

const READ_VENDOR: &str = "< send 620 8 40 18 10 1 0 0 0 0 >";
const VENDOR: &str = "5A0#4318100119000001";

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
        (&["pvea-canopen@0"], "'0' is no node ID"),
        (&["pvea-canopen@128"], "accepted: 1–127"),
        (&["pvea-isobus@0x90"], "0x80–0x8F"),
        (&["pvea-canopen@5", "pveo-canopen@5"], "both have node ID 0x05"),
        (&["pvea-canopen@5,name=a", "pveo-canopen@6,name=a"], "the name 'a' is given twice"),
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
    assert!(text.contains("valve.nvm: the memory of a pvea-canopen, not of a pveo-canopen"), "{text}");
    assert_eq!(fs::read(&file).expect("a state file"), before);
}

#[test]
fn a_state_file_has_one_simulator() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let two = ["--device", "pvea-canopen@5,name=boom", "--device", "pvea-canopen@6,name=arm"];
    let second = [&["--bus", "socketcand://127.0.0.1:0/pve0", "--state", state][..], &two].concat();
    // When its file is new, and when it was there before.
    for _ in 0..2 {
        let first = Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=arm"]);
        let file = dir.path().join("arm.nvm");
        let before = fs::read(&file).expect("a state file");
        let text = refusal(&second, 1);
        assert_eq!(text, format!("pve-sim: {} is in use by another pve-sim", file.display()));
        assert_eq!(fs::read(&file).expect("a state file"), before);
        assert!(!dir.path().join("boom.nvm").exists(), "not even what it could have had");
        // Another name is another file.
        Simulator::serve(&["--state", state, "--device", "pvea-canopen,name=boom"]).end(Signal::TERM);
        fs::remove_file(dir.path().join("boom.nvm")).expect("a state file");
        // Its end, of whatever kind, is the end of that.
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
    refused("follow the link");
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
        // Root reads everything: it is damaged, and kept.
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
        let warnings: Vec<&str> = stderr.lines().filter(|line| line.starts_with("pve-sim: ")).collect();
        assert_eq!(warnings.len(), 1, "{stderr}");
        assert!(warnings[0].contains("valve.nvm is damaged"), "{stderr}");
        let (_, stderr) = start().end(Signal::TERM);
        assert!(!stderr.contains("damaged"), "told once: {stderr}");
        // What was put aside before stays as it is.
        for (earlier, content) in contents[..=number].iter().enumerate() {
            let ending = if earlier == 0 { "bad".to_owned() } else { format!("bad.{}", earlier + 1) };
            let aside = dir.path().join(format!("valve.nvm.{ending}"));
            assert!(fs::read(aside).expect("what was put aside") == *content, "{ending}");
        }
    }
}

#[test]
fn the_ready_line_names_every_bus_with_the_port_that_was_bound() {
    let first = "socketcand://127.0.0.1:0/pve0";
    let simulator = Simulator::start(&["--bus", first, "--bus", "socketcand://127.0.0.1:0/can1"]);
    let ports = simulator.ports();
    let (one, two) = (ports[0], ports[1]);
    assert!(one != 0 && two != 0);
    let ready = format!("pve-sim ready bus=socketcand://127.0.0.1:{one}/pve0 bus=socketcand://127.0.0.1:{two}/can1");
    assert_eq!(simulator.ready, ready);
    // Both lead to one bus.
    let mut near = simulator.join();
    let mut far = connect(two);
    expect(&mut far, "< hi >");
    say(&mut far, "< open can1 >< send 123 1 ff >< echo >");
    expect(&mut far, "< ok >");
    expect(&mut far, "< echo >");
    await_frame(&mut near, "123#FF");
    let (_, stderr) = simulator.end(Signal::INT);
    let hint = format!("can_logger -i socketcand -c pve0 --bus-kwargs host=127.0.0.1 port={one}\n");
    assert!(stderr.contains(&hint), "{stderr}");
}

#[test]
fn a_valve_answers_and_the_trace_says_what_that_means() {
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join("frames.log");
    let simulator = Simulator::serve(&["--log", log.to_str().expect("text")]);
    let mut client = simulator.join();
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    let (trace, _) = simulator.end(Signal::TERM);
    let lines: Vec<(&str, &str)> = trace.lines().map(|line| line.split_once("  ").expect(line)).collect();
    let meaning = |frame: &str| {
        let line = lines.iter().find(|(logged, _)| logged.ends_with(&format!(" pve0 {frame}")));
        line.unwrap_or_else(|| panic!("{frame} in\n{trace}")).1
    };
    assert_eq!(meaning("720#00"), "pvea-canopen: boot-up");
    assert_eq!(meaning("620#4018100100000000"), "master → pvea-canopen: SDO read 0x1018:1 (Vendor ID)");
    assert_eq!(meaning(VENDOR), "pvea-canopen: SDO answer 0x1018:1 (Vendor ID) = 0x01000019");
    let logged: String = lines.iter().map(|(logged, _)| format!("{logged}\n")).collect();
    assert_eq!(fs::read_to_string(log).expect("the log"), logged);
}

#[test]
fn both_protocols_on_one_bus() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let devices = ["--device", "pvea-isobus@0x83,name=boom", "--device", "pveo-canopen@0x20", "--state", state];
    let simulator = Simulator::serve(&devices);
    let mut client = simulator.join();
    // 250 ms after its claim; by then the other one has booted.
    await_frame(&mut client, "0CFE1383#7D7D30FFFFFFFFFF");
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    say(&mut client, "< send 18EA8327 3 0 ee 0 >");
    await_frame(&mut client, "18EEFF83#0100200708FF0220");
    say(&mut client, "< send 1bc78883 5 4 2e 10 1 86 >");
    await_frame(&mut client, "1BC408F1#036E1001");
    let (trace, _) = simulator.end(Signal::TERM);
    for line in [
        "18EA8327#00EE00  0x27 → boom: request address claim",
        "18EEFF83#0100200708FF0220  boom: claims address 0x83, NAME 0x2002FF0807200001",
        "5A0#4318100119000001  pveo-canopen: SDO answer",
        "1BC408F1#036E1001  boom → tool 0xF1: UDS written 0x1001 (node ID)",
    ] {
        assert!(trace.contains(line), "{line} in\n{trace}");
    }
    // The address was stored.
    let simulator = Simulator::serve(&devices);
    let mut client = simulator.join();
    await_frame(&mut client, "0CFE1686#7D7D30FFFFFFFFFF");
    say(&mut client, "< send 18EAFFFE 3 0 ee 0 >");
    await_frame(&mut client, "18EEFF86#0100200708FF0220");
}

#[test]
fn all_clients_but_the_sender_get_a_frame() {
    let simulator = Simulator::serve(&["--device", "pvea-canopen,blank"]);
    let (mut sender, mut other, mut third) = (simulator.join(), simulator.join(), simulator.join());
    say(&mut sender, "< send 18A 2 1 f >< send ffffffff98ff0ae0 0 >< send 100 0  >< echo >");
    expect(&mut sender, "< echo >");
    for client in [&mut other, &mut third] {
        assert_eq!(frame(client), "18A#010F");
        assert_eq!(frame(client), "18FF0AE0#");
        assert_eq!(frame(client), "100#");
    }
    say(&mut other, "< send 200 1 1 >");
    assert_eq!(frame(&mut sender), "200#01");
}

#[test]
fn a_client_that_dies_disturbs_nobody() {
    let simulator = Simulator::serve(&[]);
    let mut witness = simulator.join();
    for text in ["", "< op", "< open pve0 >< send 18A 8 1 2 3 4", "< open pve0 >< rawmode >< send 18A 0 ><"] {
        let mut dying = simulator.connect();
        say(&mut dying, text);
        drop(dying);
    }
    say(&mut witness, READ_VENDOR);
    await_frame(&mut witness, VENDOR);
}

#[test]
fn what_was_sent_before_the_end_of_a_connection_reaches_the_bus() {
    let simulator = Simulator::serve(&["--device", "pvea-canopen,blank"]);
    let mut witness = simulator.join();
    let mut hasty = simulator.connect();
    let frames: String = (0..200).map(|number| format!("< send 100 1 {number:x} >")).collect();
    say(&mut hasty, &format!("< open pve0 >{frames}"));
    hasty.shutdown(Shutdown::Write).expect("half a connection");
    for number in 0..200 {
        assert_eq!(frame(&mut witness), format!("100#{number:02X}"));
    }
    let mut answers = String::new();
    hasty.read_to_string(&mut answers).expect("the end");
    assert_eq!(answers, "< hi >< ok >");
}

/// As in `pve-sim | head`, with a bus on which nothing happens any more.
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

/// The fault log of a valve is written some time after the fault: at the end, it is written at once.
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
    let script = "trap '' HUP; exec \"$0\" --bus socketcand://127.0.0.1:0/pve0";
    shell.args(["-c", script, env!("CARGO_BIN_EXE_pve-sim")]);
    let simulator = Simulator::spawn(shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut client = simulator.join();
    kill_process(Pid::from_child(&simulator.process), Signal::HUP).expect("it runs");
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    simulator.end(Signal::TERM);
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

/// A valve at another bit rate destroys the frame of a client, thousands of times a second.
#[test]
fn error_frames_are_told_and_not_poured() {
    for (options, wanted) in [(&[][..], false), (&["--error-frames"][..], true)] {
        let mut simulator =
            Simulator::serve(&[&["--bit-rate", "125k", "--device", "pvea-canopen,blank"], options].concat());
        let mut witness = simulator.join();
        let mut client = simulator.join();
        say(&mut client, "< send 123 1 1 >< echo >");
        expect(&mut client, "< echo >");
        if wanted {
            let first = message(&mut witness);
            assert!(first.starts_with("< error 080 "), "{first}");
            let second = message(&mut witness);
            assert!(second.starts_with("< error 004 "), "{second}");
        }
        // The client leaves, and its frame with it: the bus is free for others.
        drop(client);
        let mut other = simulator.join();
        say(&mut other, "< send 7F0 0 >");
        let mut trace = Vec::new();
        while !trace.last().is_some_and(|line: &String| line.contains("7F0")) {
            trace.push(simulator.line());
        }
        assert!(trace[0].contains("20000080#0000000000000000  error frame: stuff error in 123: 01 of the gateway"));
        assert!(trace[1].contains("20000004#0030000000000000  the gateway: error-passive after error frames ×16"));
        assert!(trace.len() < 50, "{trace:?}");
        say(&mut witness, "< echo >");
        loop {
            match message(&mut witness) {
                text if text == "< echo >" => break,
                text => assert!(text.starts_with("< frame ") || (wanted && text.starts_with("< error ")), "{text}"),
            }
        }
        simulator.end(Signal::TERM);
    }
}

/// With the descriptors that a shell gives it, and more clients than those: devices still store.
#[test]
fn clients_leave_enough_descriptors_to_store() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut shell = Command::new("sh");
    let script = "ulimit -n 64 && exec \"$0\" --bus socketcand://127.0.0.1:0/pve0 --state \"$1\"";
    shell.args(["-c", script, env!("CARGO_BIN_EXE_pve-sim")]).arg(dir.path());
    let simulator = Simulator::spawn(shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut client = simulator.join();
    let mut crowd: Vec<TcpStream> = Vec::new();
    loop {
        let mut one = simulator.connect();
        match message(&mut one).as_str() {
            "< hi >" => crowd.push(one),
            text => break assert_eq!(text, "< error too many clients >"),
        }
        assert!(crowd.len() < 64);
    }
    assert!(crowd.len() >= 20, "{}", crowd.len());
    say(&mut client, "< send 620 8 22 10 10 1 73 61 76 65 >");
    await_frame(&mut client, "5A0#6010100100000000");
    // There is room again for those who come later.
    drop(crowd);
    simulator.join();
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
    simulator.end(Signal::TERM);
    drop(unread);
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

#[test]
fn the_use_cases_are_played_and_printed() {
    let output = output(&["use-case", "all"]);
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).expect("text");
    for name in ["1", "2", "3", "4", "5", "6", "isobus"] {
        assert!(text.contains(&format!("use case {name}: ")), "{text}");
    }
    assert!(text.contains("720: 00") && text.contains("boot-up"), "{text}");
}

#[test]
fn help_goes_to_stdout() {
    let output = output(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8(output.stdout).expect("text").contains("--device"));
}
