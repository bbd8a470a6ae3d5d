//! socketcand: a CAN bus over TCP in readable text, compatible with the daemon of that name.
//!
//! The server greets a client with `< hi >`; the client opens the bus by name, requests raw mode, and then sends and
//! receives frames:
//!
//! ```text
//! server                                          client
//! < hi >
//!                                                 < open pve0 >
//! < ok >
//!                                                 < rawmode >
//! < ok >
//!                                                 < send 000 2 1 0 >
//! < frame 1A0 1795223549.715344 0100 >
//! ```
//!
//! The other modes of the reference daemon (`bcmmode`, `controlmode`, `isotpmode`) are not supported: no client in the
//! README's table uses them.
//!
//! The protocol has no form for remote frames. python-can sends a remote frame as a `send` with a length and no bytes,
//! which is accepted as a remote frame. Remote frames of other senders are not passed on, because they would become
//! data frames.

mod beacon;
mod protocol;
mod server;
mod session;

pub use protocol::{ECHO, HI, MESSAGE_MAX, OK, Parser, Request, RequestError, emit_error, emit_frame, emit_refusal};
pub(super) use server::SCHEME;
pub use server::ServerAddress;
pub use session::Session;
