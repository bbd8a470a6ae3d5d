//! Programs beside the tests. None hangs a test: one that stands still fails it with what it has said.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

/// Longest wait for a line, a start or an end. Generous: a busy machine is not a fault of the program.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

/// The life of a program. The scripts of `tests/clients/` have less, and tell where they hang.
pub(crate) const LIFE: Duration = Duration::from_secs(960);

/// What a killed program may still have to say.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// Runs a program to its end, without input.
pub(crate) fn output(command: &mut Command) -> Output {
    output_within(LIFE, command)
}

pub(crate) fn output_within(life: Duration, command: &mut Command) -> Output {
    let piped = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let process = piped.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let pid = Pid::from_child(&process);
    let (end, ended) = channel();
    thread::spawn(move || end.send(process.wait_with_output()));
    let output = ended.recv_timeout(life).unwrap_or_else(|_| {
        let _ = kill_process(pid, Signal::KILL);
        // Its own children may hold its pipes.
        let said = ended.recv_timeout(LAST_WORDS).ok().and_then(Result::ok);
        let said = said.map(|said| [said.stdout, said.stderr].concat()).unwrap_or_default();
        panic!("{command:?} has not ended within {life:?}\n{}", String::from_utf8_lossy(&said));
    });
    output.expect("it is our child")
}

/// A program that is heard line by line while it runs.
pub(crate) struct Program {
    process: Child,
    lines: Receiver<String>,
    told: String,
}

impl Program {
    pub(crate) fn start(command: &mut Command) -> Self {
        let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = piped.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let stdout = BufReader::new(process.stdout.take().expect("a pipe"));
        let (line, lines) = channel();
        thread::spawn(move || stdout.lines().map_while(Result::ok).try_for_each(|told| line.send(told)));
        Self { process, lines, told: String::new() }
    }

    /// Waits until it has told these words.
    pub(crate) fn until(&mut self, words: &str) {
        while !self.told.contains(words) {
            if let Err(why) = self.hear() {
                panic!("no {words:?}, {why}, after:\n{}", self.told);
            }
        }
    }

    /// Presses Enter, and sees it end well; returns all that it told.
    pub(crate) fn enter(mut self) -> String {
        self.process.stdin.take().expect("a pipe").write_all(b"\n").expect("it waits for Enter");
        loop {
            match self.hear() {
                Ok(()) => (),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(why) => panic!("no end, {why}, after:\n{}", self.told),
            }
        }
        assert!(self.process.wait().expect("it is our child").success(), "{}", self.told);
        self.told.clone()
    }

    fn hear(&mut self) -> Result<(), RecvTimeoutError> {
        let line = self.lines.recv_timeout(PATIENCE)?;
        self.told.push_str(&line);
        self.told.push('\n');
        Ok(())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
