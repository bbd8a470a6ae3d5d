//! The gateway on a pseudo-terminal, for clients that open a serial device; serves one client at a time.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;

use super::session::Session;
use super::terminal::Terminal;
use crate::gateway::Gateway;
use crate::gateway::session::{End, serve};
use crate::inbox::{ToWorld, WorldSender};

/// The polling interval for a client: the system does not report when a client opens the terminal.
const LOOK: Duration = Duration::from_millis(20);

/// The delay before the next attempt after an error.
const RETRY: Duration = Duration::from_secs(1);

/// Opens the gateway: a pseudo-terminal with a link to it at `path`.
pub(in crate::gateway) fn open(path: &Path) -> io::Result<Gateway> {
    let terminal = Terminal::open(path)?;
    let path = path.display();
    let url = format!("slcan+pty:{path}");
    let hint = format!(
        "Join the bus with python-can and pyserial, or with slcand:\n  \
         can_logger -i slcan -c {path} --bus-kwargs sleep_after_open=0\n  \
         can.Bus(interface=\"slcan\", channel=\"{path}\", sleep_after_open=0)\n  \
         sudo slcand -o -c $(readlink {path}) can0 && sudo ip link set can0 up"
    );
    Ok(Gateway::new(url.clone(), hint, |world, _| run(terminal, url.into(), world)))
}

/// Serves one client after the other, forever.
async fn run(mut terminal: Terminal, url: Arc<str>, world: WorldSender) {
    loop {
        while !terminal.is_in_use() {
            sleep(LOOK).await;
        }
        let done = match terminal.halves() {
            Ok((reader, writer)) => {
                let session = Session::new(Arc::clone(&url));
                // The time to open the bus is unlimited: no other client waits for the place.
                let end = serve(reader, writer, world.clone(), None, Duration::ZERO, session).await;
                // The next client may have opened the terminal already, and keeps it. A dismissed client sees a
                // hang-up, as from an unplugged adapter.
                if end == End::Left && terminal.reset().is_ok() { Ok(()) } else { terminal.renew() }
            }
            Err(error) => Err(error),
        };
        if let Err(error) = done {
            world.tell(ToWorld::Warn(format!("{url}: {error}")));
            sleep(RETRY).await;
        }
    }
}
