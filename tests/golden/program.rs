//! The executable: run to its end, or running while its time stands.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// All that is known of the program. The crate that builds it lists this test in its Cargo.toml.
const PVE_SIM: &str = env!("CARGO_BIN_EXE_pve-sim");

/// The longest wait for what should come at once: a machine under load may starve a process for many seconds.
const PATIENCE: Duration = Duration::from_secs(120);

/// The variables that change how the program lays out its texts.
const LAYOUT: [&str; 6] = ["COLUMNS", "LINES", "NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "TERM"];

/// The folder of the repository, in which the program runs.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(PVE_SIM);
    for variable in LAYOUT {
        command.env_remove(variable);
    }
    command.args(arguments).current_dir(root());
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A program that has ended.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ended {
    /// The command line and all that came of it, as in a terminal.
    pub(crate) fn transcript(&self, arguments: &str) -> String {
        let mut text = format!("$ pve-sim {arguments}\n{}", self.stdout);
        self.stderr.lines().for_each(|line| text += &format!("stderr: {line}\n"));
        text + &format!("exit {}\n\n", self.code.map_or_else(|| "by a signal".to_owned(), |code| code.to_string()))
    }
}

/// Runs the program to its end.
#[track_caller]
pub(crate) fn run(arguments: &[&str]) -> Ended {
    let mut process = command(arguments).spawn().expect("the program starts");
    let mut out = BufReader::new(process.stdout.take().expect("a pipe"));
    let (mut stdout, mut stderr) = (String::new(), String::new());
    out.read_line(&mut stdout).expect("text");
    if stdout.starts_with("pve-sim ready") {
        // It does not end by itself.
        let _ = process.kill();
        let _ = process.wait();
        panic!("it was to be refused, and runs: {arguments:?}");
    }
    out.read_to_string(&mut stdout).expect("text");
    process.stderr.take().expect("a pipe").read_to_string(&mut stderr).expect("text");
    Ended { code: process.wait().expect("it ends").code(), stdout, stderr }
}

/// The stdout of a program that succeeds.
#[track_caller]
pub(crate) fn printed(arguments: &[&str]) -> String {
    let ended = run(arguments);
    assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{arguments:?}");
    ended.stdout
}

fn connect(address: &str) -> TcpStream {
    let client = TcpStream::connect(address).expect("a connection");
    client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    client
}

/// A program that runs: its time passes when it is told to.
pub(crate) struct Simulator {
    process: Child,
    /// Unread, but open: a reader that is gone ends the program.
    _stdout: BufReader<ChildStdout>,
    /// `127.0.0.1:PORT` of the control interface, and of the bus.
    pub(crate) host: String,
    bus: String,
}

/// An answer of the control interface.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: String,
}

impl Answer {
    /// The value of a header, which is there once.
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.head
            .lines()
            .filter_map(|line| line.split_once(": "))
            .find(|(found, _)| *found == name)
            .map(|(_, value)| value)
    }
}

impl Simulator {
    /// Starts one with its time standing; what it said when it did not start.
    pub(crate) fn start(arguments: &[&str]) -> Result<Self, Ended> {
        let own = ["--speed", "step", "--http", "127.0.0.1:0", "--bus", "socketcand://127.0.0.1:0/pve0"];
        let mut process = command(&[&own, arguments].concat()).spawn().expect("the program starts");
        let mut stdout = BufReader::new(process.stdout.take().expect("a pipe"));
        let mut ready = String::new();
        stdout.read_line(&mut ready).expect("text");
        let address = |mark: &str| {
            let (_, rest) = ready.split_once(mark)?;
            rest.split_once('/').map(|(address, _)| address.to_owned())
        };
        match (address(" bus=socketcand://"), address(" http=http://")) {
            (Some(bus), Some(host)) => Ok(Self { process, _stdout: stdout, host, bus }),
            _ => {
                let mut stderr = String::new();
                process.stderr.take().expect("a pipe").read_to_string(&mut stderr).expect("text");
                Err(Ended { code: process.wait().expect("it ends").code(), stdout: ready, stderr })
            }
        }
    }

    /// Starts one that has to start.
    #[track_caller]
    pub(crate) fn started(arguments: &[&str]) -> Self {
        Self::start(arguments).unwrap_or_else(|ended| panic!("{arguments:?}: {}", ended.stderr))
    }

    /// Ends it as a user does.
    pub(crate) fn end(mut self) -> Ended {
        kill_process(Pid::from_child(&self.process), Signal::TERM).expect("it still runs");
        let mut stderr = String::new();
        self.process.stderr.take().expect("a pipe").read_to_string(&mut stderr).expect("text");
        Ended { code: self.process.wait().expect("it ends").code(), stdout: String::new(), stderr }
    }

    /// Puts frames on the bus that is served, `220#0F000020`: they follow each other as fast as the bus lets them, once
    /// time passes.
    pub(crate) fn put(&self, frames: &[String]) {
        let mut client = connect(&self.bus);
        let mut say = |text: &str, answer: &str| {
            client.write_all(text.as_bytes()).expect("it reads");
            let mut bytes = vec![0; answer.len()];
            client.read_exact(&mut bytes).expect("an answer");
            assert_eq!(String::from_utf8_lossy(&bytes), answer, "{text}");
        };
        say("", "< hi >");
        say("< open pve0 >", "< ok >");
        let send = |frame: &String| {
            let (id, data) = frame.split_once('#').expect("a frame");
            let bytes: String =
                data.as_bytes().chunks(2).map(|pair| format!("{} ", String::from_utf8_lossy(pair))).collect();
            format!("< send {id} {} {bytes}>", data.len() / 2)
        };
        // Answered when all of them were accepted.
        say(&(frames.iter().map(send).collect::<String>() + "< echo >"), "< echo >");
    }

    /// A connection on which a request was sent.
    pub(crate) fn ask(&self, request: &str) -> TcpStream {
        let mut client = connect(&self.host);
        client.write_all(request.as_bytes()).expect("it reads");
        client
    }

    /// The answer to the bytes of a request, which ends the connection.
    pub(crate) fn raw(&self, request: &str) -> Answer {
        let mut text = String::new();
        self.ask(request).read_to_string(&mut text).expect("text");
        let (head, body) = text.split_once("\r\n\r\n").unwrap_or_else(|| panic!("no answer to {request}: {text:?}"));
        let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
        Answer { status, head: head.to_owned(), body: body.to_owned() }
    }

    /// The answer to a request with these lines of its head.
    pub(crate) fn with(&self, method: &str, path: &str, head: &str, body: &str) -> Answer {
        let length = if body.is_empty() { String::new() } else { format!("Content-Length: {}\r\n", body.len()) };
        self.raw(&format!("{method} {path} HTTP/1.1\r\n{head}Connection: close\r\n{length}\r\n{body}"))
    }

    /// The answer to a call; a body is JSON.
    pub(crate) fn call(&self, method: &str, path: &str, body: &str) -> Answer {
        let kind = if body.is_empty() { "" } else { "Content-Type: application/json\r\n" };
        self.with(method, &format!("/api/v1{path}"), &format!("Host: {}\r\n{kind}", self.host), body)
    }

    /// The body of a call that succeeds.
    #[track_caller]
    pub(crate) fn done(&self, method: &str, path: &str, body: &str) -> Value {
        let answer = self.call(method, path, body);
        assert_eq!(answer.status, 200, "{method} {path} {body}: {}", answer.body);
        serde_json::from_str(&answer.body).expect("JSON")
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
