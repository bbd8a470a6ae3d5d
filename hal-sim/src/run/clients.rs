//! The world's end of every gateway: who is there, what they send, and what they get.

use std::collections::BTreeMap;

use crate::bus::BusError;
use crate::gateway::{ClientId, Outbox, Overrun, ToClient, ToWorld};
use crate::trace::{ErrorClass, Timestamp};
use crate::world::{OnBus, TapId, TraceEvent, World};

/// Everybody who is connected, by any gateway.
pub(super) struct Clients {
    clients: BTreeMap<ClientId, Client>,
    /// Places on the bus of clients that have left but whose last frames are not yet sent.
    leaving: Vec<TapId>,
    /// How many there were.
    count: u64,
}

struct Client {
    /// Its place on the bus. It keeps nothing of what it hears: that comes to the client by the events, in which frames
    /// and error frames are in their order.
    tap: TapId,
    /// The name by which events know it. No device's name has a blank.
    name: String,
    outbox: Outbox,
    listening: bool,
    /// How many of its frames wait for the bus.
    waiting: usize,
}

impl Clients {
    /// A gateway is on the bus with no client, too, or a lone device would have nobody to acknowledge what it sends.
    pub(super) fn new(world: &mut World) -> Self {
        world.add_gateway("the gateway");
        Self { clients: BTreeMap::new(), leaving: Vec::new(), count: 0 }
    }

    /// Lets a message take effect; an error tells that the client was dismissed.
    pub(super) fn apply(&mut self, message: ToWorld, world: &mut World) -> Result<(), Overrun> {
        match message {
            ToWorld::Join(id, outbox) => {
                self.count += 1;
                let name = format!("client {}", self.count);
                let tap = world.add_gateway(&name);
                self.clients.insert(id, Client { tap, name, outbox, listening: false, waiting: 0 });
            }
            ToWorld::Leave(id) => self.leaving.extend(self.clients.remove(&id).map(|client| client.tap)),
            ToWorld::Send(id, frame) => {
                if let Some(client) = self.clients.get_mut(&id) {
                    world.send(client.tap, frame);
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
        let own = |client: &Client| event.frame().is_some() && *client.name == *event.from;
        let listeners = self.clients.iter().filter(|(_, client)| client.listening && !own(client));
        let overrun: Vec<ClientId> =
            listeners.filter_map(|(id, client)| client.outbox.post(message.clone()).is_err().then_some(*id)).collect();
        self.leaving.extend(overrun.iter().filter_map(|id| self.clients.remove(id)).map(|client| client.tap));
        overrun.len()
    }

    /// Gives credit back for frames that the bus has taken, and takes away those whose last frame is sent.
    pub(super) fn settle(&mut self, world: &mut World) {
        for client in self.clients.values_mut() {
            let waiting = world.pending(client.tap);
            client.outbox.refund(client.waiting.saturating_sub(waiting));
            client.waiting = waiting;
        }
        self.leaving.retain(|tap| {
            let sending = world.pending(*tap) > 0;
            if !sending {
                world.remove_tap(*tap);
            }
            sending
        });
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
}

/// The class of an error frame, as clients and logs tell it.
pub(super) const fn class(error: BusError) -> ErrorClass {
    match error {
        BusError::Acknowledgement => ErrorClass::NoAcknowledge,
        BusError::Bit | BusError::Stuff => ErrorClass::BusError,
    }
}
