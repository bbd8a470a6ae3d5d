//! The world's end of every gateway: who is there, what they send, and what they get.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::bus::BusError;
use crate::gateway::{ClientId, Outbox, Overrun, ToClient, ToWorld};
use crate::trace::{ErrorClass, Timestamp};
use crate::world::{OnBus, TapId, TraceEvent, World};

/// Everybody who is connected, by any gateway.
pub(super) struct Clients {
    clients: BTreeMap<ClientId, Client>,
    /// Places on the bus of clients that have left but whose last frames are not yet sent.
    leaving: Vec<Tap>,
    /// Places on the bus that nobody uses. The first is never used: a gateway is on the bus with no client, too, or a
    /// lone device would have nobody to acknowledge what it sends.
    free: Vec<Tap>,
    /// How many places there are.
    count: usize,
}

struct Client {
    tap: Tap,
    outbox: Outbox,
    listening: bool,
    /// How many of its frames wait for the bus.
    waiting: usize,
}

/// A place on the bus, with the name by which the trace knows it. No device's name has a blank.
struct Tap {
    id: TapId,
    name: Arc<str>,
}

impl Clients {
    pub(super) fn new(world: &mut World) -> Self {
        let gateway = Tap { id: world.add_tap("the gateway"), name: "the gateway".into() };
        Self { clients: BTreeMap::new(), leaving: Vec::new(), free: vec![gateway], count: 1 }
    }

    /// Lets a message take effect; an error tells that the client was dismissed.
    pub(super) fn apply(&mut self, message: ToWorld, world: &mut World) -> Result<(), Overrun> {
        match message {
            ToWorld::Join(id, outbox) => {
                let tap = self.place(world);
                self.clients.insert(id, Client { tap, outbox, listening: false, waiting: 0 });
            }
            ToWorld::Leave(id) => self.leaving.extend(self.clients.remove(&id).map(|client| client.tap)),
            ToWorld::Send(id, frame) => {
                if let Some(client) = self.clients.get_mut(&id) {
                    world.send(client.tap.id, frame);
                    client.waiting += 1;
                }
            }
            ToWorld::Reply(id, reply) | ToWorld::Listen(id, reply) if !self.clients.contains_key(&id) => drop(reply),
            ToWorld::Reply(id, reply) => return self.post(id, ToClient::Reply(reply)),
            ToWorld::Listen(id, reply) => {
                self.post(id, ToClient::Reply(reply))?;
                if let Some(client) = self.clients.get_mut(&id) {
                    client.listening = true;
                }
            }
            ToWorld::Stop => {}
        }
        Ok(())
    }

    /// Shows an event to everybody who listens, but for its sender; returns how many were dismissed.
    pub(super) fn show(&mut self, event: &TraceEvent, at: Timestamp) -> usize {
        let message = match &event.what {
            OnBus::Frame(frame) => ToClient::Frame(at, *frame),
            OnBus::Error { error, .. } => ToClient::Error(at, class(*error)),
        };
        let own = |client: &Client| event.frame().is_some() && client.tap.name == event.from;
        let listeners = self.clients.iter().filter(|(_, client)| client.listening && !own(client));
        let overrun: Vec<ClientId> =
            listeners.filter_map(|(id, client)| client.outbox.post(message.clone()).is_err().then_some(*id)).collect();
        self.leaving.extend(overrun.iter().filter_map(|id| self.clients.remove(id)).map(|client| client.tap));
        overrun.len()
    }

    /// Gives credit back for frames that the bus has taken, and places whose last frame is sent to whoever comes next.
    pub(super) fn settle(&mut self, world: &mut World) {
        for client in self.clients.values_mut() {
            let waiting = world.pending(client.tap.id);
            client.outbox.refund(client.waiting.saturating_sub(waiting));
            client.waiting = waiting;
        }
        let sent = self.leaving.extract_if(.., |tap| world.pending(tap.id) == 0);
        self.free.extend(sent);
        // What the places have heard came to the clients by the events, which keep frames and error frames in order.
        let active = self.clients.values().map(|client| &client.tap);
        for tap in active.chain(&self.leaving).chain(&self.free) {
            drop(world.take_received(tap.id));
        }
    }

    fn post(&mut self, id: ClientId, message: ToClient) -> Result<(), Overrun> {
        let Some(client) = self.clients.get(&id) else { return Ok(()) };
        client.outbox.refund(1);
        let posted = client.outbox.post(message);
        if posted.is_err() {
            self.leaving.extend(self.clients.remove(&id).map(|client| client.tap));
        }
        posted
    }

    fn place(&mut self, world: &mut World) -> Tap {
        if self.free.len() > 1
            && let Some(tap) = self.free.pop()
        {
            return tap;
        }
        let name = format!("client {}", self.count);
        self.count += 1;
        Tap { id: world.add_tap(&name), name: name.into() }
    }
}

/// The class of an error frame, as clients and logs tell it.
pub(super) const fn class(error: BusError) -> ErrorClass {
    match error {
        BusError::Acknowledgement => ErrorClass::NoAcknowledge,
        BusError::Bit | BusError::Stuff => ErrorClass::BusError,
    }
}
