//! `pve-sim run`: the world paced by the wall clock, with its clients, its trace and its memory.
//!
//! ```text
//! mod       from the options to a running simulator, and to its end
//! setup     devices with their memories, put into a world
//! pace      wall time ↔ virtual time
//! driver    the thread of the world: events, clients, traces
//! clients   the world's end of every gateway
//! printer   stdout and stderr, on a thread of their own: neither may hold the world up
//! log       the file of --log
//! ```
//!
//! The world has one thread and shares nothing. The gateways run on another, which is also the one that waits for the
//! signal to end.

mod clients;
mod driver;
mod log;
mod pace;
mod printer;
mod setup;

pub use driver::Driver;
pub use pace::Pace;

use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::mpsc::channel;
use std::thread;

use tokio::runtime;
use tokio::sync::oneshot;

use crate::cli::{BusUrl, RunOptions};
use crate::gateway::ToWorld;
use crate::gateway::socketcand::Server;
use crate::memory::StateFileError;
use crate::trace::Timestamp;
use log::Log;
use printer::Printer;

/// Why the simulator could not start; one line that names what is in the way.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// An address in use, or none of this machine.
    #[error("{url}: {source}")]
    Bind {
        /// The bus that was to be served.
        url: String,
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

/// Runs until SIGINT or SIGTERM; everything that devices had to store is stored then.
///
/// # Errors
/// [`RunError`] when it cannot start. Nothing is on stdout then.
pub fn run(options: &RunOptions) -> Result<(), RunError> {
    let runtime = runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut end = Signal::listen()?;
        let (inbox, messages) = channel();
        let mut bound = Vec::new();
        let mut servers = Vec::new();
        for url in &options.buses {
            let bind = |source| RunError::Bind { url: url.to_string(), source };
            let server = Server::bind(&url.authority(), &url.name).await.map_err(bind)?;
            bound.push((server.address().map_err(bind)?, url));
            servers.push(server);
        }
        // Only now: a second simulator that finds the port taken must not touch the files of the first.
        let (world, warnings) = setup::world(options)?;
        let log = options.log.as_deref().map(Log::create).transpose()?;
        announce(&bound);
        for server in servers {
            tokio::spawn(server.run(inbox.clone()));
        }
        let printer = Printer::start()?;
        for warning in warnings {
            printer.warn(warning);
        }
        let bus = options.buses.first().map_or("can0", |url| url.name.as_str());
        let driver = Driver::new(
            world,
            setup::explainer(options),
            bus,
            Pace::start(options.speed),
            Timestamp::now(),
            printer,
            log,
        );
        let (alive, ended) = oneshot::channel::<()>();
        let bit_rate = options.bit_rate;
        let world = thread::Builder::new().name("world".to_owned()).spawn(move || {
            let _alive = alive;
            driver.run(bit_rate, &messages);
        })?;
        tokio::select! {
            () = end.received() => {}
            // The sender is never used: the receiver wakes up when the thread is gone.
            _ = ended => {}
        }
        let _ = inbox.send(ToWorld::Stop);
        if let Err(panic) = world.join() {
            std::panic::resume_unwind(panic);
        }
        Ok(())
    })
}

/// The ready line on stdout and the hint on stderr. Nobody has to read either.
fn announce(bound: &[(SocketAddr, &BusUrl)]) {
    let urls: String = bound.iter().map(|(address, url)| format!(" bus=socketcand://{address}/{}", url.name)).collect();
    let mut stdout = io::stdout().lock();
    let _ = writeln!(stdout, "pve-sim ready{urls}").and_then(|()| stdout.flush());
    let mut stderr = io::stderr().lock();
    for (address, url) in bound {
        let (host, port, name) = (address.ip(), address.port(), &url.name);
        let _ = writeln!(
            stderr,
            "Join the bus with python-can:\n  \
             can_logger -i socketcand -c {name} --bus-kwargs host={host} port={port}\n  \
             can.Bus(interface=\"socketcand\", host=\"{host}\", port={port}, channel=\"{name}\")"
        );
    }
}

/// What ends the simulator.
#[cfg(unix)]
struct Signal {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Signal {
    fn listen() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self { interrupt: signal(SignalKind::interrupt())?, terminate: signal(SignalKind::terminate())? })
    }

    async fn received(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}

/// What ends the simulator.
#[cfg(not(unix))]
struct Signal;

#[cfg(not(unix))]
impl Signal {
    fn listen() -> io::Result<Self> {
        Ok(Self)
    }

    async fn received(&mut self) {
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    }
}
