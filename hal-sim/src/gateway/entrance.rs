//! The way from the clients into the world: one channel, on which each message has the wall instant of its arrival.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant as WallInstant;

use super::ToWorld;

/// The clients' end. Every gateway has one, and whoever ends the simulator.
#[derive(Clone, Debug)]
pub struct Entrance {
    messages: Sender<Arrival>,
    ending: Arc<AtomicBool>,
}

/// The world's end.
#[derive(Debug)]
pub struct Inbox {
    /// What the clients want, in the order in which it arrived.
    pub messages: Receiver<Arrival>,
    ending: Arc<AtomicBool>,
}

/// A message with the instant at which it takes effect.
#[derive(Debug)]
pub struct Arrival {
    /// When it arrived.
    pub at: WallInstant,
    /// What is wanted.
    pub message: ToWorld,
}

impl Entrance {
    /// Both ends.
    #[must_use]
    pub fn new() -> (Self, Inbox) {
        let (sender, messages) = channel();
        let ending = Arc::<AtomicBool>::default();
        (Self { messages: sender, ending: Arc::clone(&ending) }, Inbox { messages, ending })
    }

    /// Sends a message that arrives now. A world that has ended needs to hear nothing: the whole simulator ends with it.
    pub fn tell(&self, message: ToWorld) {
        let _ = self.messages.send(Arrival { at: WallInstant::now(), message });
    }

    /// Lets the simulator end, whatever else waits for the world.
    pub fn end(&self) {
        self.ending.store(true, Ordering::Release);
        // Wakes up a world that waits.
        self.tell(ToWorld::End);
    }
}

impl Inbox {
    /// Whether the simulator is to end.
    #[must_use]
    pub fn is_ending(&self) -> bool {
        self.ending.load(Ordering::Acquire)
    }
}
