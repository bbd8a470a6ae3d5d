//! The link between a client and the world: a bounded queue to the client, and permits for the client's messages.

use std::sync::Arc;

use tokio::sync::{Notify, Semaphore, SemaphorePermit, mpsc};

use super::ToClient;

/// The queue capacity of a client: more than a second of a fully loaded bus at 500 kbit/s. The operating system's
/// buffers add to it.
pub const QUEUE: usize = 8192;

/// The maximum number of messages of a client that the world has not processed or sent yet. At this limit, the gateway
/// stops reading the client's socket.
pub const PERMITS: usize = 1024;

/// The maximum number of messages to a client in one write.
pub(crate) const BATCH: usize = 256;

/// The world's end of the link to one client.
#[derive(Clone, Debug)]
pub struct ClientQueue {
    queue: mpsc::Sender<ToClient>,
    permits: Permits,
}

/// The client's end of a [`ClientQueue`]. The queue ends when the world drops its end.
#[derive(Debug)]
pub struct ClientEnd {
    /// The messages to the client.
    pub queue: mpsc::Receiver<ToClient>,
    /// The permits of the client.
    pub permits: Permits,
}

/// The send permits of a client, and the signal that disconnects the client.
#[derive(Clone, Debug)]
pub struct Permits {
    dismissed: Arc<Notify>,
    free: Arc<Semaphore>,
}

/// The error of a full queue: the client reads too slowly and is being disconnected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overrun;

impl ClientQueue {
    /// Returns both ends of a new queue.
    #[must_use]
    pub fn new() -> (Self, ClientEnd) {
        let (sender, queue) = mpsc::channel(QUEUE);
        let permits = Permits { dismissed: Arc::default(), free: Arc::new(Semaphore::new(PERMITS)) };
        (Self { queue: sender, permits: permits.clone() }, ClientEnd { queue, permits })
    }

    /// Queues a message without waiting.
    ///
    /// # Errors
    /// [`Overrun`] when the queue is full: the client is dismissed and receives no further messages.
    pub fn post(&self, message: ToClient) -> Result<(), Overrun> {
        match self.queue.try_send(message) {
            Ok(()) => Ok(()),
            // The session has already ended, and reports its end separately.
            Err(mpsc::error::TrySendError::Closed(_)) => Ok(()),
            Err(mpsc::error::TrySendError::Full(_)) => {
                self.permits.dismissed.notify_one();
                Err(Overrun)
            }
        }
    }

    /// Refunds the permits of processed messages: messages that were answered, or sent on the bus.
    pub fn refund(&self, messages: usize) {
        self.permits.free.add_permits(messages);
    }
}

impl Permits {
    /// Waits for a permit to send one message to the world, and spends the permit. The world refunds the permit when it
    /// has processed the message.
    pub async fn spend(&self) {
        spend(self.permit().await);
    }

    /// Waits for a permit without spending it. A dropped permit is free again.
    pub(crate) async fn permit(&self) -> Option<SemaphorePermit<'_>> {
        self.free.acquire().await.ok()
    }

    /// Waits until the world dismisses the client.
    pub async fn dismissed(&self) {
        self.dismissed.notified().await;
    }
}

pub(crate) fn spend(permit: Option<SemaphorePermit<'_>>) {
    if let Some(permit) = permit {
        permit.forget();
    }
}
