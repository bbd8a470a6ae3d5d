//! The far end of the wire of the console.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::Timeline;
use rigless::chip::uart::{Errors, Peer, Rate};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A terminal on the console.
#[derive(Clone, Debug, Default)]
pub struct Terminal(Arc<Mutex<Lines>>);

/// The state of the two wires of a terminal.
#[derive(Debug, Default)]
pub struct Lines {
    /// The typed characters that are not sent yet.
    pub typed: VecDeque<u8>,
    /// A character to be damaged: its position in `typed`, and the damage.
    pub damage: Option<(usize, Damage)>,
    /// The output of the firmware.
    pub printed: Vec<u8>,
    /// The damage of the character on the wire.
    on_wire: Option<Damage>,
}

/// The damage of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Damage {
    /// The flag of the receiver for the damage.
    pub flag: Flag,
    /// The flipped bits of the character, at least one.
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
    /// Locks the wires.
    pub fn lock(&self) -> MutexGuard<'_, Lines> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the damage of the character on the wire. The receiver draws the flipped bits at random, so the seed is the
    /// first one with which it draws these.
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
