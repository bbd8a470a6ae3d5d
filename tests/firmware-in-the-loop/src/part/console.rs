//! The far end of the console's wire.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::Timeline;
use rigless::chip::uart::{Errors, Peer, Rate};
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
    /// A character that comes damaged: its place in `typed`, and how.
    pub damage: Option<(usize, Damage)>,
    /// What the firmware has printed.
    pub printed: Vec<u8>,
    /// How the character on the wire comes.
    on_wire: Option<Damage>,
}

/// How a character comes damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damage {
    /// The receiver's flag for it.
    pub flag: Flag,
    /// The bits of the character that are flipped, one at least.
    pub flipped: u8,
}

/// A flag of the receiver (RM0090 30.6.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flag {
    /// NF: the samples of a bit differ.
    Noise,
    /// FE: the stop bit is missing.
    Framing,
}

impl Terminal {
    /// Looks at it.
    pub fn lock(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets how the receiver gets the character on the wire. The receiver draws the bits that it flips: the seed is the
    /// first with which it draws the right ones.
    pub(super) fn damage(&self, errors: &mut Errors) {
        let damage = self.lock().on_wire;
        let rate = |flag| {
            let per_million = if damage.is_some_and(|damage| damage.flag == flag) { Rate::EVERY_WORD } else { 0 };
            Rate { name: "", per_million }
        };
        (errors.noise, errors.framing) = (rate(Flag::Noise), rate(Flag::Framing));
        let Some(Damage { flipped, .. }) = damage else { return };
        while { *errors }.next(u8::BITS).flipped != u16::from(flipped) {
            errors.seed += 1;
        }
    }
}

impl Store for Terminal {}

impl Peer for Terminal {
    fn receive(&mut self, word: u16, _: &mut Timeline<'_, '_>) {
        self.lock().printed.push(word as u8);
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        let Lines { typed, damage, on_wire, .. } = &mut *self.lock();
        let character = typed.pop_front()?;
        *on_wire = damage.take_if(|(place, _)| *place == 0).map(|(_, how)| how);
        if let Some((place, _)) = damage {
            *place -= 1;
        }
        Some(character.into())
    }
}
