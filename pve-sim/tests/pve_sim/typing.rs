//! Lines typed on the terminal of a run, which also shows the trace.
//!
//! Only for Linux: `setsid` of util-linux makes the terminal the controlling one, as job control keys require.

use std::ffi::OsStr;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Termios, Winsize, tcgetattr, tcsetwinsize};

use super::simulator::{PATIENCE, READ_VENDOR, VENDOR, Watch, await_frame, connect, expect, say, spawn};

const PVE_SIM: &str = env!("CARGO_BIN_EXE_pve-sim");
const BUS: [&str; 5] = ["--no-http", "--bus", "socketcand://127.0.0.1:0/pve0", "--device", "pvea-canopen,name=boom"];

const CTRL_C: &str = "\x03";
const CTRL_D: &str = "\x04";
const CTRL_Z: &str = "\x1a";
const UP: &str = "\x1b[A";

/// A program on a terminal of its own, with the user's end.
struct Terminal {
    person: File,
    device: File,
    process: Child,
    _watch: Watch,
    /// The terminal modes before the program.
    before: Termios,
    /// The output since the last awaited text.
    shown: String,
}

impl Terminal {
    /// Starts a program in a session of its own, whose stdin, stdout and stderr are the terminal unless `change`
    /// replaces them.
    fn start(program: &str, arguments: &[&str], change: impl FnOnce(&mut Command) -> &mut Command) -> Self {
        let person = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a terminal");
        grantpt(&person).expect("ours");
        unlockpt(&person).expect("ours");
        let path = ptsname(&person, Vec::new()).expect("its name");
        let no_control = i32::try_from(OFlags::NOCTTY.bits()).expect("a flag");
        let mut options = OpenOptions::new();
        let options = options.read(true).write(true).custom_flags(no_control);
        let device = options.open(OsStr::from_bytes(path.as_bytes())).expect("its other end");
        tcsetwinsize(&device, Winsize { ws_row: 24, ws_col: 120, ws_xpixel: 0, ws_ypixel: 0 }).expect("a size");
        let before = tcgetattr(&device).expect("its modes");
        let end = || Stdio::from(device.try_clone().expect("a descriptor"));
        let mut command = Command::new("setsid");
        command.args(["--ctty", program]).args(arguments).stdin(end()).stdout(end()).stderr(end());
        command.env("TERM", "xterm").env("PS1", "shell: ");
        let (process, watch) = spawn(change(&mut command));
        Self { person: File::from(person), device, process, _watch: watch, before, shown: String::new() }
    }

    fn simulator() -> Self {
        Self::start(PVE_SIM, &BUS, |command| command)
    }

    fn press(&mut self, keys: &str) {
        self.person.write_all(keys.as_bytes()).expect(keys);
    }

    /// Reads until the terminal shows a text; returns the output since the last one, including the text.
    fn wait_for(&mut self, text: &str) -> String {
        while !self.shown.contains(text) {
            self.read(text);
        }
        let end = self.shown.find(text).expect("it is there") + text.len();
        let rest = self.shown.split_off(end);
        std::mem::replace(&mut self.shown, rest)
    }

    /// Reads further output.
    fn read(&mut self, wanted: &str) {
        let patience = Timespec::try_from(PATIENCE).expect("a time");
        let came = poll(&mut [PollFd::new(&self.person, PollFlags::IN)], Some(&patience)).expect("a terminal");
        assert_eq!(came, 1, "no {wanted:?} in {:?}", self.shown);
        let mut bytes = [0; 4096];
        let len =
            self.person.read(&mut bytes).unwrap_or_else(|error| panic!("{error}: no {wanted:?} in {:?}", self.shown));
        self.shown.push_str(&String::from_utf8_lossy(&bytes[..len]));
    }

    /// Returns the port of the bus, from the ready line.
    fn port(&mut self) -> u16 {
        self.wait_for("bus=socketcand://127.0.0.1:");
        self.wait_for("/").trim_end_matches('/').parse().expect("a port")
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.process), signal).expect("it still runs");
    }

    fn modes(&self) -> String {
        format!("{:?}", tcgetattr(&self.device).expect("its modes"))
    }

    /// Waits until the terminal has its original modes.
    fn wait_for_modes(&self) {
        let start = Instant::now();
        while self.modes() != format!("{:?}", self.before) {
            assert!(start.elapsed() < PATIENCE, "{:?}", self.shown);
            std::thread::yield_now();
        }
    }

    /// Waits for the end, which restores the terminal.
    fn end(mut self) {
        assert_eq!(self.process.wait().expect("it ends").code(), Some(0));
        assert_eq!(self.modes(), format!("{:?}", self.before));
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Returns a client that receives all frames.
fn join(port: u16) -> TcpStream {
    let mut client = connect(port);
    expect(&mut client, "< hi >");
    for (ask, answer) in [("< open pve0 >", "< ok >"), ("< rawmode >", "< ok >")] {
        say(&mut client, ask);
        expect(&mut client, answer);
    }
    client
}

#[test]
fn a_line_that_is_half_typed_is_redrawn_whole_below_the_trace() {
    let mut terminal = Terminal::simulator();
    let port = terminal.port();
    terminal.wait_for("EMCY: no error");
    terminal.press("boom sta");
    terminal.wait_for("boom sta");
    say(&mut join(port), "< send 0 2 1 0 >");
    // Another line may have come before.
    let above = terminal.wait_for("000: 01 00");
    let since = above.rsplit("\x1b[K").next().expect("a part");
    assert!(!since.contains("boom sta"), "the line was not cleared: {above:?}");
    let below = terminal.wait_for("> boom sta");
    assert!(below.ends_with("\r\n> boom sta"), "{below:?}");
    terminal.press("tus\r");
    terminal.wait_for("boom: node_id 0x20");
    terminal.press(CTRL_C);
    terminal.end();
}

#[test]
fn tab_completes_and_the_arrow_brings_back() {
    let mut terminal = Terminal::simulator();
    terminal.wait_for("> ");
    terminal.press("bo\tsp\tstu\t");
    terminal.wait_for("boom spool stuck ");
    terminal.press("\r");
    terminal.wait_for("ok\r\n");
    terminal.press(UP);
    terminal.wait_for("> boom spool stuck");
    terminal.press("\r");
    terminal.wait_for("ok\r\n");
    // The only candidate stays.
    terminal.press("boom sup\t\t8000\r");
    terminal.wait_for("ok\r\n");
    // Candidates come one after the other.
    terminal.press("boom \t");
    terminal.wait_for("> boom supply_mv");
    terminal.press("\t");
    terminal.wait_for("> boom temperature_c");
    // The only value of a candidate does not end the round.
    terminal.press("\t\t");
    terminal.wait_for("> boom lever");
    terminal.press("\t");
    terminal.wait_for("> boom internal_fault");
    terminal.press("\x15boom lev\to\t\r");
    terminal.wait_for("> boom lever off");
    terminal.wait_for("ok\r\n");
    terminal.press(CTRL_C);
    terminal.end();
}

/// The editor draws the whole line for each of its characters: without a limit, a long line costs its square.
#[test]
fn a_line_grows_no_longer_than_what_is_refused() {
    let mut terminal = Terminal::simulator();
    terminal.wait_for("> ");
    let mut person = terminal.person.try_clone().expect("a descriptor");
    let paste = std::thread::spawn(move || person.write_all(format!("{}\r", "x".repeat(10_000)).as_bytes()));
    let shown = terminal.wait_for(&format!("'{}…' is not a valid command", "x".repeat(256)));
    assert!(shown.len() < 100_000, "{} bytes were drawn", shown.len());
    paste.join().expect("no panic").expect("it reads");
    terminal.press("memory ok\r");
    terminal.wait_for("ok\r\n");
    terminal.press(CTRL_C);
    terminal.end();
}

#[test]
fn lines_that_are_pasted_at_once_are_all_obeyed() {
    let mut terminal = Terminal::simulator();
    terminal.wait_for("> ");
    terminal.press("supply_mv 8000\rsupply_mv 9000\rstatus\r");
    terminal.wait_for("supply_mv 9000, temperature_c");
    terminal.press(CTRL_C);
    terminal.end();
}

#[test]
fn the_terminal_is_left_as_it_was_by_every_end() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut terminal = Terminal::simulator();
        terminal.wait_for("> ");
        assert_ne!(terminal.modes(), format!("{:?}", terminal.before));
        terminal.press("half");
        terminal.wait_for("half");
        terminal.signal(signal);
        terminal.end();
    }
}

/// The end of typing restores the terminal, and the run goes on.
#[test]
fn ctrl_d_ends_the_typing_alone() {
    let mut terminal = Terminal::simulator();
    terminal.wait_for("> ");
    terminal.press(CTRL_D);
    terminal.wait_for_modes();
    assert_eq!(terminal.process.try_wait().expect("a process"), None);
    terminal.signal(Signal::TERM);
    terminal.end();
}

/// An unsupported terminal, or a pipe beside it, has neither a prompt nor other modes.
#[test]
fn without_a_terminal_for_all_of_it_lines_are_read_as_they_come() {
    let mut simulators = [
        Terminal::start(PVE_SIM, &BUS, |command| command.env("TERM", "dumb")),
        Terminal::start(PVE_SIM, &BUS, |command| command.stdout(Stdio::piped())),
    ];
    for terminal in &mut simulators {
        terminal.wait_for("Type help");
        terminal.press("status\n");
        let shown = terminal.wait_for("boom: node_id 0x20");
        assert!(!shown.contains("> "), "{shown:?}");
        assert_eq!(terminal.modes(), format!("{:?}", terminal.before));
        terminal.signal(Signal::TERM);
    }
    simulators.into_iter().for_each(Terminal::end);
}

/// In the background the run goes on, and the shell has the terminal to itself.
#[test]
fn a_job_in_the_background_leaves_the_terminal_to_the_shell() {
    let options = ["--norc", "--noprofile", "--noediting", "-i"];
    let mut terminal = Terminal::start("bash", &options, |command| command);
    terminal.wait_for("shell: ");
    terminal.press(&format!("{PVE_SIM} {}\r", BUS.join(" ")));
    let port = terminal.port();
    terminal.wait_for("> ");
    terminal.press("memory ok\r");
    terminal.wait_for("ok\r\n");
    terminal.press(CTRL_Z);
    terminal.wait_for("Stopped");
    terminal.wait_for("shell: ");
    assert_eq!(terminal.modes(), format!("{:?}", terminal.before));
    terminal.press("bg\r");
    terminal.wait_for("&");
    terminal.press("echo $((6 * 7)) of a shell\r");
    terminal.wait_for("42 of a shell");
    let mut client = join(port);
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    assert_eq!(terminal.modes(), format!("{:?}", terminal.before));
    terminal.press("jobs\r");
    terminal.wait_for("Running");
    terminal.press("kill %1; wait; exit 0\r");
    terminal.end();
}

/// Back in the foreground, the prompt returns, however late the job was stopped.
#[test]
fn a_job_back_in_the_foreground_has_its_prompt() {
    let options = ["--norc", "--noprofile", "--noediting", "-i"];
    let mut terminal = Terminal::start("bash", &options, |command| command);
    terminal.wait_for("shell: ");
    terminal.press(&format!("{PVE_SIM} {}\r", BUS.join(" ")));
    terminal.port();
    terminal.wait_for("> ");
    for _ in 0..3 {
        terminal.press(CTRL_Z);
        terminal.wait_for("shell: ");
        terminal.press("bg\r");
        terminal.wait_for("shell: ");
        terminal.press("fg\r");
        terminal.wait_for("> ");
        terminal.press("memory ok\r");
        terminal.wait_for("ok\r\n");
        terminal.wait_for("> ");
    }
    terminal.press(CTRL_C);
    terminal.wait_for("shell: ");
    terminal.press("exit 0\r");
    terminal.end();
}
