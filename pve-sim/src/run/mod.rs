//! `pve-sim run`: the world paced by the wall clock, with its clients, its trace and its memory.
//!
//! ```text
//! mod         from the options to a running simulator, and to its end
//! options     what the user asks for
//! setup       devices with their memories, put into a world
//! end         signals, and a stdout that nobody reads
//! driver      the thread of the world: its time, its clients, its trace
//! timekeeper  the virtual time of a run, and time that gets lost
//! pace        wall time ↔ virtual time
//! platform     the wall clock and the messages of clients, as the driver sees them
//! clients     the world's end of every gateway
//! trace       the bus on stdout and in the log
//! stdin       lines that the user types
//! editor      such lines on a terminal: apart from the trace, with history and completion
//! screen      that terminal: the trace above the line being typed
//! console     faults by hand: what such a line does
//! printer     stdout and stderr, on a thread of their own: neither may hold the world up
//! log         the file of --log
//! system      what each operating system does in its own way
//! ```
//!
//! The world has one thread and shares nothing. The gateways run on another, which is also the one that waits for the
//! end.

mod clients;
mod console;
mod driver;
mod editor;
mod end;
mod log;
mod options;
mod pace;
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

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use tokio::runtime;
use tokio::sync::{Semaphore, oneshot, watch};

use crate::control::ControlServer;
use crate::gateway::{Access, BusUrl, Gateway, OpenError, WAITING, joinable};
use crate::http;
use crate::inbox::WorldSender;
use crate::state_file::StateFileError;
use clients::Clients;
use editor::Typing;
use end::End;
use hal_sim::log::Timestamp;
use log::Log;
use platform::System;
use printer::Printer;
use trace::Trace;

/// Why the simulator could not start; one line that names what is in the way.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// An address in use, or none of this machine; an interface that is not there.
    #[error("{url}: {source}{}", also_in_use(*http))]
    Bind {
        /// The bus that was to be served.
        url: BusUrl,
        /// Why not.
        source: OpenError,
        /// The control interface's address, where that is in use as well.
        http: Option<SocketAddr>,
    },
    /// The control interface's address in use, or none of this machine.
    #[error("--http {address}: {source}{}", http_way_out(source))]
    Http {
        /// The address that was to be served.
        address: SocketAddr,
        /// Why not.
        source: io::Error,
    },
    /// A file or folder that cannot be opened.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// A file that a log must not replace.
    #[error("{}: {reason}", path.display())]
    Log {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A state file that belongs to a device of another kind.
    #[error("{}: the memory of {found}, not of a {expected}", path.display())]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// Whose memory it is.
        found: String,
        /// Whose it was taken for.
        expected: &'static str,
    },
    /// A state file that cannot be used.
    #[error(transparent)]
    StateFile(#[from] StateFileError),
    /// The system has no threads, signals or events to give.
    #[error("the system refuses: {0}")]
    System(#[from] io::Error),
}

/// Returns what to do about a port of the control interface in use.
fn http_way_out(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => {
            "; does another pve-sim run? --http 127.0.0.1:0 takes a free port, --no-http does without"
        }
        _ => "",
    }
}

/// Returns the way out of a port that would be in use next.
fn also_in_use(http: Option<SocketAddr>) -> String {
    http.map_or_else(String::new, |address| format!("; {address} is in use as well: --http 127.0.0.1:0"))
}

/// Returns true where the address belongs to somebody else.
fn is_in_use(address: SocketAddr) -> bool {
    http::Server::bind(address).is_err_and(|error| error.kind() == io::ErrorKind::AddrInUse)
}

/// The most clients, on all buses together.
const CLIENTS: usize = 128;

/// The most connections of the control interface.
const HTTP_CLIENTS: usize = 256;

/// The file descriptors beside those of clients, buses with those who wait for a place there, and devices: what is open anyway, and state files while they are
/// written.
const DESCRIPTORS: usize = 32;

/// Runs until a signal (on Unix SIGINT, SIGTERM or SIGHUP), or until nobody reads stdout; everything that devices had
/// to store is stored then. Returns whether everything was stored, and the log and stdout took all that was written;
/// stderr has why not.
///
/// # Errors
/// [`RunError`] when it cannot start. Nothing is on stdout then.
pub fn run(options: &RunOptions) -> Result<bool, RunError> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    let result = runtime.block_on(async {
        let mut end = End::listen()?;
        let reader_gone = end.teller();
        let running = tokio::select! {
            running = start(options, reader_gone) => running?,
            // No device has run, nothing waits to be stored.
            () = end.come() => return Ok(true),
        };
        Ok(running.until(&mut end).await)
    });
    // Somebody may still be looking up a name: not waited for.
    runtime.shutdown_background();
    result
}

/// A simulator with all its sockets and its world.
struct Running {
    world_sender: WorldSender,
    world: JoinHandle<bool>,
    /// Ends with the world's thread.
    ended: oneshot::Receiver<()>,
    /// Restores the terminal when all is over.
    _typing: Option<Typing>,
}

async fn start(options: &RunOptions, reader_gone: watch::Sender<bool>) -> Result<Running, RunError> {
    let access = Access { beacon: options.beacon, remote: options.allow_remote };
    let mut gateways = Vec::new();
    for url in &options.buses {
        let opened = url.address().open(access).await;
        let http = || options.http.filter(|address| is_in_use(*address));
        gateways.push(opened.map_err(|source| RunError::Bind { url: url.clone(), source, http: http() })?);
    }
    let mut control = None;
    if let Some(address) = options.http {
        let bind = |source| RunError::Http { address, source };
        let server = http::Server::bind(address).map_err(bind)?;
        control = Some((server.address().map_err(bind)?, server));
    }
    let http = control.as_ref().map(|(address, _)| *address);
    // Only now: a second simulator that finds the port taken must not touch the files of the first. And nothing is made
    // before the log was found to be in nobody's way.
    if let Some(log) = &options.log {
        Log::check(log, options.state.as_deref())?;
    }
    let (mut simulation, warnings) = aside({
        let options = options.clone();
        move || setup::simulation(&options)
    })
    .await?;
    let bus = options.buses.first().map_or("can0", |url| url.address().name());
    let start = Timestamp::now();
    let log = options.log.as_ref();
    let log = log.map(|log| Log::create(log, options.state.as_deref(), bus, start)).transpose()?;
    let typing = Typing::new();
    let printer = match &typing {
        Some(typing) => Printer::start_with(typing.screen(), typing.screen(), reader_gone.clone())?,
        None => Printer::start(reader_gone.clone())?,
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
    let control = http.map(|_| ControlServer::new(options.speed, &mut simulation));
    let driver = Driver::new(simulation, clients, control, System::new(inbox), options.speed, start, trace);
    let (alive, ended) = oneshot::channel::<()>();
    let world = thread::Builder::new().name("world".to_owned()).spawn(move || {
        let _alive = alive;
        system::be_punctual();
        driver.run()
    })?;
    Ok(Running { world_sender, world, ended, _typing: typing })
}

impl Running {
    /// Waits for the end, or for the end of the world's thread; then until all is stored. Returns whether all was
    /// written.
    async fn until(self, end: &mut End) -> bool {
        tokio::select! {
            () = end.come() => {}
            // The sender is never used: the receiver wakes up when the thread is gone.
            _ = self.ended => {}
        }
        self.world_sender.end();
        self.world.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Returns the most clients of the buses, and connections of the control interface, that leave enough file descriptors
/// for devices to store.
fn places(options: &RunOptions) -> (usize, usize) {
    let taken = DESCRIPTORS + options.devices.len() + options.buses.len() * (1 + WAITING);
    let limit = system::max_open_files().and_then(|limit| usize::try_from(limit).ok());
    let left = limit.map_or(usize::MAX, |limit| limit.saturating_sub(taken));
    let clients = if options.http.is_some() { left / 2 } else { left }.clamp(1, CLIENTS);
    (clients, left.saturating_sub(clients).clamp(1, HTTP_CLIENTS))
}

/// Does work that may block, on a thread of its own: a signal ends the wait for it, and the process does not wait.
async fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    match tokio::task::spawn_blocking(work).await {
        Ok(done) => done,
        Err(panic) => std::panic::resume_unwind(panic.into_panic()),
    }
}

/// Prints the warnings of the start on stderr, the ready line on stdout and the hint on stderr. Whoever has seen the
/// ready line finds the warnings there.
fn announce(printer: &Printer, gateways: &[Box<dyn Gateway>], http: Option<SocketAddr>, warnings: Vec<String>) {
    warnings.into_iter().for_each(|warning| printer.warn(warning));
    let urls: String = gateways.iter().map(|gateway| format!(" bus={}", gateway.url())).collect();
    let control = http.map_or_else(String::new, |address| format!(" http=http://{address}/"));
    printer.trace(format!("pve-sim ready{urls}{control}\n"));
    for gateway in gateways {
        printer.note(gateway.hint());
    }
    if let Some(address) = http {
        printer.note(format!("Panel: http://{}/", joinable(address)));
    }
    printer.note("Type help for the words that change what a device senses, and status".to_owned());
}
