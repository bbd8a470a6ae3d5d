//! Bit errors injected from outside the bus.

use std::sync::Arc;

use protocol_core::frame::{Frame, Id};

/// An injector of bit errors. Each bit error destroys the frame for all controllers.
pub trait Injector: Send {
    /// Returns the index of the bit to destroy, if any. Called at the start of each frame: `from` is the name of the
    /// sending port, `bits` the length of the frame.
    fn disturb(&mut self, from: &str, frame: &Frame, bits: u32) -> Option<u32>;
}

/// An [`Injector`] that can be cloned with its bus.
pub(super) trait Injects: Injector {
    fn boxed(&self) -> Box<dyn Injects>;
}

impl<T: Injector + Clone + 'static> Injects for T {
    fn boxed(&self) -> Box<dyn Injects> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn Injects> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}

/// An injector with the same error probability for each bit.
#[derive(Clone, Debug)]
pub struct BitErrors {
    threshold: u64,
    random: fastrand::Rng,
}

impl BitErrors {
    /// Creates an injector that inverts one of `one_in` bits on average; `None` if `one_in` is 0.
    #[must_use]
    pub fn one_in(one_in: u64, seed: u64) -> Option<Self> {
        Some(Self { threshold: u64::MAX.checked_div(one_in)?, random: fastrand::Rng::with_seed(seed) })
    }
}

impl Injector for BitErrors {
    fn disturb(&mut self, _: &str, _: &Frame, bits: u32) -> Option<u32> {
        (0..bits).find(|_| self.random.u64(..) <= self.threshold)
    }
}

/// A requested disturbance: a bit error destroys each of the next matching attempts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Disturbance {
    /// The remaining number of attempts to destroy.
    pub frames: u32,
    /// The identifier of the frames to destroy; `None` for all.
    pub id: Option<Id>,
}

impl Injector for Disturbance {
    fn disturb(&mut self, _: &str, frame: &Frame, bits: u32) -> Option<u32> {
        if self.frames == 0 || self.id.is_some_and(|id| id != frame.id()) {
            return None;
        }
        self.frames -= 1;
        Some(bits / 2)
    }
}

/// An injector that destroys the next transmission attempts of one sender or of all senders.
#[derive(Clone, Debug)]
pub struct DestroyNext {
    left: u32,
    from: Option<Arc<str>>,
}

impl DestroyNext {
    /// Creates an injector that destroys the next `count` transmission attempts by any sender, including
    /// retransmissions.
    #[must_use]
    pub const fn frames(count: u32) -> Self {
        Self { left: count, from: None }
    }

    /// Creates an injector that destroys the next `count` transmission attempts by the port named `from`.
    #[must_use]
    pub fn frames_of(from: &str, count: u32) -> Self {
        Self { left: count, from: Some(from.into()) }
    }
}

impl Injector for DestroyNext {
    fn disturb(&mut self, from: &str, _: &Frame, bits: u32) -> Option<u32> {
        if self.left == 0 || self.from.as_deref().is_some_and(|wanted| wanted != from) {
            return None;
        }
        self.left -= 1;
        Some(bits / 2)
    }
}
