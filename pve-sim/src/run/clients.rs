//! The world's side of all gateways: the connected clients, their frames and their messages.
//!
//! Clients share one controller, as the programs on a machine share its adapter: simultaneous frames are sent one after
//! the other. With separate controllers, equal frames would become one on the wire, and different frames with the same
//! identifier, as when two masters read from one valve, would destroy each other.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use protocol_core::frame::Frame;

use crate::inbox::{ClientId, ClientQueue, Overrun, ToClient, ToWorld};
use hal_sim::bus::FaultEffect;
use hal_sim::log::{ErrorClass, Timestamp};
use hal_sim::world::{ClientPortId, Event, EventKind, World};

/// The name of the clients' controller in traces. No device name contains a space.
const NAME: &str = "the gateway";

/// The maximum number of pending frames of disconnected clients: half a second of a bus at 250 kbit/s.
pub(super) const ORPHANED_MAX: usize = 1024;

/// The connected clients of all gateways.
pub(super) struct Clients {
    clients: BTreeMap<ClientId, Client>,
    /// Whether clients receive error frames.
    error_frames: bool,
    /// The clients' controller. Its received frames are discarded, because clients receive all frames and error frames
    /// from the events, in order.
    port: ClientPortId,
    /// The client whose frame is in the controller.
    sending: Option<ClientId>,
    /// The frames handed to the world but not yet sent, with their senders. There can be several, because faults delay
    /// and repeat frames.
    sent: Vec<Sent>,
    /// The queued frames per client, including disconnected clients. No queue is empty.
    waiting: BTreeMap<ClientId, VecDeque<Waiting>>,
    /// The number of pending frames of disconnected clients.
    orphaned: usize,
    /// The number of dropped frames of disconnected clients.
    dropped: usize,
    /// The number of frames that clients have sent so far.
    count: u64,
    /// Set while a communication fault hides the current frame from the clients.
    is_lost: bool,
    /// Set while the clients accept the current frame although other receivers see an error in its last bit but one.
    accepts_omitted: bool,
}

struct Client {
    to_client: ClientQueue,
    listening: bool,
}

/// A frame that the world has not yet sent.
struct Sent {
    sender: ClientId,
    /// The frame as the client sent it.
    frame: Frame,
    /// The frame as it will be sent, after the effects of faults.
    on_bus: Frame,
    /// The number of remaining transmissions.
    left: u32,
}

/// A pending frame with its number.
struct Waiting {
    frame: Frame,
    number: u64,
}

impl Clients {
    /// Adds the clients' controller to the world, without any client. The controller acknowledges even without clients,
    /// because no other node would acknowledge a lone device.
    pub(super) fn new(world: &mut World, error_frames: bool) -> Self {
        Self {
            clients: BTreeMap::new(),
            error_frames,
            port: world.add_gateway(NAME),
            sending: None,
            sent: Vec::new(),
            waiting: BTreeMap::new(),
            orphaned: 0,
            dropped: 0,
            count: 0,
            is_lost: false,
            accepts_omitted: false,
        }
    }

    /// Executes a message of a client; returns an error if the client is dismissed.
    pub(super) fn apply(&mut self, message: ToWorld, world: &mut World) -> Result<(), Overrun> {
        match message {
            ToWorld::Join(id, to_client) => {
                self.clients.insert(id, Client { to_client, listening: false });
            }
            ToWorld::Leave(id) => self.remove(id),
            ToWorld::Send(id, frame) => {
                if self.clients.contains_key(&id) {
                    self.count += 1;
                    self.waiting.entry(id).or_default().push_back(Waiting { frame, number: self.count });
                    self.send(world);
                }
            }
            ToWorld::AskBitRate(asked) => drop(asked.send(world.bit_rate())),
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

    /// Returns whether at least one client listens.
    pub(super) fn is_heard(&self) -> bool {
        self.clients.values().any(|client| client.listening)
    }

    /// Sends the frame of an event to all listening clients except its sender, and the error `told`, if enabled, to all
    /// listening clients. Returns the number of dismissed clients.
    pub(super) fn show(&mut self, event: &Event, at: Timestamp, told: Option<ErrorClass>) -> usize {
        let sender = if *event.who == *NAME { self.sender(event) } else { None };
        let has_clients = |names: &[Arc<str>]| names.iter().any(|name| **name == *NAME);
        let received = match &event.what {
            EventKind::Fault { effect: FaultEffect::Lost(receivers), .. } => {
                self.is_lost |= receivers.is_empty() || has_clients(receivers);
                None
            }
            EventKind::Fault { effect: FaultEffect::Omitted(receivers), .. } => {
                self.accepts_omitted = !has_clients(receivers);
                None
            }
            EventKind::Frame { frame, .. } => {
                self.accepts_omitted = false;
                Some(frame)
            }
            EventKind::ErrorFrame { frame, .. } if std::mem::take(&mut self.accepts_omitted) => Some(frame),
            _ => None,
        };
        let received = received.filter(|_| !std::mem::take(&mut self.is_lost));
        let frame = received.map_or(0, |frame| self.tell(&ToClient::Frame(at, *frame), sender));
        match told {
            Some(class) if self.error_frames => frame + self.tell(&ToClient::Error(at, class), None),
            _ => frame,
        }
    }

    /// Returns the client whose frame or error frame an event reports, and counts a completed transmission. For a
    /// communication fault, records the changed frame or the repetitions, and returns `None`.
    fn sender(&mut self, event: &Event) -> Option<ClientId> {
        match &event.what {
            EventKind::Frame { frame, .. } => {
                let place = self.sent.iter().position(|sent| sent.on_bus == *frame)?;
                let Sent { sender, left, .. } = &mut self.sent[place];
                let sender = *sender;
                *left -= 1;
                if *left == 0 {
                    self.sent.remove(place);
                }
                Some(sender)
            }
            EventKind::ErrorFrame { frame, .. } => {
                self.sent.iter().find(|sent| sent.on_bus == *frame).map(|sent| sent.sender)
            }
            EventKind::Fault { frame, effect, .. } => {
                let sent = self.sent.iter_mut().rfind(|sent| sent.frame == *frame)?;
                match effect {
                    FaultEffect::Corrupted(frame) => sent.on_bus = *frame,
                    FaultEffect::Repeated(times) => sent.left += times,
                    _ => {}
                }
                None
            }
            _ => None,
        }
    }

    /// Posts a message to all listening clients except `but`; returns the number of clients dismissed because their
    /// queue is full.
    fn tell(&mut self, message: &ToClient, but: Option<ClientId>) -> usize {
        let listeners = self.clients.iter().filter(|(id, client)| client.listening && Some(**id) != but);
        let overrun: Vec<ClientId> = listeners
            .filter_map(|(id, client)| client.to_client.post(message.clone()).is_err().then_some(*id))
            .collect();
        overrun.iter().for_each(|id| self.remove(*id));
        overrun.len()
    }

    /// Drops the frame of a disconnected client after an error frame, because the controller could otherwise retry the
    /// frame forever. Call this after every event, before [`send`](Self::send).
    pub(super) fn withdraw(&mut self, event: &Event, world: &mut World) {
        let Some(left) = self.sending.filter(|sender| !self.clients.contains_key(sender)) else { return };
        if event.is_error_frame() && *event.who == *NAME {
            world.drop_waiting(self.port);
            self.sent.retain(|sent| sent.sender != left);
        }
    }

    /// If the controller is empty, refunds the permit for its last frame and loads the next frame. The last frame has
    /// been sent, or is delayed by a fault. Call this after every event, before the next frame starts.
    pub(super) fn send(&mut self, world: &mut World) {
        if world.pending(self.port) == 0 {
            // Copies that have not been sent exceeded the world's limit of delayed frames.
            self.sent.clear();
        }
        while world.client_port(self.port).is_controller_empty() {
            if let Some(client) = self.sending.take().and_then(|sender| self.clients.get(&sender)) {
                client.to_client.refund(1);
            }
            if !world.client_port(self.port).can_delay() || !self.load(world) {
                return;
            }
        }
    }

    /// Loads the most urgent of the clients' first queued frames into the controller, and of equally urgent frames the
    /// oldest. Returns `false` if no frame is queued.
    fn load(&mut self, world: &mut World) -> bool {
        let heads = self.waiting.iter().filter_map(|(id, queue)| Some((*id, queue.front()?)));
        let next = heads.min_by_key(|(_, head)| (head.frame.arbitration(), head.number));
        let Some(id) = next.map(|(id, _)| id) else { return false };
        if let Some(queue) = self.waiting.get_mut(&id) {
            if let Some(Waiting { frame, .. }) = queue.pop_front() {
                world.send(self.port, frame);
                self.sent.push(Sent { sender: id, frame, on_bus: frame, left: 1 });
                self.sending = Some(id);
                if !self.clients.contains_key(&id) {
                    self.orphaned -= 1;
                }
            }
            if queue.is_empty() {
                self.waiting.remove(&id);
            }
        }
        true
    }

    fn post(&mut self, id: ClientId, message: ToClient) -> Result<(), Overrun> {
        let Some(client) = self.clients.get(&id) else { return Ok(()) };
        client.to_client.refund(1);
        let posted = client.to_client.post(message);
        if posted.is_err() {
            self.remove(id);
        }
        posted
    }

    /// Returns the number of frames that disconnected clients have lost since the last call.
    pub(super) fn take_dropped(&mut self) -> usize {
        std::mem::take(&mut self.dropped)
    }

    /// Removes a client, whose queued frames are still sent. While more than [`ORPHANED_MAX`] frames of disconnected
    /// clients are queued, drops the later half of the longest queue of a disconnected client.
    fn remove(&mut self, id: ClientId) {
        if self.clients.remove(&id).is_none() {
            return;
        }
        self.orphaned += self.waiting.get(&id).map_or(0, VecDeque::len);
        while self.orphaned > ORPHANED_MAX {
            let departed = self.waiting.iter().filter(|(id, _)| !self.clients.contains_key(id));
            let Some((most, length)) =
                departed.map(|(id, queue)| (*id, queue.len())).max_by_key(|(id, len)| (*len, *id))
            else {
                return;
            };
            let kept = length / 2;
            self.orphaned -= length - kept;
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
