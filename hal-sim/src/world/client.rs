//! Clients that a program owns: a CAN controller for code that is generic over [`embedded_can::nb::Can`].

use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};

use embedded_can::ErrorKind;
use protocol_core::frame::Frame;

use super::{TapId, World};

/// A client of a world's bus, made by [`World::client`].
///
/// Virtual time passes in the calls of the [`World`] alone. A transmitted frame goes to the bus at the beginning of the
/// next [`World::run_for`], [`World::run_until`] or [`World::step`], at the instant that the world is at then; received
/// frames are there when the call returns. `transmit` takes every frame. To wait for a frame by `nb::block!` is to wait
/// for ever: let the world run, and look again.
///
/// A client that is dropped leaves the bus, with all that it had to send.
#[derive(Debug)]
pub struct Client {
    sent: Sender<Frame>,
    received: Receiver<Frame>,
}

/// The world of a client was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the world of this client was dropped")]
pub struct WorldGone;

impl embedded_can::Error for WorldGone {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl embedded_can::nb::Can for Client {
    type Frame = Frame;
    type Error = WorldGone;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, WorldGone> {
        self.sent.send(*frame).map(|()| None).map_err(|_| nb::Error::Other(WorldGone))
    }

    fn receive(&mut self) -> nb::Result<Frame, WorldGone> {
        self.received.try_recv().map_err(|error| match error {
            TryRecvError::Empty => nb::Error::WouldBlock,
            TryRecvError::Disconnected => nb::Error::Other(WorldGone),
        })
    }
}

/// The world's end of a [`Client`].
pub(super) struct Connection {
    tap: TapId,
    sent: Receiver<Frame>,
    received: Sender<Frame>,
}

impl World {
    /// Adds a client that the caller owns, as firmware owns its CAN controller: it sends in the order it is told to,
    /// hears everything but its own frames, and acknowledges.
    pub fn client(&mut self, name: &str) -> Client {
        let tap = self.add_tap(name);
        let (sent, to_bus) = mpsc::channel();
        let (from_bus, received) = mpsc::channel();
        self.clients.push(Connection { tap, sent: to_bus, received: from_bus });
        Client { sent, received }
    }

    /// Gives to the bus what clients have sent, and lets those go that were dropped.
    pub(super) fn take_from_clients(&mut self) {
        let mut clients = std::mem::take(&mut self.clients);
        clients.retain(|Connection { tap, sent, .. }| {
            loop {
                match sent.try_recv() {
                    Ok(frame) => self.send(*tap, frame),
                    Err(TryRecvError::Empty) => return true,
                    Err(TryRecvError::Disconnected) => {
                        self.remove_tap(*tap);
                        return false;
                    }
                }
            }
        });
        self.clients = clients;
    }

    /// Hands to clients what they have heard.
    pub(super) fn give_to_clients(&mut self) {
        for Connection { tap, received, .. } in &self.clients {
            for (_, frame) in self.bus.port_mut(tap.0).take_received() {
                // A client that was dropped meanwhile is let go by the next call.
                let _ = received.send(frame);
            }
        }
    }
}
