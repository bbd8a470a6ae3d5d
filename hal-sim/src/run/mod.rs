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
//! outside     the wall clock and the messages of clients, as the driver sees them
//! clients     the world's end of every gateway
//! trace       the bus on stdout and in the log
//! stdin       lines that the user types
//! console     faults by hand: what such a line does
//! layout      the trace as people read it on a terminal
//! errors      the error frames and error modes that are told
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
mod end;
mod errors;
mod layout;
mod log;
mod options;
mod outside;
mod pace;
mod printer;
mod setup;
mod stdin;
mod system;
mod timekeeper;
mod trace;

pub use driver::Driver;
pub use options::{ColorChoice, LogOptions, NamedDevice, NamedLink, RunOptions};
pub use outside::Outside;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use tokio::runtime;
use tokio::sync::{Semaphore, oneshot, watch};

use crate::control::{self, Desk};
#[cfg(target_os = "linux")]
use crate::gateway::socketcan::Interface;
use crate::gateway::socketcand::{Beacon, Server};
use crate::gateway::{BusUrl, Entrance, ServerUrl};
use crate::kind::Kind;
use crate::memory::StateFileError;
use crate::trace::Timestamp;
use clients::Clients;
use end::End;
use log::Log;
use outside::System;
use printer::Printer;
use trace::Trace;

/// Why the simulator could not start; one line that names what is in the way.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// An address in use, or none of this machine; an interface that is not there.
    #[error("{url}: {source}{}", way_out(url, source))]
    Bind {
        /// The bus that was to be served.
        url: BusUrl,
        /// Why not.
        source: io::Error,
    },
    /// The control interface's address in use, or none of this machine.
    #[error("--http {address}: {source}{}", http_way_out(source))]
    Http {
        /// The address that was to be served.
        address: SocketAddr,
        /// Why not.
        source: io::Error,
    },
    /// A bus that cannot be announced.
    #[error("{url}: --beacon: {source}")]
    Beacon {
        /// The bus.
        url: BusUrl,
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

/// What to do about a port in use, or an interface that is not there.
fn way_out(url: &BusUrl, error: &io::Error) -> String {
    match (url, error.kind()) {
        (BusUrl::Socketcand(server), io::ErrorKind::AddrInUse) => {
            let free = ServerUrl { port: 0, ..server.clone() };
            format!("; does another pve-sim run? --bus {free} takes a free port")
        }
        #[cfg(target_os = "linux")]
        (BusUrl::Socketcan(name), _) if error.raw_os_error() == Some(rustix::io::Errno::NODEV.raw_os_error()) => {
            format!("; 'ip link' lists the interfaces, 'ip link add {name} up type vcan' makes a virtual one")
        }
        _ => String::new(),
    }
}

/// What to do about a port of the control interface in use.
fn http_way_out(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => {
            "; does another pve-sim run? --http 127.0.0.1:0 takes a free port, --no-http does without"
        }
        _ => "",
    }
}

/// The most clients, on all buses together.
const CLIENTS: usize = 128;

/// The most connections of the control interface.
const HTTP_CLIENTS: usize = 256;

/// The file descriptors beside those of clients, buses and devices: what is open anyway, and state files while they are
/// written.
const DESCRIPTORS: usize = 32;

/// Runs until a signal (on Unix SIGINT, SIGTERM or SIGHUP), or until nobody reads stdout; everything that devices had to
/// store is stored then.
///
/// # Errors
/// [`RunError`] when it cannot start. Nothing is on stdout then.
pub fn run(options: &RunOptions) -> Result<(), RunError> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    let result = runtime.block_on(async {
        let mut end = End::listen()?;
        let reader_gone = end.teller();
        let running = tokio::select! {
            running = start(options, reader_gone) => running?,
            // No device has run, nothing waits to be stored.
            () = end.come() => return Ok(()),
        };
        running.until(&mut end).await;
        Ok(())
    });
    // Somebody may still be looking up a name: not waited for.
    runtime.shutdown_background();
    result
}

/// A simulator with all its sockets and its world.
struct Running {
    entrance: Entrance,
    world: JoinHandle<()>,
    /// Ends with the world's thread.
    ended: oneshot::Receiver<()>,
}

async fn start(options: &RunOptions, reader_gone: watch::Sender<bool>) -> Result<Running, RunError> {
    let mut bound = Vec::new();
    let mut servers = Vec::new();
    let mut beacons = Vec::new();
    #[cfg(target_os = "linux")]
    let mut interfaces = Vec::new();
    for url in &options.buses {
        let bind = |source| RunError::Bind { url: url.clone(), source };
        match url {
            BusUrl::Socketcand(place) => {
                let server = Server::bind(&place.authority(), &place.name).await.map_err(bind)?;
                let address = server.address().map_err(bind)?;
                if options.beacon {
                    let refused = |source| RunError::Beacon { url: url.clone(), source };
                    beacons.push(Beacon::new(address, &place.name).await.map_err(refused)?);
                }
                bound.push(Bound::Server(address, place.name.clone()));
                servers.push(server);
            }
            #[cfg(target_os = "linux")]
            BusUrl::Socketcan(name) => {
                interfaces.push(Interface::open(name).map_err(bind)?);
                bound.push(Bound::Interface(name.clone()));
            }
        }
    }
    let mut control = None;
    if let Some(address) = options.http {
        let bind = |source| RunError::Http { address, source };
        let server = control::Server::bind(address).map_err(bind)?;
        control = Some((server.address().map_err(bind)?, server));
    }
    let http = control.as_ref().map(|(address, _)| *address);
    // Only now: a second simulator that finds the port taken must not touch the files of the first. And nothing is made
    // before the log was found to be in nobody's way.
    if let Some(log) = &options.log {
        Log::check(log, options.state.as_deref())?;
    }
    let (mut world, warnings) = aside({
        let options = options.clone();
        move || setup::world(&options)
    })
    .await?;
    let bus = options.buses.first().map_or("can0", BusUrl::name);
    let start = Timestamp::now();
    let log = options.log.as_ref();
    let log = log.map(|log| Log::create(log, options.state.as_deref(), bus, start)).transpose()?;
    let printer = Printer::start(reader_gone)?;
    announce(&printer, &bound, http, warnings);
    let (entrance, inbox) = Entrance::new();
    for beacon in beacons {
        tokio::spawn(beacon.run());
    }
    let (clients, connections) = places(options);
    let places = Arc::new(Semaphore::new(clients));
    for server in servers {
        tokio::spawn(server.run(entrance.clone(), Arc::clone(&places)));
    }
    #[cfg(target_os = "linux")]
    for interface in interfaces {
        tokio::spawn(interface.run(entrance.clone()));
    }
    if let Some((_, server)) = control {
        server.start(entrance.clone(), connections)?;
    }
    stdin::listen(entrance.clone());
    let layout = trace::layout(options.color, options.verbose);
    let trace = Trace::new(bus, setup::explainer(options), printer, log, layout);
    let clients = Clients::new(&mut world, options.error_frames);
    let kinds: Vec<Kind> = options.devices.iter().map(|device| device.kind).collect();
    let desk = http.map(|_| Desk::new(&kinds, options.speed, &mut world));
    let driver = Driver::new(world, clients, desk, System::new(inbox), options.speed, start, trace);
    let (alive, ended) = oneshot::channel::<()>();
    let bit_rate = options.bit_rate;
    let world = thread::Builder::new().name("world".to_owned()).spawn(move || {
        let _alive = alive;
        system::be_punctual();
        driver.run(bit_rate);
    })?;
    Ok(Running { entrance, world, ended })
}

impl Running {
    /// Waits for the end, or for the end of the world's thread; then until all is stored.
    async fn until(self, end: &mut End) {
        tokio::select! {
            () = end.come() => {}
            // The sender is never used: the receiver wakes up when the thread is gone.
            _ = self.ended => {}
        }
        self.entrance.end();
        if let Err(panic) = self.world.join() {
            std::panic::resume_unwind(panic);
        }
    }
}

/// The most clients of the buses, and connections of the control interface, that leave enough file descriptors for devices
/// to store.
fn places(options: &RunOptions) -> (usize, usize) {
    let taken = DESCRIPTORS + options.devices.len() + options.buses.len();
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

/// Prints the warnings of the start on stderr, the ready line on stdout and the hint on stderr. Whoever has seen the ready
/// line finds the warnings there.
fn announce(printer: &Printer, bound: &[Bound], http: Option<SocketAddr>, warnings: Vec<String>) {
    warnings.into_iter().for_each(|warning| printer.warn(warning));
    let urls: String = bound.iter().map(|bound| format!(" bus={}", bound.url())).collect();
    let http = http.map_or_else(String::new, |address| format!(" http=http://{address}/"));
    printer.trace(format!("pve-sim ready{urls}{http}\n"));
    for bound in bound {
        printer.note(bound.hint());
    }
}

/// A bus as it is reachable.
enum Bound {
    /// A socketcand server, with the name of the bus.
    Server(SocketAddr, String),
    /// An interface of the kernel.
    #[cfg(target_os = "linux")]
    Interface(String),
}

impl Bound {
    fn url(&self) -> String {
        match self {
            Self::Server(address, name) => format!("socketcand://{address}/{name}"),
            #[cfg(target_os = "linux")]
            Self::Interface(name) => format!("socketcan:{name}"),
        }
    }

    /// What to type to join.
    fn hint(&self) -> String {
        match self {
            Self::Server(address, name) => hint(*address, name),
            #[cfg(target_os = "linux")]
            Self::Interface(name) => format!(
                "Join the bus with any tool of SocketCAN:\n  candump {name}\n  \
                 can.Bus(interface=\"socketcan\", channel=\"{name}\")"
            ),
        }
    }
}

/// What to type to join a bus, at an address that this machine reaches: nobody connects to 0.0.0.0.
fn hint(address: SocketAddr, name: &str) -> String {
    let port = address.port();
    let host = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.to_string(),
        IpAddr::V4(ip) => ip.to_string(),
        // A socket at [::] takes IPv4, too.
        IpAddr::V6(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.to_string(),
        IpAddr::V6(ip) => {
            return format!(
                "Join the bus at can://[{ip}]:{port}, name {name}. python-can knows IPv4 addresses only: for that, \
                 --bus socketcand://127.0.0.1:{port}/{name}"
            );
        }
    };
    format!(
        "Join the bus with python-can:\n  \
         can_logger -i socketcand -c {name} --bus-kwargs host={host} port={port}\n  \
         can.Bus(interface=\"socketcand\", host=\"{host}\", port={port}, channel=\"{name}\")\n\
         or with SavvyCAN: {name}@(can://{host}:{port})"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hint_at(address: &str) -> String {
        hint(address.parse().expect(address), "pve0")
    }

    #[test]
    fn the_hint_names_an_address_that_works() {
        for (bound, host) in [("127.0.0.2:7", "127.0.0.2"), ("0.0.0.0:7", "127.0.0.1"), ("[::]:7", "127.0.0.1")] {
            let text = hint_at(bound);
            assert!(text.contains(&format!("host={host} port=7\n")), "{text}");
            assert!(text.contains(&format!("host=\"{host}\", port=7, channel=\"pve0\"")), "{text}");
            assert!(text.contains(&format!("pve0@(can://{host}:7)")), "{text}");
        }
        let text = hint_at("[::1]:7");
        assert!(text.contains("can://[::1]:7") && text.contains("--bus socketcand://127.0.0.1:7/pve0"), "{text}");
    }

    #[test]
    fn a_port_in_use_names_the_way_out() {
        let url: BusUrl = "socketcand://127.0.0.1:29536/pve0".parse().expect("a bus");
        let told = |kind: io::ErrorKind| RunError::Bind { url: url.clone(), source: kind.into() }.to_string();
        assert!(told(io::ErrorKind::AddrInUse).ends_with("--bus socketcand://127.0.0.1:0/pve0 takes a free port"));
        assert!(!told(io::ErrorKind::PermissionDenied).contains("--bus"));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn an_interface_that_is_not_there_names_the_way_out() {
        let url: BusUrl = "socketcan:can0".parse().expect("a bus");
        let told = |errno: rustix::io::Errno| RunError::Bind { url: url.clone(), source: errno.into() }.to_string();
        let missing = told(rustix::io::Errno::NODEV);
        assert!(missing.starts_with("socketcan:can0: No such device"), "{missing}");
        assert!(
            missing.ends_with("; 'ip link' lists the interfaces, 'ip link add can0 up type vcan' makes a virtual one")
        );
        assert!(!told(rustix::io::Errno::ACCESS).contains("ip link"));
    }
}
