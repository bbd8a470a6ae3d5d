//! The active faults of a bus: selects and counts the affected frames.

use std::sync::Arc;

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::delayed::{Delayed, Wait};
use super::fault::{ALWAYS, Delay, Fault, FaultEffect, FaultError, FaultId, FaultKind, MAX_FAULTS};
use super::{Event, EventKind};

/// The faults of a bus, in the order in which they were added. Each fault acts on the result of the previous faults.
#[derive(Clone, Debug)]
pub(super) struct Faults {
    list: Vec<Active>,
    /// The number of the next fault.
    next_id: FaultId,
    /// True if frames can be delayed or changed between a sending application and its controller: by a fault, or by a
    /// slow application.
    pub(super) at_senders: bool,
    /// True if any device delays its answers, or queues frames in front of its controller.
    is_slow: bool,
    /// True if any fault acts between receiving controllers and their applications.
    pub(super) at_receivers: bool,
    /// True if any fault acts on the wire.
    pub(super) on_wire: bool,
    /// The time of the next frame to insert.
    pub(super) next_insertion: Instant,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            list: Vec::new(),
            next_id: FaultId::default(),
            at_senders: false,
            is_slow: false,
            at_receivers: false,
            on_wire: false,
            next_insertion: NEVER,
        }
    }
}

/// A fault and its progress.
#[derive(Clone, Debug)]
struct Active {
    id: FaultId,
    fault: Fault,
    begins: Instant,
    ends: Instant,
    /// The number of frames that the fault can still affect; `None` is unlimited.
    left: Option<u32>,
    struck: u64,
    random: fastrand::Rng,
    /// The time of the next frame to insert; [`NEVER`] for other kinds of faults.
    next: Instant,
}

/// The state of a fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FaultState {
    /// The fault as it was added.
    pub fault: Fault,
    /// The number of affected frames.
    pub struck: u64,
    /// True if the fault will affect no further frames, because its duration has elapsed or its count is used up.
    pub is_over: bool,
}

impl Faults {
    /// Adds a fault. Replaces an expired fault with the same name, or the first expired fault if the list is full.
    pub(super) fn add(&mut self, fault: Fault, now: Instant) -> Result<(), FaultError> {
        fault.check()?;
        if fault.name.is_empty() {
            return Err(FaultError::Invalid("a fault needs a name".to_owned()));
        }
        if let Some(known) = self.list.iter().position(|active| active.fault.name == fault.name) {
            if !self.list[known].is_over(now) {
                return Err(FaultError::Taken(fault.name));
            }
            self.list.remove(known);
        } else if self.list.len() >= MAX_FAULTS {
            let over = self.list.iter().position(|active| active.is_over(now)).ok_or(FaultError::TooMany)?;
            self.list.remove(over);
        }
        let begins = after(now, fault.from);
        let is_once = matches!(fault.kind, FaultKind::Insert { every: None, .. });
        let id = self.next_id;
        self.next_id.0 += 1;
        self.list.push(Active {
            id,
            begins,
            ends: fault.lasts.map_or(NEVER, |lasts| after(begins, lasts)),
            left: fault.count.or(is_once.then_some(1)),
            struck: 0,
            random: fastrand::Rng::with_seed(fault.seed),
            next: if matches!(fault.kind, FaultKind::Insert { .. }) { begins } else { NEVER },
            fault,
        });
        self.sort_out();
        Ok(())
    }

    /// Ends a fault by name; returns whether the fault existed.
    pub(super) fn end(&mut self, name: &str) -> bool {
        let before = self.list.len();
        self.list.retain(|active| *active.fault.name != *name);
        self.sort_out();
        self.list.len() < before
    }

    /// Ends all faults.
    pub(super) fn clear(&mut self) {
        self.list.clear();
        self.sort_out();
    }

    /// Sets whether any device delays its answers, or queues frames in front of its controller.
    pub(super) fn slow_down(&mut self, is_slow: bool) {
        self.is_slow = is_slow;
        self.sort_out();
    }

    pub(super) fn states(&self, now: Instant) -> impl Iterator<Item = FaultState> {
        self.list.iter().map(move |active| FaultState {
            fault: active.fault.clone(),
            struck: active.struck,
            is_over: active.is_over(now),
        })
    }

    /// Returns whether the fault with this name will insert further frames.
    pub(super) fn inserts(&self, name: &str) -> bool {
        self.list.iter().any(|active| *active.fault.name == *name && active.next != NEVER)
    }

    fn sort_out(&mut self) {
        let any = |acts: fn(&FaultKind) -> bool| self.list.iter().any(|active| acts(&active.fault.kind));
        let at_receivers = any(|kind| matches!(kind, FaultKind::Lose { .. }));
        let on_wire = any(|kind| matches!(kind, FaultKind::Destroy | FaultKind::Omit { .. }));
        self.at_senders = self.is_slow || any(FaultKind::acts_at_sender);
        (self.at_receivers, self.on_wire) = (at_receivers, on_wire);
        self.next_insertion = self.list.iter().map(|active| active.next).min().unwrap_or(NEVER);
    }

    /// Applies the faults between the sending application and its controller. Returns the resulting frames and the
    /// events of the faults that have an effect. `can_swap` is false if the sender already has a frame that waits for
    /// its exchange. `uncounted` returns the number of frames that a fault has affected but not yet counted.
    pub(super) fn at_sender(
        &mut self,
        sender: &Arc<str>,
        sent: &Delayed,
        can_swap: bool,
        uncounted: impl Fn(FaultId) -> usize,
        now: Instant,
    ) -> (Vec<Delayed>, Vec<Event>) {
        let (frame, mut frames, mut events) = (&sent.frame, vec![*sent], Vec::new());
        for active in &mut self.list {
            let kind = &active.fault.kind;
            let (acts, counts_later) = (kind.acts_at_sender(), kind.counts_later());
            let can_act = acts && (can_swap || !matches!(kind, FaultKind::Swap { .. }));
            let has_left = || !counts_later || active.left.is_none_or(|left| uncounted(active.id) < left as usize);
            if can_act && has_left() && active.strikes(sender, frame, now) {
                let effect = active.act(&mut frames, sent.due);
                if counts_later || effect.is_none() {
                    active.miss();
                }
                events.extend(effect.map(|effect| active.event(sender, frame, now, effect)));
            }
        }
        (frames, events)
    }

    /// Counts a frame that was exchanged with the next frame of its sender, or whose first copy was handed over.
    pub(super) fn count(&mut self, id: FaultId) {
        if let Some(active) = self.list.iter_mut().find(|active| active.id == id) {
            active.count();
        }
    }

    /// Counts a frame for each fault that loses this frame. Returns one event per fault; the caller withholds the frame
    /// from the receivers in the events.
    pub(super) fn at_receivers(
        &mut self,
        sender: &Arc<str>,
        frame: &Frame,
        has_receiver: impl Fn(&[Arc<str>]) -> bool,
        now: Instant,
    ) -> Vec<Event> {
        let mut events = Vec::new();
        for active in &mut self.list {
            let loses = |kind: &FaultKind| match kind {
                FaultKind::Lose { receivers } => receivers.is_empty() || has_receiver(receivers),
                _ => false,
            };
            if loses(&active.fault.kind)
                && active.strikes(sender, frame, now)
                && let FaultKind::Lose { receivers } = &active.fault.kind
            {
                let effect = FaultEffect::Lost(receivers.clone());
                events.push(active.event(sender, frame, now, effect));
            }
        }
        events
    }

    /// Counts an attempt for the first fault on the wire that affects the attempt. Returns the event of this fault, if
    /// any; the caller applies the effect.
    pub(super) fn on_wire(
        &mut self,
        sender: &Arc<str>,
        frame: &Frame,
        has_receiver: impl Fn(&[Arc<str>]) -> bool,
        now: Instant,
    ) -> Option<Event> {
        self.list.iter_mut().find_map(|active| {
            let effect = match &active.fault.kind {
                FaultKind::Destroy => FaultEffect::Destroyed,
                FaultKind::Omit { receivers } if has_receiver(receivers) => FaultEffect::Omitted(receivers.clone()),
                _ => return None,
            };
            active.strikes(sender, frame, now).then(|| active.event(sender, frame, now, effect))
        })
    }

    /// Returns the frames to insert by `now`, at most one per fault, each with its fault event. Schedules the next
    /// insertions. A fault listed in `busy` skips its frame.
    pub(super) fn insert(&mut self, now: Instant, busy: &[Arc<str>]) -> Vec<(Frame, Event)> {
        let mut inserted = Vec::new();
        for active in self.list.iter_mut().filter(|active| active.next <= now) {
            let FaultKind::Insert { frame, every } = active.fault.kind else { continue };
            let name = Arc::clone(&active.fault.name);
            if !busy.contains(&name) && active.strikes(&name, &frame, now) {
                inserted.push((frame, active.event(&name, &frame, now, FaultEffect::Inserted)));
            }
            active.next = match every {
                Some(every) if !active.is_over(now) => after(active.next, every),
                _ => NEVER,
            };
        }
        self.sort_out();
        inserted
    }
}

impl Active {
    fn is_over(&self, now: Instant) -> bool {
        let is_inserted = matches!(self.fault.kind, FaultKind::Insert { .. }) && self.next == NEVER;
        self.left == Some(0) || self.ends <= now || is_inserted
    }

    /// Decides whether the fault affects a frame, at random if the probability is below 1. Counts an affected frame.
    fn strikes(&mut self, sender: &str, frame: &Frame, now: Instant) -> bool {
        let can = self.begins <= now && !self.is_over(now) && self.fault.frames.passes(sender, frame);
        if !can || self.random.u32(..ALWAYS) >= self.fault.probability {
            return false;
        }
        self.count();
        true
    }

    /// Counts an affected frame.
    fn count(&mut self) {
        self.left = self.left.map(|left| left.saturating_sub(1));
        self.struck += 1;
    }

    /// Reverses the count of a frame.
    fn miss(&mut self) {
        self.struck -= 1;
        self.left = self.left.map(|left| left + 1);
    }

    /// Applies the fault to the frames that result from one frame, which the application sends at `sent`. Returns the
    /// effect; `None` if the frames are unchanged, or the fault does not act between the sending application and its
    /// controller.
    fn act(&mut self, frames: &mut Vec<Delayed>, sent: Instant) -> Option<FaultEffect> {
        let is_swapped = frames[0].wait != Wait::Time;
        Some(match &self.fault.kind {
            FaultKind::Corrupt(corruption) => {
                let before = frames[0].frame;
                frames.iter_mut().for_each(|delayed| delayed.frame = corruption.apply(&delayed.frame));
                if frames[0].frame == before {
                    return None;
                }
                FaultEffect::Corrupted(frames[0].frame)
            }
            // A frame that waits for its exchange has no time of its own.
            FaultKind::Delay { .. } | FaultKind::Repeat { .. } | FaultKind::Swap { .. } if is_swapped => return None,
            FaultKind::Delay { delay, overtake } => {
                let (late, period) = match *delay {
                    Delay::Constant(late) => (late, None),
                    Delay::Uniform(from, to) => {
                        (Duration::from_ticks(self.random.u64(from.as_ticks()..=to.as_ticks())), None)
                    }
                    Delay::Burst(period) => (Duration::from_ticks(0), Some(period)),
                };
                let mut effect = None;
                for delayed in frames.iter_mut() {
                    let late = period.map_or(late, |period| until_multiple(period, since(delayed.due, self.begins)));
                    if late > Duration::from_ticks(0) {
                        delayed.delay(late);
                        delayed.is_overtaken |= *overtake;
                        effect.get_or_insert(FaultEffect::Delayed(late));
                    }
                }
                return effect;
            }
            FaultKind::Repeat { times, after: interval } => {
                let first = Delayed { wait: Wait::Time, is_overtaken: true, is_copy: true, ..frames[0] };
                let copy = |number: u32| Delayed {
                    due: after(first.due, *interval * number),
                    counted_by: (number == 1).then_some(self.id),
                    ..first
                };
                frames.extend((1..=*times).map(copy));
                FaultEffect::Repeated(*times)
            }
            FaultKind::Swap { .. } if frames.len() > 1 || frames[0].due > sent => return None,
            FaultKind::Swap { within } => {
                frames[0].wait = Wait::Next(*within, self.id);
                FaultEffect::Swapped
            }
            FaultKind::Lose { .. } | FaultKind::Insert { .. } | FaultKind::Destroy | FaultKind::Omit { .. } => {
                return None;
            }
        })
    }

    fn event(&self, sender: &Arc<str>, frame: &Frame, now: Instant, effect: FaultEffect) -> Event {
        let fault = Arc::clone(&self.fault.name);
        Event { at: now, who: Arc::clone(sender), what: EventKind::Fault { fault, frame: *frame, effect } }
    }
}

/// Returns the time until the next multiple of `period`; 0 at a multiple.
fn until_multiple(period: Duration, passed: Duration) -> Duration {
    Duration::from_ticks(match passed.as_ticks() % period.as_ticks() {
        0 => 0,
        rest => period.as_ticks() - rest,
    })
}
