//! Cells whose controller is a program. Each cell has its own simulator process at the speed of the plan. The program
//! joins the bus of this simulator, and the control interface returns the verdict.

use std::io::{self, BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use hal_sim::campaign::Verdict;

use super::process::Group;
use super::program::{Program, Said, read, text};
use super::results::Cell;
use crate::control::{Judged, JudgedCell};

/// The time between two requests for the verdict.
const PAUSE: Duration = Duration::from_millis(20);
/// The wall-clock time beyond the duration of the cell after which a program hangs. Virtual time begins when the program
/// has joined the bus.
const PATIENCE: Duration = Duration::from_secs(120);
/// The number of lines kept, from the end of the trace.
const KEPT: usize = 200;
/// The line between the trace and the output of the program.
pub(super) const OUTPUT: &str = "-- output of the controller:\n";

/// The setup for cells whose controller is a program.
#[derive(Clone, Debug)]
pub(super) struct Live {
    /// The program with its arguments.
    pub(super) controller: Vec<String>,
    pub(super) plan: PathBuf,
    pub(super) seed: Option<u64>,
    pub(super) speed: f64,
}

/// A simulator that judges a cell.
struct Simulator {
    _group: Group,
    /// The URLs of the bus and of the control interface.
    bus: String,
    http: String,
    trace: Said,
}

impl Live {
    /// Returns the folder of the plan, in which the program runs.
    fn folder(&self) -> PathBuf {
        let folder = self.plan.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.map_or_else(|| PathBuf::from("."), Path::to_owned)
    }

    /// Runs a cell. Returns its result, and its trace with the output of the program.
    pub(super) fn run(&self, number: u64, at_us: u64) -> io::Result<(Cell, String)> {
        let simulator = Simulator::start(self, number)?;
        let words = &self.controller;
        let name = |error: io::Error| {
            io::Error::new(error.kind(), format!("controller {}: {error}", words.first().map_or("", String::as_str)))
        };
        let values = [("{bus}", simulator.bus.clone()), ("{speed}", self.speed.to_string())];
        let mut program = Program::start(words, &values, &self.folder()).map_err(name)?;
        let began = Instant::now();
        let judged = loop {
            // The program's end is read before the verdict, so that an earlier verdict counts.
            let has_ended = program.has_ended();
            let cell = simulator.ask()?;
            if let Some(judged) = cell.result {
                break judged;
            }
            let longest = Duration::from_micros(cell.until_us).div_f64(self.speed.max(1e-6)) + PATIENCE;
            if has_ended || began.elapsed() > longest {
                break Judged { verdict: Verdict::Hung, detected_us: None, safe_us: None, struck: 0, reason: None };
            }
            thread::sleep(PAUSE);
        };
        let said = program.end();
        let Judged { verdict, detected_us, safe_us, struck, reason } = judged;
        let cell = Cell { number: Some(number), at_us, verdict, detected_us, safe_us, struck };
        let reason = reason.map_or_else(String::new, |reason| format!("-- {reason}\n"));
        Ok((cell, format!("{}\n{reason}{OUTPUT}{said}", text(&simulator.trace)).trim_end().to_owned()))
    }
}

impl Simulator {
    fn start(live: &Live, number: u64) -> io::Result<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command
            .args(["run", "--bus", "socketcand://127.0.0.1:0/pve0", "--http", "127.0.0.1:0", "--plan"])
            .arg(&live.plan);
        command.args(["--cell", &number.to_string(), "--speed", &live.speed.to_string()]);
        if let Some(seed) = live.seed {
            command.args(["--plan-seed", &seed.to_string()]);
        }
        // The simulator ends when its stdout has no reader, so it also ends with this process.
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut group = Group::start(&mut command)?;
        let mut stdout = BufReader::new(group.child().stdout.take().ok_or(io::ErrorKind::BrokenPipe)?);
        let mut ready = String::new();
        stdout.read_line(&mut ready)?;
        let word = |mark: &str| ready.split_whitespace().find_map(|word| word.strip_prefix(mark)).map(str::to_owned);
        let (Some(bus), Some(http)) = (word("bus="), word("http=")) else {
            return Err(io::Error::other(format!("cell {number}: the simulator did not start")));
        };
        let trace = Said::default();
        read(stdout, &trace, KEPT);
        Ok(Self { _group: group, bus, http, trace })
    }

    fn ask(&self) -> io::Result<JudgedCell> {
        let answer = ureq::get(format!("{}api/v1/cell", self.http)).call().map_err(io::Error::other)?;
        serde_json::from_reader(answer.into_body().into_reader()).map_err(io::Error::other)
    }
}
