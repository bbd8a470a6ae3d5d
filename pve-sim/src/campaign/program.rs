//! Starts a controller program on a bus, collects its output, and ends it with its child processes.

use std::collections::VecDeque;
use std::io::{self, BufRead as _, BufReader, Read};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

/// The number of lines kept, from the end of a program's output.
const KEPT: usize = 50;

/// The process IDs of the programs not yet ended by [`Program::end`] or a drop.
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

/// A started controller program.
#[derive(Debug)]
pub(super) struct Program {
    child: Child,
    said: Arc<Mutex<VecDeque<String>>>,
    readers: Vec<JoinHandle<()>>,
}

impl Program {
    /// Starts a program; `{bus}` in its arguments becomes the URL of the bus. On Unix the program has its own process
    /// group.
    pub(super) fn start(words: &[String], bus: &str) -> io::Result<Self> {
        let mut words = words.iter().map(|word| word.replace("{bus}", bus));
        let mut command = Command::new(words.next().unwrap_or_default());
        command.args(words).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        alone(&mut command);
        let mut child = command.spawn()?;
        RUNNING.lock().unwrap_or_else(PoisonError::into_inner).push(child.id());
        let said = Arc::new(Mutex::new(VecDeque::new()));
        let mut readers = Vec::new();
        readers.extend(child.stdout.take().map(|pipe| read(pipe, said.clone())));
        readers.extend(child.stderr.take().map(|pipe| read(pipe, said.clone())));
        Ok(Self { child, said, readers })
    }

    /// Returns the exit status of a program that has ended.
    pub(super) fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Ends the program with its children; returns the last lines of its output.
    pub(super) fn end(mut self) -> String {
        self.kill();
        // A child that has left the group may keep the pipe open.
        for reader in self.readers.drain(..).filter(JoinHandle::is_finished) {
            let _ = reader.join();
        }
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        said.iter().cloned().collect::<Vec<_>>().join("\n")
    }

    fn kill(&mut self) {
        kill_group(self.child.id());
        let _ = self.child.kill();
        let _ = self.child.wait();
        RUNNING.lock().unwrap_or_else(PoisonError::into_inner).retain(|pid| *pid != self.child.id());
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Ends all programs with their children. Called before this process ends.
pub(super) fn end_all() {
    for pid in RUNNING.lock().unwrap_or_else(PoisonError::into_inner).iter() {
        kill_group(*pid);
    }
}

/// Reads a pipe on a new thread, so that the pipe never fills up. Keeps the last lines.
fn read(pipe: impl Read + Send + 'static, said: Arc<Mutex<VecDeque<String>>>) -> JoinHandle<()> {
    thread::spawn(move || {
        let mut lines = BufReader::new(pipe).split(b'\n');
        while let Some(Ok(line)) = lines.next() {
            let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
            said.push_back(String::from_utf8_lossy(&line).trim_end().to_owned());
            if said.len() > KEPT {
                said.pop_front();
            }
        }
    })
}

#[cfg(unix)]
fn alone(command: &mut Command) {
    use std::os::unix::process::CommandExt as _;
    command.process_group(0);
}

#[cfg(unix)]
fn kill_group(pid: u32) {
    use rustix::process::{Pid, Signal, kill_process_group};
    // The group keeps the ID of its first process, even after the end of that process.
    if let Some(group) = i32::try_from(pid).ok().and_then(Pid::from_raw) {
        let _ = kill_process_group(group, Signal::KILL);
    }
}

#[cfg(not(unix))]
const fn alone(_: &mut Command) {}

/// Does nothing: without groups the children of a program are unknown.
#[cfg(not(unix))]
const fn kill_group(_: u32) {}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    fn sh(script: &str) -> Program {
        Program::start(&["sh", "-c", script, "sh", "{bus}"].map(str::to_owned), "socketcand://x:1/pve0")
            .expect("a shell")
    }

    #[test]
    fn output_is_kept_and_death_is_noticed() {
        let mut program = sh("echo \"on $1\"; for n in $(seq 60); do echo $n >&2; done; exit 3");
        let status = loop {
            if let Some(status) = program.ended() {
                break status;
            }
            thread::yield_now();
        };
        assert_eq!(status.code(), Some(3));
        while !program.readers.iter().all(JoinHandle::is_finished) {
            thread::yield_now();
        }
        let said = program.end();
        assert_eq!(said.lines().count(), KEPT, "{said}");
        assert!(said.contains("60"), "{said}");
    }

    #[test]
    fn children_end_with_the_program() {
        let program = sh("sleep 1000 & echo $!; wait");
        let pid = loop {
            if let Some(pid) = program.said.lock().unwrap().front() {
                break pid.clone();
            }
            thread::yield_now();
        };
        let is_alive = || {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            !stat.is_empty() && !stat.contains(") Z ")
        };
        assert!(is_alive());
        program.end();
        while is_alive() {
            thread::yield_now();
        }
    }
}
