//! Starts a controller program on a bus, collects its output, and ends it with its child processes.

use std::collections::VecDeque;
use std::io::{self, BufRead as _, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use super::process::Group;

/// The number of lines kept, from the end of a program's output.
const KEPT: usize = 50;

/// The maximum length of a line of output, in bytes. The rest of a longer line counts as further lines.
const LINE: u64 = 4096;

/// The last lines that a process has written.
pub(super) type Said = Arc<Mutex<VecDeque<String>>>;

/// A started controller program.
#[derive(Debug)]
pub(super) struct Program {
    group: Group,
    said: Said,
    readers: Vec<JoinHandle<()>>,
}

impl Program {
    /// Starts a program in a folder, with values for the placeholders in its arguments.
    pub(super) fn start(words: &[String], values: &[(&str, String)], folder: &Path) -> io::Result<Self> {
        let filled = |word: &String| values.iter().fold(word.clone(), |word, (name, value)| word.replace(name, value));
        let mut words = words.iter().map(filled);
        let program = words.next().unwrap_or_default();
        // A name without a folder is looked up in PATH.
        let has_folder = Path::new(&program).components().count() > 1;
        let path = if has_folder { std::path::absolute(folder.join(program))? } else { program.into() };
        let mut command = Command::new(path);
        command.args(words).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut group = Group::start(&mut command)?;
        let said = Said::default();
        let mut readers = Vec::new();
        readers.extend(group.child().stdout.take().map(|pipe| read(pipe, &said, KEPT)));
        readers.extend(group.child().stderr.take().map(|pipe| read(pipe, &said, KEPT)));
        Ok(Self { group, said, readers })
    }

    /// Returns whether the program has ended. Its children may still run.
    pub(super) fn has_ended(&mut self) -> bool {
        self.group.has_ended()
    }

    /// Ends the program with its children; returns the last lines of its output.
    pub(super) fn end(mut self) -> String {
        self.group.end();
        // A child that has left the group may keep the pipe open.
        for reader in self.readers.drain(..).filter(JoinHandle::is_finished) {
            let _ = reader.join();
        }
        text(&self.said)
    }
}

/// Returns the lines as one text.
pub(super) fn text(said: &Said) -> String {
    let said = said.lock().unwrap_or_else(PoisonError::into_inner);
    said.iter().cloned().collect::<Vec<_>>().join("\n")
}

/// Reads a pipe on a new thread, so that the pipe never fills up. Keeps the last `kept` lines.
pub(super) fn read(pipe: impl Read + Send + 'static, said: &Said, kept: usize) -> JoinHandle<()> {
    let said = said.clone();
    thread::spawn(move || {
        let (mut pipe, mut line) = (BufReader::new(pipe), Vec::new());
        while matches!((&mut pipe).take(LINE).read_until(b'\n', &mut line), Ok(1..)) {
            let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
            said.push_back(String::from_utf8_lossy(&line).trim_end().to_owned());
            line.clear();
            if said.len() > kept {
                said.pop_front();
            }
        }
    })
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    fn sh(script: &str) -> Program {
        let values = [("{bus}", "socketcand://x:1/pve0".to_owned())];
        let words = ["sh", "-c", script, "sh", "{bus}"].map(str::to_owned);
        Program::start(&words, &values, Path::new(".")).expect("a shell")
    }

    #[test]
    fn output_is_kept_and_the_end_is_noticed() {
        let mut program = sh("echo \"on $1\"; for n in $(seq 60); do echo $n >&2; done; exit 3");
        while !program.has_ended() {
            thread::yield_now();
        }
        while !program.readers.iter().all(JoinHandle::is_finished) {
            thread::yield_now();
        }
        let said = program.end();
        assert_eq!(said.lines().count(), KEPT, "{said}");
        assert!(said.contains("60"), "{said}");
    }

    #[test]
    fn a_line_without_an_end_is_kept_in_pieces() {
        let program = sh("head -c 1000000 /dev/zero | tr '\\0' x");
        while !program.readers.iter().all(JoinHandle::is_finished) {
            thread::yield_now();
        }
        let said = program.end();
        assert_eq!(said.lines().count(), KEPT);
        assert!(said.lines().all(|line| line.len() <= LINE as usize));
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
