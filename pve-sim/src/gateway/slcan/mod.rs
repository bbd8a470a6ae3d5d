//! slcan: the ASCII protocol of serial-line adapters (Lawicel CAN232 and CANUSB), over TCP or on a pseudo-terminal.
//!
//! Each line ends with CR. The adapter answers an executed line with CR (after `z` or `Z` for a frame), and a line that
//! it does not execute with BEL:
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
//! ```text
//! protocol  decodes commands, encodes answers; no I/O
//! session   one client
//! server    the gateway over TCP
//! pty       the gateway on a pseudo-terminal
//! terminal  the pseudo-terminal, and the link to it
//! ```

mod protocol;
#[cfg_attr(not(unix), path = "pty_elsewhere.rs")]
mod pty;
mod server;
mod session;
#[cfg(unix)]
mod terminal;

pub use protocol::{Command, Parser, Refused, emit_frame};
pub(super) use pty::SCHEME as PTY;
pub(super) use server::SCHEME as TCP;
pub use session::Session;
