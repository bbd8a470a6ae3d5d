//! slcan: the ASCII protocol of serial-line adapters (Lawicel CAN232 and CANUSB), over TCP or on a pseudo-terminal.
//!
//! Each line ends with CR. The adapter answers each executed line with CR, after `z` or `Z` if the line sent a frame.
//! The answer to any other line is BEL:
//!
//! ```text
//! client                             adapter
//! S5         250 kbit/s              CR
//! O          open                    CR
//! t00020120  frame 000: 01 20        z CR
//!                                    t1A020900 CR
//! C          close                   CR
//! ```
//!
//! The gateway serves TCP or, on Unix, a pseudo-terminal (modules `pty` and `terminal`).

mod protocol;
#[cfg(unix)]
pub(super) mod pty;
mod session;
#[cfg(unix)]
mod terminal;

pub use protocol::{Command, Parser, Refused, emit_frame};
pub use session::Session;

use std::io;
use std::sync::Arc;

use super::Gateway;
use super::tcp::{Endpoint, joinable};

/// Opens the gateway over TCP, with an adapter for each client; clients connect as to a serial port server:
/// `socket://HOST:PORT`.
pub(super) async fn open(endpoint: &Endpoint) -> io::Result<Gateway> {
    let listener = endpoint.bind().await?;
    let (url, port) = (format!("slcan://{}", listener.address), format!("socket://{}", joinable(listener.address)));
    let hint = format!(
        "Join the bus with python-can and pyserial:\n  \
         can_logger -i slcan -c {port} --bus-kwargs sleep_after_open=0\n  \
         can.Bus(interface=\"slcan\", channel=\"{port}\", sleep_after_open=0)"
    );
    let name = Arc::<str>::from(url.as_str());
    Ok(Gateway::new(url.clone(), hint, |world, places| {
        listener.run(url, world, places, move || Session::new(Arc::clone(&name)))
    }))
}
