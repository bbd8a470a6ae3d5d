//! Messages of more than eight bytes: a BAM and its packets (SAE J1939-21 5.10; SPEC 5). Connections between two
//! controllers are refused.

use heapless::Vec;

use super::Outcome;
use super::request::is_controller;
use crate::frame::Frame;
use crate::time::{Duration, Instant, NEVER, delayed, since};
use crate::wire::j1939_id::{Address, Format, J1939Id, Pgn};
use crate::wire::tp::{self, Abort, Announcement, PACKET_LEN, Packet};

/// The time between two packets (A). The standard permits 50–200 ms; this value leaves room for delays on a busy bus.
pub const PACKET_SPACING: Duration = Duration::from_millis(100);

/// The maximum time between two received packets (T1).
pub const MAX_GAP: Duration = Duration::from_millis(750);

/// The maximum time between two sent frames of a message, and from its start to its announcement (J1939-21 5.13.3). If
/// the bus delays a frame longer, the sender abandons the message.
pub const SEND_GAP: Duration = Duration::from_millis(200);

/// The reason in a connection abort (A): the resources are needed for another task.
const REFUSAL_REASON: u8 = 2;

/// Encodes the connection abort that answers a request to send (RTS) to the controller `own`. Other frames, and
/// requesters without an address, get no answer.
#[must_use]
pub fn refuse_connection(id: J1939Id, frame: &Frame, own: Address) -> Option<Frame> {
    let pgn = tp::request_to_send(frame.eight()?)?;
    let sender = id.source();
    is_controller(sender).then(|| Abort { reason: REFUSAL_REASON, pgn }.frame(sender, own))
}

/// The reason why a message cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Another message is being sent.
    Busy,
    /// The message is too short or too long for a broadcast.
    Size,
}

#[derive(Clone, Debug)]
struct Sending<const SIZE: usize> {
    announcement: Announcement,
    payload: Vec<u8, SIZE>,
    /// The sequence number of the next frame, or of the frame in the controller. The announcement has 0.
    sequence: u8,
    in_controller: bool,
    /// The due time of the next frame; [`NEVER`] once it is queued.
    due: Instant,
    /// The time at which the message is abandoned unless the next frame is sent.
    give_up: Instant,
}

/// A sender of broadcasts of up to `SIZE` bytes, one at a time.
#[derive(Clone, Debug, Default)]
pub struct BamSender<const SIZE: usize> {
    sending: Option<Sending<SIZE>>,
}

impl<const SIZE: usize> BamSender<SIZE> {
    /// Creates an idle sender.
    #[must_use]
    pub const fn new() -> Self {
        Self { sending: None }
    }

    /// Begins a message. The announcement is due at once.
    ///
    /// # Errors
    /// Returns [`Refused::Busy`] while another message is being sent, and [`Refused::Size`] for a message below 9 or
    /// above 1785 bytes.
    pub fn start(&mut self, pgn: Pgn, payload: Vec<u8, SIZE>, now: Instant) -> Result<(), Refused> {
        if self.is_busy() {
            return Err(Refused::Busy);
        }
        let size = u16::try_from(payload.len()).map_err(|_| Refused::Size)?;
        let announcement = Announcement::new(pgn, size).ok_or(Refused::Size)?;
        let give_up = delayed(now, SEND_GAP);
        self.sending = Some(Sending { announcement, payload, sequence: 0, in_controller: false, due: now, give_up });
        Ok(())
    }

    /// Returns whether a message is being sent.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.sending.is_some()
    }

    /// Abandons the message. Returns whether a message was being sent.
    pub fn cancel(&mut self) -> bool {
        self.sending.take().is_some()
    }

    /// Makes the next frame pending when it is due. Abandons a message that the bus has delayed longer than
    /// [`SEND_GAP`].
    #[must_use]
    pub fn poll(&mut self, now: Instant) -> Outcome {
        match &mut self.sending {
            Some(sending) if now >= sending.give_up => {
                self.sending = None;
                Outcome::GivenUp
            }
            Some(sending) if now >= sending.due => {
                sending.due = NEVER;
                Outcome::Pending
            }
            _ => Outcome::Nothing,
        }
    }

    /// Returns the group of the next frame, or of the frame in the controller.
    #[must_use]
    pub fn pgn(&self) -> Pgn {
        match &self.sending {
            Some(Sending { sequence: 0, .. }) => Pgn::TP_CONNECTION,
            _ => Pgn::TP_DATA,
        }
    }

    /// Encodes the next frame. The controller holds it until it is [sent](Self::sent) or [taken back](Self::take_back).
    #[must_use]
    pub fn render(&mut self, source: Address) -> Option<Frame> {
        let sending = self.sending.as_mut()?;
        (sending.in_controller, sending.due) = (true, NEVER);
        Some(match sending.sequence.checked_sub(1) {
            None => sending.announcement.frame(source),
            Some(index) => {
                let rest = sending.payload.chunks(PACKET_LEN).nth(index.into()).unwrap_or_default();
                Packet::new(sending.sequence, rest).frame(source)
            }
        })
    }

    /// Takes back a frame that the controller returned. The frame is encoded again.
    pub const fn take_back(&mut self) {
        if let Some(sending) = &mut self.sending {
            sending.in_controller = false;
        }
    }

    /// Records that the frame in the controller was sent. The next frame is due [`PACKET_SPACING`] later, because a
    /// busy bus must not bring packets closer together.
    pub fn sent(&mut self, now: Instant) {
        let Some(sending) = self.sending.as_mut().filter(|sending| sending.in_controller) else { return };
        if sending.sequence == sending.announcement.packets {
            self.sending = None;
        } else {
            sending.sequence = sending.sequence.saturating_add(1);
            sending.in_controller = false;
            sending.due = delayed(now, PACKET_SPACING);
            sending.give_up = delayed(now, SEND_GAP);
        }
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub fn deadline(&self) -> Instant {
        self.sending.as_ref().map_or(NEVER, |sending| sending.due.min(sending.give_up))
    }
}

/// A received message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message<const SIZE: usize> {
    /// The group.
    pub pgn: Pgn,
    /// The sender.
    pub source: Address,
    /// The bytes of the message.
    pub payload: Vec<u8, SIZE>,
}

#[derive(Clone, Debug)]
struct Receiving<const SIZE: usize> {
    message: Message<SIZE>,
    size: usize,
    /// The expected sequence number.
    sequence: u8,
    /// The time of the last frame.
    heard: Instant,
}

/// A receiver of broadcasts of up to `SIZE` bytes, from up to `SENDERS` senders at the same time.
///
/// The receiver has no timer. An interrupted message keeps its slot until its sender sends again or another message
/// needs the slot. Messages of senders without a slot are ignored.
#[derive(Clone, Debug)]
pub struct BamReceiver<const SENDERS: usize, const SIZE: usize> {
    wanted: &'static [Pgn],
    receiving: Vec<Receiving<SIZE>, SENDERS>,
}

impl<const SENDERS: usize, const SIZE: usize> BamReceiver<SENDERS, SIZE> {
    /// Creates a receiver of these groups. Other groups are ignored.
    #[must_use]
    pub const fn new(wanted: &'static [Pgn]) -> Self {
        Self { wanted, receiving: Vec::new() }
    }

    /// Returns the number of messages in reception.
    #[cfg(test)]
    pub(super) fn under_way(&self) -> usize {
        self.receiving.len()
    }

    /// Handles a frame with the identifier `id`. Returns the message that the frame completes.
    #[inline]
    #[must_use]
    pub fn handle(&mut self, id: J1939Id, frame: &Frame, now: Instant) -> Option<Message<SIZE>> {
        match id.format() {
            Format::TP_CONNECTION => {
                self.announced(id, frame, now);
                None
            }
            // Most packets on the bus belong to messages that this receiver ignores.
            Format::TP_DATA if !self.receiving.is_empty() => self.continued(id, frame, now),
            _ => None,
        }
    }

    /// Handles the announcement of a message. The announcement ends the previous message of its sender, even if the
    /// receiver ignores the new message.
    fn announced(&mut self, id: J1939Id, frame: &Frame, now: Instant) {
        let Some(announcement) = frame.eight().and_then(Announcement::parse) else { return };
        if id.destination() != Address::GLOBAL {
            return;
        }
        let source = id.source();
        if let Some(slot) = self.slot_of(source) {
            self.receiving.swap_remove(slot);
        }
        let size = usize::from(announcement.size);
        if size > SIZE || !announcement.is_sound() || !self.wanted.contains(&announcement.pgn) {
            return;
        }
        if self.receiving.is_full() {
            let Some(slot) = self.receiving.iter().position(|receiving| receiving.is_late(now)) else { return };
            self.receiving.swap_remove(slot);
        }
        let message = Message { pgn: announcement.pgn, source, payload: Vec::new() };
        // Cannot fail, because a slot is free.
        _ = self.receiving.push(Receiving { message, size, sequence: 1, heard: now });
    }

    /// Handles a packet. A packet that is out of sequence, late or malformed ends its message.
    fn continued(&mut self, id: J1939Id, frame: &Frame, now: Instant) -> Option<Message<SIZE>> {
        if id.destination() != Address::GLOBAL {
            return None;
        }
        let slot = self.slot_of(id.source())?;
        let whole = self.receiving.get_mut(slot)?.take(frame.eight().map(Packet::parse), now);
        if whole == Some(false) {
            return None;
        }
        let ended = self.receiving.swap_remove(slot);
        whole.map(|_| ended.message)
    }

    fn slot_of(&self, source: Address) -> Option<usize> {
        self.receiving.iter().position(|receiving| receiving.message.source == source)
    }
}

impl<const SIZE: usize> Receiving<SIZE> {
    /// Returns whether the next packet is too late.
    fn is_late(&self, now: Instant) -> bool {
        since(now, self.heard) > MAX_GAP
    }

    /// Appends a packet. Returns whether the packet completes the message. Returns `None` for an invalid packet, which
    /// ends the message.
    fn take(&mut self, packet: Option<Packet>, now: Instant) -> Option<bool> {
        let packet = packet.filter(|packet| packet.sequence == self.sequence && !self.is_late(now))?;
        let payload = &mut self.message.payload;
        let missing = self.size.saturating_sub(payload.len());
        let share = packet.data.get(..missing).unwrap_or(&packet.data);
        payload.extend_from_slice(share).ok()?;
        self.sequence = self.sequence.saturating_add(1);
        self.heard = now;
        Some(self.message.payload.len() == self.size)
    }
}
