//! The gateway on a pseudo-terminal, for clients that open a serial device; serves one client at a time.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::time::sleep;

use super::session::Session;
use super::terminal::Terminal;
use crate::gateway::session::{End, Limits, serve};
use crate::gateway::{Access, Address, Gateway, OpenError, Opening, Parse, Scheme};
use crate::inbox::{ToWorld, WorldSender};

const FORM: &str = "slcan+pty:PATH";

/// The URL scheme of this gateway.
pub(in crate::gateway) const SCHEME: Scheme = Scheme { prefix: "slcan+pty:", form: FORM, parse: Parse::With(parse) };

/// The polling interval for a client: the system does not report when a client opens the terminal.
const LOOK: Duration = Duration::from_millis(20);

/// The delay before the next attempt after an error.
const RETRY: Duration = Duration::from_secs(1);

/// The path of the link to the terminal.
#[derive(Clone, Debug)]
struct LinkPath(PathBuf);

fn parse(path: &str) -> Result<Arc<dyn Address>, String> {
    // In the ready line, a space ends each URL.
    if path.is_empty() || path.chars().any(|c| c.is_whitespace() || c.is_control()) {
        return Err(format!(
            "'{path}' is not a valid path for a link; accepted: {FORM}, without spaces, as in slcan+pty:/tmp/pve0"
        ));
    }
    Ok(Arc::new(LinkPath(path.into())))
}

impl fmt::Display for LinkPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slcan+pty:{}", self.0.display())
    }
}

impl Address for LinkPath {
    fn open(&self, _: Access) -> Opening<'_> {
        Box::pin(async move {
            let terminal = Terminal::open(&self.0).map_err(OpenError::from)?;
            Ok(Box::new(Pty { address: self.clone(), terminal }) as Box<dyn Gateway>)
        })
    }
}

/// An adapter on a pseudo-terminal.
#[derive(Debug)]
struct Pty {
    address: LinkPath,
    terminal: Terminal,
}

impl Gateway for Pty {
    fn url(&self) -> String {
        self.address.to_string()
    }

    fn hint(&self) -> String {
        let path = self.address.0.display();
        format!(
            "Join the bus with python-can and pyserial, or with slcand:\n  \
             can_logger -i slcan -c {path} --bus-kwargs sleep_after_open=0\n  \
             can.Bus(interface=\"slcan\", channel=\"{path}\", sleep_after_open=0)\n  \
             sudo slcand -o -c $(readlink {path}) can0 && sudo ip link set can0 up"
        )
    }

    fn start(self: Box<Self>, world: WorldSender, _: Arc<Semaphore>) {
        tokio::spawn(self.run(world));
    }
}

impl Pty {
    /// Serves one client after the other, forever.
    async fn run(mut self: Box<Self>, world: WorldSender) {
        let url = self.url();
        let name: Arc<str> = url.as_str().into();
        // The time to open the bus is unlimited: no other client waits for the place.
        let limits = Limits { patience: None, farewell: Duration::ZERO };
        loop {
            while !self.terminal.is_in_use() {
                sleep(LOOK).await;
            }
            let done = match self.terminal.halves() {
                Ok((reader, writer)) => {
                    let end = serve(reader, writer, world.clone(), limits, Session::new(Arc::clone(&name))).await;
                    // The next client may have opened the terminal already, and keeps it. A dismissed client sees a
                    // hang-up, as from an unplugged adapter.
                    if end == End::Left && self.terminal.reset().is_ok() { Ok(()) } else { self.terminal.renew() }
                }
                Err(error) => Err(error),
            };
            if let Err(error) = done {
                world.tell(ToWorld::Warn(format!("{url}: {error}")));
                sleep(RETRY).await;
            }
        }
    }
}
