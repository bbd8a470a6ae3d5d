//! Bit errors on purpose: what disturbs the bus from outside.

use std::sync::Arc;

use protocol_core::frame::{Frame, Id};

/// Something that can flip a bit of a frame on the wire, which destroys it for everybody.
pub trait Injector: Send {
    /// Looks at a frame that starts now, sent by the port named `from`, `bits` long; the bit to be destroyed, if any,
    /// counted from 0.
    fn disturb(&mut self, from: &str, frame: &Frame, bits: u32) -> Option<u32>;
}

/// An [`Injector`] on a bus, which is cloned with the bus.
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

/// Every bit is wrong with the same probability.
#[derive(Clone, Debug)]
pub struct BitErrors {
    threshold: u64,
    random: fastrand::Rng,
}

impl BitErrors {
    /// Returns an injector by which one bit in `one_in` is wrong on average; `None` for zero.
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

/// The next so many attempts to send a frame are destroyed, by a bit error each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Disturbance {
    /// The number of attempts that are left.
    pub frames: u32,
    /// The identifier of the frames; `None`: any.
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

/// The next so many frames are destroyed, of everybody or of one sender.
#[derive(Clone, Debug)]
pub struct DestroyNext {
    left: u32,
    from: Option<Arc<str>>,
}

impl DestroyNext {
    /// Returns an injector that destroys the next `count` frames, whoever sends them.
    #[must_use]
    pub const fn frames(count: u32) -> Self {
        Self { left: count, from: None }
    }

    /// Returns an injector that destroys the next `count` frames of the port named `from`.
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
