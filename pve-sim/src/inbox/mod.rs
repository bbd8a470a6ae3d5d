//! The messages between clients and the world, and their two paths.
//!
//! The world runs on a thread of its own and never waits for a client. Requests of a client reach it as [`ToWorld`]
//! messages over one channel, the [`WorldSender`], each with the wall instant of its arrival; messages to the client go
//! into its own bounded queue, its [`ClientQueue`]. A client whose queue is full is disconnected.
//!
//! ```text
//! world_sender the path from clients to the world
//! client_queue the path from the world to a client, and the limits of both
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

/// The client number, unique in the process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClientId(u64);

impl ClientId {
    /// Returns a new number.
    #[must_use]
    pub fn next() -> Self {
        static COUNT: AtomicU64 = AtomicU64::new(1);
        Self(COUNT.fetch_add(1, Ordering::Relaxed))
    }
}

/// A message to the world. Messages of one client take effect in order.
#[derive(Debug)]
pub enum ToWorld {
    /// The client joins, but receives no frames yet.
    Join(ClientId, ClientQueue),
    /// The client receives this reply and all later frames.
    Listen(ClientId, Reply),
    /// The client sends a frame.
    Send(ClientId, Frame),
    /// The client receives this reply and no further frames.
    Unlisten(ClientId, Reply),
    /// The client receives this reply once all earlier messages have taken effect.
    Reply(ClientId, Reply),
    /// The client has disconnected; its pending frames are still sent, but not retried.
    Leave(ClientId),
    /// A client asks for the bit rate of the bus.
    AskBitRate(oneshot::Sender<BitRate>),
    /// A warning for the user.
    Warn(String),
    /// A call of the control interface.
    Control(Message),
    /// A line that the user typed; the sender is dropped once the line has taken effect.
    Typed(String, oneshot::Sender<()>),
    /// The simulator ends: see [`WorldSender::end`].
    End,
}

/// A message to a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ToClient {
    /// A frame of another sender.
    Frame(Timestamp, Frame),
    /// An error frame, or a change of a controller's error mode.
    Error(Timestamp, ErrorClass),
    /// A reply in the client's protocol.
    Reply(Reply),
}

/// A reply in the client's protocol, opaque to the world.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// The bytes for the client.
    pub text: Cow<'static, str>,
    /// The pause before the next message to the client.
    pub pause: Duration,
}

impl Reply {
    /// Returns a reply without a pause.
    #[must_use]
    pub fn new(text: impl Into<Cow<'static, str>>) -> Self {
        Self { text: text.into(), pause: Duration::ZERO }
    }
}
