//! The path from clients to the world: one channel, whose messages carry the wall instant of their arrival.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant as WallInstant;

use super::{ClientEnd, ClientId, ClientQueue, Reply, ToWorld};

/// The sending end of the channel, for clients and for the shutdown of the simulator.
#[derive(Clone, Debug)]
pub struct WorldSender {
    messages: Sender<Arrival>,
    ending: Arc<AtomicBool>,
}

/// The receiving end of the channel, for the world.
#[derive(Debug)]
pub struct Inbox {
    /// Messages in the order of their arrival.
    pub messages: Receiver<Arrival>,
    ending: Arc<AtomicBool>,
}

/// A message with its arrival.
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

    /// Joins as a new client that receives all later frames. The world returns a permit for joining.
    #[must_use]
    pub fn join(&self) -> (ClientId, ClientEnd) {
        let (to_client, client_end) = ClientQueue::new();
        let id = ClientId::next();
        self.tell(ToWorld::Join(id, to_client));
        self.tell(ToWorld::Listen(id, Reply::new("")));
        (id, client_end)
    }

    /// Ends the simulator before the world processes its pending messages.
    pub fn end(&self) {
        self.ending.store(true, Ordering::Release);
        // Wakes up a waiting world.
        self.tell(ToWorld::End);
    }
}

impl Inbox {
    /// Returns whether the simulator is shutting down.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Acquire)
    }
}
