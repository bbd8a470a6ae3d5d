//! The running program, and its clients on real sockets.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

/// The longest wait for an immediate answer: a machine under load may starve a process for many seconds.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

pub(crate) fn pve_sim(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pve-sim"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// The life of a process: the reads and waits of a test end with it.
const LIFE: Duration = Duration::from_secs(900);

/// Kills a process at the end of its [`LIFE`], unless it is dropped before.
pub(crate) struct Watch {
    _guard: Sender<()>,
}

/// Starts a process that ends with its watch, so that a test that waits for longer fails with a message.
pub(crate) fn spawn(command: &mut Command) -> (Child, Watch) {
    let process = command.spawn().expect("pve-sim starts");
    let (pid, name) = (Pid::from_child(&process), format!("{command:?}"));
    let (guard, dropped) = channel();
    thread::spawn(move || {
        if dropped.recv_timeout(LIFE) == Err(RecvTimeoutError::Timeout) {
            eprintln!("{name} has not ended within {LIFE:?}, and is killed");
            let _ = kill_process(pid, Signal::KILL);
        }
    });
    (process, Watch { _guard: guard })
}

pub(crate) fn output(arguments: &[&str]) -> Output {
    end_of(&mut pve_sim(arguments))
}

/// Runs a process to its end.
pub(crate) fn end_of(command: &mut Command) -> Output {
    let (process, _watch) = spawn(command);
    process.wait_with_output().expect("it is our child")
}

/// Returns the single line of a refused start.
pub(crate) fn refusal(arguments: &[&str], code: i32) -> String {
    // A process that starts by mistake does not end, but prints its ready line.
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
pub(crate) struct Simulator {
    pub(crate) process: Child,
    pub(crate) stdout: Option<BufReader<ChildStdout>>,
    pub(crate) ready: String,
    _watch: Watch,
}

impl Simulator {
    /// Starts a simulator, by default without a control interface, whose default port is shared.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let runs = arguments.first().is_none_or(|first| first.starts_with('-'));
        let no_http =
            if runs && !arguments.iter().any(|argument| argument.ends_with("http")) { &["--no-http"][..] } else { &[] };
        Self::spawn(&mut pve_sim(&[no_http, arguments].concat()))
    }

    pub(crate) fn spawn(command: &mut Command) -> Self {
        let (mut process, watch) = spawn(command);
        let mut stdout = BufReader::new(process.stdout.take().expect("a pipe"));
        let mut ready = String::new();
        stdout.read_line(&mut ready).expect("the ready line");
        Self { process, stdout: Some(stdout), ready: ready.trim_end().to_owned(), _watch: watch }
    }

    pub(crate) fn serve(arguments: &[&str]) -> Self {
        Self::start(&[&["--bus", "socketcand://127.0.0.1:0/pve0"], arguments].concat())
    }

    /// Reads the next line of the trace.
    pub(crate) fn line(&mut self) -> String {
        let mut line = String::new();
        self.stdout.as_mut().expect("a pipe").read_line(&mut line).expect("a line");
        assert!(!line.is_empty(), "it has ended");
        line
    }

    /// Returns the ports of the ready line, in order.
    pub(crate) fn ports(&self) -> Vec<u16> {
        let words = self.ready.strip_prefix("pve-sim ready ").expect("a ready line").split(' ');
        let buses = words.filter_map(|word| word.strip_prefix("bus=socketcand://127.0.0.1:"));
        buses.map(|address| address.split_once('/').expect("a name").0.parse().expect("a port")).collect()
    }

    /// Returns the address of the control interface, as in the ready line.
    pub(crate) fn http(&self) -> &str {
        let (_, url) = self.ready.split_once(" http=http://").expect("a control interface");
        url.trim_end_matches('/')
    }

    pub(crate) fn connect(&self) -> TcpStream {
        connect(self.ports()[0])
    }

    /// Returns a client that receives all frames.
    pub(crate) fn join(&self) -> TcpStream {
        let mut client = self.connect();
        expect(&mut client, "< hi >");
        say(&mut client, "< open pve0 >");
        expect(&mut client, "< ok >");
        say(&mut client, "< rawmode >");
        expect(&mut client, "< ok >");
        client
    }

    /// Ends the process as a user does; returns the rest of stdout and stderr.
    pub(crate) fn end(mut self, signal: Signal) -> (String, String) {
        assert!(signal != Signal::HUP || !ignores_hangup(), "SIGHUP is ignored, as under nohup: pve-sim would go on");
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

/// Returns whether this process ignores SIGHUP, and therefore its children; Linux only.
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:\t"));
    mask.is_some_and(|mask| mask.ends_with(['1', '3', '5', '7', '9', 'b', 'd', 'f']))
}

pub(crate) fn connect(port: u16) -> TcpStream {
    let client = TcpStream::connect(("127.0.0.1", port)).expect("a connection");
    client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    client
}

pub(crate) fn say(client: &mut TcpStream, text: &str) {
    client.write_all(text.as_bytes()).expect(text);
}

/// Reads the next message. Peeks before reading: byte by byte, a busy machine would not keep up with a fast bus.
pub(crate) fn message(client: &mut TcpStream) -> String {
    let mut message = Vec::new();
    while message.last() != Some(&b'>') {
        let mut bytes = [0; 256];
        let seen = client.peek(&mut bytes).unwrap_or_else(|error| panic!("{error} after {message:?}"));
        assert_ne!(seen, 0, "the end after {message:?}");
        let len = bytes[..seen].iter().position(|byte| *byte == b'>').map_or(seen, |end| end + 1);
        client.read_exact(&mut bytes[..len]).expect("what is there");
        message.extend_from_slice(&bytes[..len]);
    }
    String::from_utf8(message).expect("text")
}

pub(crate) fn expect(client: &mut TcpStream, text: &str) {
    assert_eq!(message(client), text);
}

/// Returns identifier and data of the next message, which must be a frame.
pub(crate) fn frame(client: &mut TcpStream) -> String {
    let message = message(client);
    let words: Vec<&str> = message.split(' ').collect();
    match words.as_slice() {
        ["<", "frame", id, _, data, ">"] => format!("{id}#{data}"),
        _ => panic!("no frame: {message}"),
    }
}

/// Reads until the frame comes; frames in a cycle must not extend the wait forever.
pub(crate) fn await_frame(client: &mut TcpStream, expected: &str) {
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

pub(crate) const READ_VENDOR: &str = "< send 620 8 40 18 10 1 0 0 0 0 >";
pub(crate) const VENDOR: &str = "5A0#4318100119000001";
