//! Clients owned by the caller: CAN controllers for code that is generic over [`embedded_can::nb::Can`].

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use embedded_can::ErrorKind;
use protocol_core::frame::Frame;

use super::{ClientPortId, World};

/// A client of a world's bus, created by [`World::client`].
///
/// Virtual time passes only during calls to the [`World`]. Transmitted frames reach the bus at the start of the next
/// [`World::run_for`], [`World::run_until`] or [`World::step`], at the current virtual time. Received frames are
/// available when that call returns. `transmit` accepts every frame. `nb::block!` on `receive` never returns: run the
/// world, then receive again.
///
/// A client that is dropped leaves the bus and loses its pending frames. In a cloned world, [`World::take_client`]
/// returns a new client.
#[derive(Debug)]
pub struct Client(Shared);

/// The error of a client whose world has been dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the world of this client was dropped")]
pub struct WorldGone;

impl embedded_can::Error for WorldGone {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl Client {
    /// Returns the number of received frames in the queue.
    #[must_use]
    pub fn received(&self) -> usize {
        lock(&self.0).received.len()
    }
}

impl embedded_can::nb::Can for Client {
    type Frame = Frame;
    type Error = WorldGone;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, WorldGone> {
        if is_alone(&self.0) {
            return Err(nb::Error::Other(WorldGone));
        }
        lock(&self.0).sent.push_back(*frame);
        Ok(None)
    }

    fn receive(&mut self) -> nb::Result<Frame, WorldGone> {
        let none = if is_alone(&self.0) { nb::Error::Other(WorldGone) } else { nb::Error::WouldBlock };
        lock(&self.0).received.pop_front().ok_or(none)
    }
}

/// The frame queues between a client and its world.
#[derive(Clone, Debug, Default)]
struct Queues {
    sent: VecDeque<Frame>,
    received: VecDeque<Frame>,
}

/// The queues, shared by the client and its world.
type Shared = Arc<Mutex<Queues>>;

/// Returns whether the other owner of the queues was dropped.
fn is_alone(queues: &Shared) -> bool {
    Arc::strong_count(queues) == 1
}

fn lock(queues: &Shared) -> MutexGuard<'_, Queues> {
    queues.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The world's side of a [`Client`].
pub(super) struct Connection {
    port: ClientPortId,
    queues: Shared,
    /// True if this connection belongs to a cloned world and [`World::take_client`] has not yet created its client.
    untaken: bool,
}

/// The clone has its own queues, with the same frames.
impl Clone for Connection {
    fn clone(&self) -> Self {
        let queues = Arc::new(Mutex::new(lock(&self.queues).clone()));
        Self { port: self.port, queues, untaken: !self.is_client_gone() }
    }
}

impl World {
    /// Adds a client that the caller owns. The client sends frames in FIFO order, receives all frames except its own,
    /// and acknowledges.
    pub fn client(&mut self, name: &str) -> Client {
        let mut connection = Connection { port: self.add_client_port(name), queues: Shared::default(), untaken: true };
        let client = connection.take();
        self.clients.push(connection);
        client
    }

    /// Takes the named client of a cloned world, with the frames that were not yet transferred when the world was
    /// cloned, and the frames received since then. Returns `None` if the client is unknown or already taken.
    pub fn take_client(&mut self, name: &str) -> Option<Client> {
        let is_it =
            |connection: &&mut Connection| connection.untaken && self.bus.port(connection.port.0).name() == name;
        self.clients.iter_mut().find(is_it).map(Connection::take)
    }

    /// Transfers sent frames to the bus and removes dropped clients.
    pub(super) fn take_from_clients(&mut self) {
        // A foreign frame in a world without clients takes 48 instructions less.
        if self.clients.is_empty() {
            return;
        }
        let mut clients = std::mem::take(&mut self.clients);
        clients.retain(|connection| {
            // Read once: a client in another thread can go at any time.
            let is_gone = connection.is_client_gone();
            for frame in lock(&connection.queues).sent.drain(..) {
                self.send(connection.port, frame);
            }
            if is_gone {
                self.remove_client_port(connection.port);
            }
            !is_gone
        });
        self.clients = clients;
    }

    /// Transfers received frames to the clients.
    pub(super) fn give_to_clients(&mut self) {
        for Connection { port, queues, .. } in &self.clients {
            lock(queues).received.extend(self.bus.port_mut(port.0).take_received().map(|(_, frame)| frame));
        }
    }
}

impl Connection {
    fn is_client_gone(&self) -> bool {
        !self.untaken && is_alone(&self.queues)
    }

    fn take(&mut self) -> Client {
        self.untaken = false;
        Client(Arc::clone(&self.queues))
    }
}
