//! socketcand: a CAN bus over TCP in readable text, as the daemon of that name serves it.
//!
//! A client is greeted with `< hi >`, opens the bus by its name, asks for raw mode, and then sends and receives frames:
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
//! The reference daemon's other modes (`bcmmode`, `controlmode`, `isotpmode`) do not exist here: no client of the README's
//! table asks for them.
//!
//! Remote frames: the text has no sign for them. A `send` with a length and no byte is what python-can makes of one,
//! and is taken as one; remote frames that others send are not passed on, as they could only be passed on as data.

mod beacon;
mod protocol;
mod server;
mod session;

pub use protocol::{ECHO, HI, MESSAGE_MAX, OK, Parser, Request, RequestError, emit_error, emit_frame, emit_refusal};
pub(super) use server::SCHEME;
pub use server::ServerAddress;
pub use session::Session;
