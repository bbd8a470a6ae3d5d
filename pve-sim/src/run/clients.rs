//! The world's end of every gateway: who is there, what they send, and what they get.
//!
//! Clients share one controller, as the programs on a machine share its adapter: what two of them send at once goes out
//! one after the other. With a controller each, equal frames would become one on the wire, and frames of one identifier
//! with different data, as when two masters read from one valve, would destroy each other.

use std::collections::{BTreeMap, VecDeque};

use protocol_core::frame::Frame;

use crate::inbox::{ClientId, ClientQueue, Overrun, ToClient, ToWorld};
use hal_sim::log::{ErrorClass, Timestamp};
use hal_sim::world::{ClientPortId, Event, EventKind, World};

/// The name of their controller in traces. No device's name has a blank.
const NAME: &str = "the gateway";

/// The most frames that wait for the bus after their clients have left: half a second of a bus at 250 kbit/s.
pub(super) const LEFT_BEHIND: usize = 1024;

/// Everybody who is connected, by any gateway.
pub(super) struct Clients {
    clients: BTreeMap<ClientId, Client>,
    /// Whether clients get error frames.
    error_frames: bool,
    /// Their controller. It keeps nothing of what it hears: that comes to the clients by the events, in which frames
    /// and error frames are in their order.
    port: ClientPortId,
    /// Whose frame the controller has.
    sending: Option<ClientId>,
    /// What else waits for the bus, also of clients that have left. No queue is empty.
    waiting: BTreeMap<ClientId, VecDeque<Waiting>>,
    /// The number of waiting frames whose clients have left.
    left_behind: usize,
    /// The number of such frames that were dropped.
    dropped: usize,
    /// How many frames there were.
    count: u64,
}

struct Client {
    to_client: ClientQueue,
    listening: bool,
}

/// A frame, and the number that it came in as.
struct Waiting {
    frame: Frame,
    number: u64,
}

impl Clients {
    /// Returns no clients yet. A gateway is on the bus without one, too, or a lone device would have nobody to
    /// acknowledge what it sends.
    pub(super) fn new(world: &mut World, error_frames: bool) -> Self {
        Self {
            clients: BTreeMap::new(),
            error_frames,
            port: world.add_gateway(NAME),
            sending: None,
            waiting: BTreeMap::new(),
            left_behind: 0,
            dropped: 0,
            count: 0,
        }
    }

    /// Lets a message take effect; an error tells that the client was dismissed.
    pub(super) fn apply(&mut self, message: ToWorld, world: &mut World) -> Result<(), Overrun> {
        match message {
            ToWorld::Join(id, to_client) => {
                self.clients.insert(id, Client { to_client, listening: false });
            }
            ToWorld::Leave(id) => self.let_go(id),
            ToWorld::Send(id, frame) => {
                if self.clients.contains_key(&id) {
                    self.count += 1;
                    self.waiting.entry(id).or_default().push_back(Waiting { frame, number: self.count });
                    self.send(world);
                }
            }
            ToWorld::AskBitRate(asked) => drop(asked.send(world.bit_rate())),
            ToWorld::Reply(id, reply) | ToWorld::Listen(id, reply) | ToWorld::Unlisten(id, reply)
                if !self.clients.contains_key(&id) =>
            {
                drop(reply)
            }
            ToWorld::Reply(id, reply) => return self.post(id, ToClient::Reply(reply)),
            ToWorld::Listen(id, reply) => {
                self.post(id, ToClient::Reply(reply))?;
                self.set_listening(id, true);
            }
            ToWorld::Unlisten(id, reply) => {
                self.set_listening(id, false);
                return self.post(id, ToClient::Reply(reply));
            }
            ToWorld::Warn(_) | ToWorld::Typed(..) | ToWorld::Control(_) | ToWorld::End => {}
        }
        Ok(())
    }

    fn set_listening(&mut self, id: ClientId, listening: bool) {
        if let Some(client) = self.clients.get_mut(&id) {
            client.listening = listening;
        }
    }

    /// Returns whether a client listens.
    pub(super) fn is_heard(&self) -> bool {
        self.clients.values().any(|client| client.listening)
    }

    /// Sends a frame to all listening clients but its sender, and an error that is told to all of them, if they want
    /// it. Returns the number of clients that were dismissed.
    pub(super) fn show(&mut self, event: &Event, at: Timestamp, told: Option<ErrorClass>) -> usize {
        let own = *event.who == *NAME;
        let (message, sender) = match (&event.what, told) {
            (EventKind::Frame { frame, .. }, _) => (ToClient::Frame(at, *frame), self.sending.filter(|_| own)),
            (_, Some(class)) if self.error_frames => (ToClient::Error(at, class), None),
            _ => return 0,
        };
        let listeners = self.clients.iter().filter(|(id, client)| client.listening && Some(**id) != sender);
        let overrun: Vec<ClientId> = listeners
            .filter_map(|(id, client)| client.to_client.post(message.clone()).is_err().then_some(*id))
            .collect();
        overrun.iter().for_each(|id| self.let_go(*id));
        overrun.len()
    }

    /// Withdraws a frame that was destroyed and whose client has left: it could be destroyed for ever. To be called
    /// after every event, before [`send`](Self::send).
    pub(super) fn give_up(&mut self, event: &Event, world: &mut World) {
        let left = self.sending.is_some_and(|sender| !self.clients.contains_key(&sender));
        if event.is_error_frame() && *event.who == *NAME && left {
            world.withdraw(self.port);
        }
    }

    /// Gives the controller its next frame once it has sent the last one, and a permit back for that: to be called after
    /// every event, before the next frame starts.
    pub(super) fn send(&mut self, world: &mut World) {
        if world.pending(self.port) > 0 {
            return;
        }
        if let Some(client) = self.sending.take().and_then(|sender| self.clients.get(&sender)) {
            client.to_client.refund(1);
        }
        // The most urgent frame of those that are next for their clients; of equals the one that waits longest.
        let heads = self.waiting.iter().filter_map(|(id, queue)| Some((*id, queue.front()?)));
        let next = heads.min_by_key(|(_, head)| (head.frame.arbitration(), head.number));
        let Some(id) = next.map(|(id, _)| id) else { return };
        if let Some(queue) = self.waiting.get_mut(&id) {
            if let Some(Waiting { frame, .. }) = queue.pop_front() {
                world.send(self.port, frame);
                self.sending = Some(id);
                if !self.clients.contains_key(&id) {
                    self.left_behind -= 1;
                }
            }
            if queue.is_empty() {
                self.waiting.remove(&id);
            }
        }
    }

    fn post(&mut self, id: ClientId, message: ToClient) -> Result<(), Overrun> {
        let Some(client) = self.clients.get(&id) else { return Ok(()) };
        client.to_client.refund(1);
        let posted = client.to_client.post(message);
        if posted.is_err() {
            self.let_go(id);
        }
        posted
    }

    /// Returns the number of dropped frames of departed clients since the last call.
    pub(super) fn take_dropped(&mut self) -> usize {
        std::mem::take(&mut self.dropped)
    }

    /// Lets a client go. Its frames still go out; beyond [`LEFT_BEHIND`], the departed client with the most frames
    /// loses the later half of them.
    fn let_go(&mut self, id: ClientId) {
        if self.clients.remove(&id).is_none() {
            return;
        }
        self.left_behind += self.waiting.get(&id).map_or(0, VecDeque::len);
        while self.left_behind > LEFT_BEHIND {
            let departed = self.waiting.iter().filter(|(id, _)| !self.clients.contains_key(id));
            let Some((most, length)) =
                departed.map(|(id, queue)| (*id, queue.len())).max_by_key(|(id, len)| (*len, *id))
            else {
                return;
            };
            let kept = length / 2;
            self.left_behind -= length - kept;
            self.dropped += length - kept;
            match self.waiting.get_mut(&most) {
                Some(queue) if kept > 0 => queue.truncate(kept),
                _ => drop(self.waiting.remove(&most)),
            }
        }
    }
}

#[cfg(test)]
#[path = "clients_tests.rs"]
mod tests;
