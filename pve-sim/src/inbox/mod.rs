//! The messages between clients and the world, and their two paths.
//!
//! The world runs on a separate thread and never waits for a client. Clients send [`ToWorld`] messages through one
//! channel, the [`WorldSender`], which adds the wall instant of each arrival. The world posts its answers and frames to
//! the bounded [`ClientQueue`] of each client. A client whose queue is full is disconnected.

mod client_queue;

pub(crate) use client_queue::{BATCH, spend};
pub use client_queue::{ClientEnd, ClientQueue, Overrun, PERMITS, Permits, QUEUE};

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant as WallInstant};

use protocol_core::controller::BitRate;
use protocol_core::frame::Frame;
use tokio::sync::oneshot;

use crate::control::Message;
use hal_sim::log::{ErrorClass, Timestamp};

/// The number of a client, unique in the process.
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
    /// The client has disconnected. Its pending frames are still sent, but not retransmitted after an error.
    Leave(ClientId),
    /// A client asks for the bit rate of the bus.
    AskBitRate(oneshot::Sender<BitRate>),
    /// A warning for the user.
    Warn(String),
    /// A call of the control interface.
    Control(Message),
    /// A line that the user typed; the sender is dropped once the line has taken effect.
    Typed(String, oneshot::Sender<()>),
    /// Wakes up the world after [`WorldSender::end`].
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
    /// An instruction to the writer of the client's messages.
    pub note: Note,
}

/// An instruction for the messages after a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// Nothing changes.
    None,
    /// The next message follows after a pause.
    Pause(Duration),
    /// Later frames have time stamps (`true`) or none.
    Stamps(bool),
}

impl Reply {
    /// Returns a reply without an instruction.
    #[must_use]
    pub fn new(text: impl Into<Cow<'static, str>>) -> Self {
        Self { text: text.into(), note: Note::None }
    }
}

/// The sending end of the channel to the world, for clients and for the shutdown of the simulator.
#[derive(Clone, Debug)]
pub struct WorldSender {
    messages: Sender<Arrival>,
    ending: Arc<AtomicBool>,
}

/// The world's end of the channel.
#[derive(Debug)]
pub struct Inbox {
    /// Messages in the order of their arrival.
    pub messages: Receiver<Arrival>,
    /// True once the simulator shuts down.
    pub(crate) ending: Arc<AtomicBool>,
}

/// A message with its arrival time.
#[derive(Debug)]
pub struct Arrival {
    /// The wall instant of the arrival.
    pub at: WallInstant,
    /// The message.
    pub message: ToWorld,
}

impl WorldSender {
    /// Creates a channel and returns both ends.
    #[must_use]
    pub fn new() -> (Self, Inbox) {
        let (sender, messages) = channel();
        let ending = Arc::<AtomicBool>::default();
        (Self { messages: sender, ending: Arc::clone(&ending) }, Inbox { messages, ending })
    }

    /// Sends a message with the current time as its arrival. After the end of the world the message is dropped.
    pub fn tell(&self, message: ToWorld) {
        let _ = self.messages.send(Arrival { at: WallInstant::now(), message });
    }

    /// Joins as a new client that receives all later frames. The caller must spend one permit, because the world
    /// refunds one for the `Listen` message, which this function sends without a permit.
    #[must_use]
    pub fn join(&self) -> (ClientId, ClientEnd) {
        let (to_client, client_end) = ClientQueue::new();
        let id = ClientId::next();
        self.tell(ToWorld::Join(id, to_client));
        self.tell(ToWorld::Listen(id, Reply::new("")));
        (id, client_end)
    }

    /// Ends the simulator without waiting for pending messages.
    pub fn end(&self) {
        self.ending.store(true, Ordering::Release);
        self.tell(ToWorld::End);
    }
}
