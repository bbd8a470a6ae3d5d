//! The messages between clients and the world, and their two ways.
//!
//! The world runs on a thread of its own and never waits for a client. What a client wants comes to it as [`ToWorld`]
//! messages over one channel, the [`WorldSender`], each with the wall instant of its arrival; what the client is to see
//! goes into the client's own bounded queue, its [`ClientQueue`], and a client whose queue is full is disconnected.
//!
//! ```text
//! world_sender the way from clients into the world
//! client_queue the way from the world to a client, and what bounds both
//! ```

mod client_queue;
mod world_sender;

pub(crate) use client_queue::BATCH;
pub use client_queue::{ClientEnd, ClientQueue, Overrun, PERMITS, Permit, Permits, QUEUE};
pub use world_sender::{Arrival, Inbox, WorldSender};

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use tokio::sync::oneshot;

use crate::control::Message;
use hal_sim::log::{ErrorClass, Timestamp};

/// A client, for as long as it is connected; the number is not used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientId(u64);

impl ClientId {
    /// Returns a number that no other client has.
    #[must_use]
    pub fn next() -> Self {
        static COUNT: AtomicU64 = AtomicU64::new(1);
        Self(COUNT.fetch_add(1, Ordering::Relaxed))
    }
}

/// What a client wants of the world. Messages of one client take effect in their order.
#[derive(Debug)]
pub enum ToWorld {
    /// It is there, and hears nothing yet.
    Join(ClientId, ClientQueue),
    /// It gets what is on the bus from now on, after this reply.
    Listen(ClientId, Reply),
    /// It sends a frame.
    Send(ClientId, Frame),
    /// It gets nothing more of what is on the bus, after this reply.
    Unlisten(ClientId, Reply),
    /// It is to get this reply when everything before has taken effect.
    Reply(ClientId, Reply),
    /// It is gone; what it sent before is still sent, but no frame twice.
    Leave(ClientId),
    /// Somebody is to know the bit rate of the bus.
    AskBitRate(oneshot::Sender<BitRate>),
    /// The user is to read this line.
    Warn(String),
    /// A call of the control interface.
    Control(Message),
    /// The user typed this line. The sender is dropped when the line has taken effect.
    Typed(String, oneshot::Sender<()>),
    /// The simulator is to end: see [`WorldSender::end`].
    End,
}

/// What a client gets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ToClient {
    /// A frame that somebody else sent.
    Frame(Timestamp, Frame),
    /// An error frame, or a change of a controller's error mode.
    Error(Timestamp, ErrorClass),
    /// A reply in the client's own protocol.
    Reply(Reply),
}

/// A reply in the client's own protocol, which only its gateway understands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// The bytes that go to the client.
    pub text: Cow<'static, str>,
    /// How long nothing else goes to the client after it.
    pub pause: Duration,
}

impl Reply {
    /// Returns a reply that anything may follow at once.
    #[must_use]
    pub fn new(text: impl Into<Cow<'static, str>>) -> Self {
        Self { text: text.into(), pause: Duration::ZERO }
    }
}
