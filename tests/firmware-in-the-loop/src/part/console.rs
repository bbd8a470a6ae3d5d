//! The far end of the console's wire.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A terminal on the console.
#[derive(Clone, Debug, Default)]
pub struct Terminal(Arc<Mutex<Lines>>);

/// What is on the two wires of a terminal.
#[derive(Debug, Default)]
pub struct Lines {
    /// What was typed and is not sent yet.
    pub typed: VecDeque<u8>,
    /// What the firmware has printed.
    pub printed: Vec<u8>,
}

impl Terminal {
    /// Looks at it.
    pub fn lock(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store for Terminal {}

impl Peer for Terminal {
    fn receive(&mut self, word: u16, _: &mut Timeline<'_, '_>) {
        self.lock().printed.push(word as u8);
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        self.lock().typed.pop_front().map(u16::from)
    }
}
