//! `pve-sim run`: the world paced by the wall clock, with its clients, its trace and its memory.
//!
//! ```text
//! mod         a run, from its options to its end
//! options     the options of run
//! setup       the simulation, built from the options
//! end         the end of a run: a signal, or a closed stdout
//! driver      the loop of the world's thread
//! timekeeper  the virtual time of a run, its pace, and lost time
//! platform    the wall clock and the messages of clients, which tests of the driver replace
//! clients     the clients of all gateways, on the world's thread
//! trace       the bus on stdout and in the log
//! stdin       the lines on stdin
//! editor      the line editor on a terminal, with history and completion
//! screen      the terminal: the trace above the line being typed
//! console     executes the lines of the console
//! fault_words executes the console's lines about communication faults
//! printer     writes stdout and stderr on a separate thread, so that neither blocks the world
//! log         the file of --log
//! system      the differences between operating systems
//! ```
//!
//! The world runs on its own thread and shares nothing. The gateways run on another thread, which also waits for the
//! end of the run.

mod clients;
mod console;
mod driver;
mod editor;
mod end;
mod fault_words;
mod log;
mod options;
mod platform;
mod printer;
mod screen;
mod setup;
mod stdin;
mod system;
mod timekeeper;
mod trace;

pub use driver::Driver;
pub use options::{ColorChoice, LogOptions, RunOptions};
pub use platform::Platform;
pub use stdin::Lines;
pub(crate) use system::Signals;

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{SystemTime, UNIX_EPOCH};

use tokio::runtime;
use tokio::sync::{Semaphore, oneshot, watch};

use crate::control::ControlServer;
use crate::gateway::{BusUrl, Gateway, WAITING, joinable};
use crate::http;
use crate::inbox::WorldSender;
use crate::state_file::StateFileError;
use clients::Clients;
use editor::Typing;
use end::End;
use hal_sim::campaign::Judge;
use hal_sim::log::Timestamp;
use hal_sim::simulation::Simulation;
use log::Log;
use platform::System;
use printer::Printer;
use trace::Trace;

/// The reason why the simulator could not start, in one line.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A bus cannot be opened: its address is in use or not of this machine, or its interface does not exist. The last
    /// field is the address of the control interface, if that address is also in use.
    #[error("{0}: {1}{hint}", hint = also_in_use(*.2))]
    Bind(BusUrl, #[source] io::Error, Option<SocketAddr>),
    /// The address of the control interface is in use or not of this machine.
    #[error("--http {0}: {1}{remedy}", remedy = http_remedy(.1))]
    Http(SocketAddr, #[source] io::Error),
    /// A file or folder that cannot be opened, or that a log must not replace.
    #[error("{file}: {1}", file = .0.display())]
    File(PathBuf, #[source] io::Error),
    /// A state file that cannot be used.
    #[error(transparent)]
    StateFile(#[from] StateFileError),
    /// The system has no threads, signals or events left.
    #[error("system error: {0}")]
    System(#[from] io::Error),
}

/// Returns the remedy if the port of the control interface is in use.
fn http_remedy(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => {
            "; is another pve-sim running? --http 127.0.0.1:0 selects a free port, --no-http disables the control interface"
        }
        _ => "",
    }
}

/// Returns the remedy for an address of the control interface that is also in use; empty for `None`.
fn also_in_use(http: Option<SocketAddr>) -> String {
    http.map_or_else(String::new, |address| {
        format!("; {address} is also in use: --http 127.0.0.1:0 selects a free port")
    })
}

/// Returns whether the address of the control interface is already in use.
fn is_in_use(address: SocketAddr) -> bool {
    http::Server::bind(address).is_err_and(|error| error.kind() == io::ErrorKind::AddrInUse)
}

/// The maximum number of clients on all buses.
const CLIENTS: usize = 128;

/// The maximum number of connections of the control interface.
const HTTP_CLIENTS: usize = 256;

/// The number of file descriptors reserved for permanently open files, and for state files during a write. Descriptors
/// of clients, buses, waiting clients and devices are counted separately.
const DESCRIPTORS: usize = 32;

/// Runs until a signal (on Unix SIGINT, SIGTERM or SIGHUP) or until stdout is closed, and then stores the records of
/// all devices. Returns whether everything was stored, and the log and stdout are complete; otherwise stderr has the
/// reasons.
///
/// # Errors
/// [`RunError`] when the run cannot start; nothing has been printed on stdout.
pub fn run(options: &RunOptions) -> Result<bool, RunError> {
    run_of(options, None)
}

/// Runs a cell of a campaign as [`run`] does. `simulation` contains the unpowered devices; `judge` injects the fault.
///
/// # Errors
/// [`RunError`], as [`run`].
pub fn judge(options: &RunOptions, simulation: Simulation, judge: Judge) -> Result<bool, RunError> {
    run_of(options, Some((simulation, judge)))
}

fn run_of(options: &RunOptions, cell: Option<(Simulation, Judge)>) -> Result<bool, RunError> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    let result = runtime.block_on(async {
        let mut end = End::install()?;
        let reader_gone = end.closed_sender();
        let running = tokio::select! {
            running = start(options, cell, reader_gone) => running?,
            // No device has run, so no record is pending.
            () = end.wait() => return Ok(true),
        };
        Ok(running.until(&mut end).await)
    });
    // A pending name look-up must not delay the exit.
    runtime.shutdown_background();
    result
}

/// A simulator with all its sockets and its world.
struct Running {
    world_sender: WorldSender,
    world: JoinHandle<bool>,
    /// Resolves when the world's thread ends.
    ended: oneshot::Receiver<()>,
    /// Restores the terminal on drop.
    _typing: Option<Typing>,
}

async fn start(
    options: &RunOptions,
    cell: Option<(Simulation, Judge)>,
    reader_gone: watch::Sender<bool>,
) -> Result<Running, RunError> {
    let mut gateways = Vec::new();
    for url in &options.buses {
        let opened = url.open(options.beacon, options.allow_remote).await;
        let http = || options.http.filter(|address| is_in_use(*address));
        gateways.push(opened.map_err(|error| RunError::Bind(url.clone(), error, http()))?);
    }
    let mut control = None;
    if let Some(address) = options.http {
        let bind = |error| RunError::Http(address, error);
        let server = http::Server::bind(address).map_err(bind)?;
        control = Some((server.address().map_err(bind)?, server));
    }
    let http = control.as_ref().map(|(address, _)| *address);
    // The log is checked after the ports are bound, because a second simulator that finds a port in use must not touch
    // the files of the first. The check comes before any file is created.
    if let Some(log) = &options.log {
        Log::check(log, options.state.as_deref())?;
    }
    let (mut simulation, warnings, judge) = match cell {
        Some((simulation, judge)) => (simulation, Vec::new(), Some(judge)),
        None => {
            let options = options.clone();
            let (simulation, warnings) = run_blocking(move || setup::simulation(&options)).await?;
            (simulation, warnings, None)
        }
    };
    let bus = options.buses.first().map_or("can0", BusUrl::name);
    // A clock before 1970 yields 1970.
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let start = Timestamp::from_micros(u64::try_from(since.as_micros()).unwrap_or(u64::MAX));
    let log = options.log.as_ref();
    let log = log.map(|log| Log::create(log, options.state.as_deref(), bus, start)).transpose()?;
    let typing = Typing::new();
    let printer = match &typing {
        Some(typing) => Printer::start(typing.screen(), typing.screen(), reader_gone.clone())?,
        None => Printer::start(io::stdout(), io::stderr(), reader_gone.clone())?,
    };
    announce(&printer, &gateways, http, warnings);
    let (world_sender, inbox) = WorldSender::new();
    let (clients, connections) = places(options);
    let places = Arc::new(Semaphore::new(clients));
    for gateway in gateways {
        gateway.start(world_sender.clone(), Arc::clone(&places));
    }
    if let Some((_, server)) = control {
        server.start(world_sender.clone(), connections)?;
    }
    match &typing {
        Some(typing) => typing.listen(world_sender.clone(), &options.devices, reader_gone),
        None => stdin::listen(world_sender.clone()),
    }
    let layout = trace::layout(options.color, options.verbose);
    let trace = Trace::new(bus, printer, log, layout);
    let clients = Clients::new(simulation.world_mut(), options.error_frames);
    let mut control = http.map(|_| ControlServer::new(options.speed, &mut simulation));
    if let Some(control) = &mut control {
        control.judge(judge);
    }
    let driver = Driver::new(simulation, clients, control, System::new(inbox), options.speed, start, trace);
    let (alive, ended) = oneshot::channel::<()>();
    let world = thread::Builder::new().name("world".to_owned()).spawn(move || {
        let _alive = alive;
        system::disable_timer_slack();
        driver.run()
    })?;
    Ok(Running { world_sender, world, ended, _typing: typing })
}

impl Running {
    /// Waits for the end of the run or of the world's thread, ends the world, and waits until all records are stored.
    /// Returns whether everything was stored and all output is complete.
    async fn until(self, end: &mut End) -> bool {
        tokio::select! {
            () = end.wait() => {}
            // The sender is never used: the receiver resolves when the thread ends.
            _ = self.ended => {}
        }
        self.world_sender.end();
        self.world.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Returns the maximum numbers of bus clients and of control connections. Both are limited so that enough file
/// descriptors remain for the devices' files.
fn places(options: &RunOptions) -> (usize, usize) {
    let taken = DESCRIPTORS + options.devices.len() + options.buses.len() * (1 + WAITING);
    let limit = system::max_open_files().and_then(|limit| usize::try_from(limit).ok());
    let left = limit.map_or(usize::MAX, |limit| limit.saturating_sub(taken));
    let clients = if options.http.is_some() { left / 2 } else { left }.clamp(1, CLIENTS);
    (clients, left.saturating_sub(clients).clamp(1, HTTP_CLIENTS))
}

/// Runs blocking work on a separate thread, so that a signal can end the wait. The process exits without joining that
/// thread.
async fn run_blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => done,
        Err(panic) => std::panic::resume_unwind(panic.into_panic()),
    }
}

/// Prints the warnings of the start on stderr, the ready line on stdout and the hints on stderr. The warnings come
/// before the ready line.
fn announce(printer: &Printer, gateways: &[Gateway], http: Option<SocketAddr>, warnings: Vec<String>) {
    warnings.into_iter().for_each(|warning| printer.warn(warning));
    let urls: String = gateways.iter().map(|gateway| format!(" bus={}", gateway.url)).collect();
    let control = http.map_or_else(String::new, |address| format!(" http=http://{address}/"));
    printer.trace(format!("pve-sim ready{urls}{control}\n"));
    for gateway in gateways {
        printer.note(gateway.hint.clone());
    }
    if let Some(address) = http {
        printer.note(format!("Panel: http://{}/", joinable(address)));
    }
    printer.note("Type help for the console commands".to_owned());
}
