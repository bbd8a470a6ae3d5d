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
pub(crate) use options::{DEFAULT_HTTP, DEFAULT_SEED, seed};
pub use platform::Platform;
pub use stdin::Lines;
pub(crate) use system::{Signals, open_exclusively};

use std::fmt::Display;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{SystemTime, UNIX_EPOCH};

use tokio::runtime;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;

use crate::control::ControlServer;
use crate::gateway::{BusUrl, Gateway, WAITING, joinable};
use crate::http;
use crate::inbox::WorldSender;
use clients::Clients;
use editor::Typing;
use end::End;
use hal_sim::campaign::Judge;
use hal_sim::log::Timestamp;
use hal_sim::memory::MemoryFileError;
use hal_sim::simulation::Simulation;
use log::Log;
use printer::Printer;
use trace::Trace;

/// The reason why the simulator could not start, in one line.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct RunError(String);

impl RunError {
    /// Creates the error of a file or folder that cannot be opened, or that a log must not replace.
    fn file(path: &Path, reason: impl Display) -> Self {
        Self(format!("{}: {reason}", path.display()))
    }
}

/// The system has no threads, signals or events left.
impl From<io::Error> for RunError {
    fn from(error: io::Error) -> Self {
        Self(format!("system error: {error}"))
    }
}

/// A state file cannot be used.
impl From<MemoryFileError> for RunError {
    fn from(error: MemoryFileError) -> Self {
        Self(error.to_string())
    }
}

/// Binds the address of the control interface; port 0 selects a free one. The error has a remedy if the port is in use.
fn bind(address: SocketAddr) -> Result<TcpListener, RunError> {
    TcpListener::bind(address).map_err(|error| {
        let remedy = match error.kind() {
            io::ErrorKind::AddrInUse => {
                "; is another pve-sim running? --http 127.0.0.1:0 selects a free port, --no-http disables the control interface"
            }
            _ => "",
        };
        RunError(format!("--http {address}: {error}{remedy}"))
    })
}

/// Returns the remedy for an address of the control interface that is in use as well as a bus; empty if it is free.
fn also_in_use(http: Option<SocketAddr>) -> String {
    let is_in_use =
        |address: &SocketAddr| TcpListener::bind(address).is_err_and(|error| error.kind() == io::ErrorKind::AddrInUse);
    http.filter(is_in_use).map_or_else(String::new, |address| {
        format!("; {address} is also in use: --http 127.0.0.1:0 selects a free port")
    })
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
/// For a cell of a campaign, the simulation contains the unpowered devices, and the judge injects the fault.
///
/// # Errors
/// [`RunError`] when the run cannot start; nothing has been printed on stdout.
pub fn run(options: &RunOptions, cell: Option<(Simulation, Judge)>) -> Result<bool, RunError> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    let result = runtime.block_on(async {
        let mut end = End::install()?;
        let running = tokio::select! {
            running = start(options, cell, end.stop.clone()) => running?,
            // No device has run, so no record is pending.
            () = end.wait() => return Ok(true),
        };
        end.wait().await;
        running.world_sender.end();
        Ok(running.world.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    // A pending name look-up must not delay the exit.
    runtime.shutdown_background();
    result
}

/// A simulator with all its sockets and its world.
struct Running {
    world_sender: WorldSender,
    world: JoinHandle<bool>,
    /// Restores the terminal on drop.
    _typing: Option<Typing>,
}

async fn start(
    options: &RunOptions,
    cell: Option<(Simulation, Judge)>,
    stop: CancellationToken,
) -> Result<Running, RunError> {
    let mut gateways = Vec::new();
    for url in &options.buses {
        let opened = url.open(options.beacon, options.allow_remote).await;
        let error = |error| RunError(format!("{url}: {error}{}", also_in_use(options.http())));
        gateways.push(opened.map_err(error)?);
    }
    let listener = options.http().map(bind).transpose()?;
    let http = listener.as_ref().map(TcpListener::local_addr).transpose()?;
    // The log is checked after the ports are bound, because a second simulator that finds a port in use must not touch
    // the files of the first. The check comes before any file is created.
    if let Some(log) = &options.log {
        Log::check(log, options.state.as_deref())?;
    }
    let (mut simulation, warnings, judge) = match cell {
        Some((simulation, judge)) => (simulation, Vec::new(), Some(judge)),
        None => {
            let options = options.clone();
            // On a separate thread, so that a signal can end the wait. The process exits without joining that thread.
            let created = tokio::task::spawn_blocking(move || setup::simulation(&options));
            let (simulation, warnings) = created.await.map_err(io::Error::from)??;
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
        Some(typing) => Printer::start(typing.screen(), typing.screen(), stop.clone())?,
        None => Printer::start(io::stdout(), io::stderr(), stop.clone())?,
    };
    announce(&printer, &gateways, http, warnings);
    let (world_sender, inbox) = WorldSender::new();
    let (clients, connections) = places(options);
    let places = Arc::new(Semaphore::new(clients));
    for gateway in gateways {
        gateway.start(world_sender.clone(), Arc::clone(&places));
    }
    if let Some(listener) = listener {
        http::start(listener, world_sender.clone(), connections)?;
    }
    match &typing {
        Some(typing) => typing.listen(world_sender.clone(), &options.devices, stop.clone()),
        None => stdin::listen(world_sender.clone()),
    }
    let layout = trace::layout(options.color, options.verbose);
    let trace = Trace::new(bus, printer, log, layout);
    let clients = Clients::new(simulation.world_mut(), options.error_frames);
    let control = http.map(|_| ControlServer::new(options.speed, judge, &mut simulation));
    let driver = Driver::new(simulation, clients, control, inbox, options.speed, start, trace);
    let world = thread::Builder::new().name("world".to_owned()).spawn(move || {
        // A run without its world ends.
        let _stop = stop.drop_guard();
        system::disable_timer_slack();
        driver.run()
    })?;
    Ok(Running { world_sender, world, _typing: typing })
}

/// Returns the maximum numbers of bus clients and of control connections. Both are limited so that enough file
/// descriptors remain for the devices' files.
fn places(options: &RunOptions) -> (usize, usize) {
    let taken = DESCRIPTORS + options.devices.len() + options.buses.len() * (1 + WAITING);
    let limit = system::max_open_files().and_then(|limit| usize::try_from(limit).ok());
    let left = limit.map_or(usize::MAX, |limit| limit.saturating_sub(taken));
    let clients = if options.no_http { left } else { left / 2 }.clamp(1, CLIENTS);
    (clients, left.saturating_sub(clients).clamp(1, HTTP_CLIENTS))
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
