//! What ties one client to the world: a bounded queue towards it, and the permits that bound what it may send.

use std::sync::Arc;

use tokio::sync::{Notify, Semaphore, SemaphorePermit, mpsc};

use super::ToClient;

/// How much may wait for a client that reads slowly: more than a second of a bus at 500 kbit/s under full load, beside
/// what the system's buffers hold.
pub const QUEUE: usize = 8192;

/// How many messages of one client may wait for the world and the bus; beyond that its socket is not read.
pub const PERMITS: usize = 1024;

/// How many messages to a client go out in one write, at most.
pub(crate) const BATCH: usize = 256;

/// The world's end of one client.
#[derive(Clone, Debug)]
pub struct ClientQueue {
    queue: mpsc::Sender<ToClient>,
    permits: Permits,
}

/// The client's end of a [`ClientQueue`]. When the world drops the queue, the end closes.
#[derive(Debug)]
pub struct ClientEnd {
    /// What the client is to get.
    pub queue: mpsc::Receiver<ToClient>,
    /// What the client may do, and whether it still may.
    pub permits: Permits,
}

/// What the client may do, and whether it still may.
#[derive(Clone, Debug)]
pub struct Permits {
    dismissed: Arc<Notify>,
    free: Arc<Semaphore>,
}

/// The right to send one message to the world. Dropped, it goes back.
#[derive(Debug)]
pub struct Permit<'a>(Option<SemaphorePermit<'a>>);

impl Permit<'_> {
    /// Sends the message: the world gives the permit back when it is done.
    pub fn spend(self) {
        if let Some(permit) = self.0 {
            permit.forget();
        }
    }
}

/// The client did not keep up, and is being disconnected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overrun;

impl ClientQueue {
    /// Returns the queue, and the client's end of it.
    #[must_use]
    pub fn new() -> (Self, ClientEnd) {
        let (sender, queue) = mpsc::channel(QUEUE);
        let permits = Permits { dismissed: Arc::default(), free: Arc::new(Semaphore::new(PERMITS)) };
        (Self { queue: sender, permits: permits.clone() }, ClientEnd { queue, permits })
    }

    /// Puts something into the queue, never waiting.
    ///
    /// # Errors
    /// [`Overrun`] when the queue is full: the client is told to go, and nothing more will reach it.
    pub fn post(&self, message: ToClient) -> Result<(), Overrun> {
        match self.queue.try_send(message) {
            Ok(()) => Ok(()),
            // The session has ended by itself, and says so on its own.
            Err(mpsc::error::TrySendError::Closed(_)) => Ok(()),
            Err(mpsc::error::TrySendError::Full(_)) => {
                self.permits.dismissed.notify_one();
                Err(Overrun)
            }
        }
    }

    /// Gives permits back for messages that are done: replied to, or sent on the bus.
    pub fn refund(&self, messages: usize) {
        self.permits.free.add_permits(messages);
    }
}

impl Permits {
    /// Waits until one more message may be sent to the world.
    pub async fn spend(&self) {
        self.permit().await.spend();
    }

    /// Waits until one more message may be sent to the world, for a gateway that has other things to do while it waits.
    pub async fn permit(&self) -> Permit<'_> {
        Permit(self.free.acquire().await.ok())
    }

    /// Waits until the world tells the client to go.
    pub async fn dismissed(&self) {
        self.dismissed.notified().await;
    }
}
