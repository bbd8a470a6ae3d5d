//! How far the positions of the stand-ins move within the tolerance: so much may a position in a frame differ.
//!
//! A spool that rests moves nowhere: then frames are alike when they are equal.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use protocol_core::device::pve::DeviceState;
use protocol_core::frame::{Frame, Id};
use protocol_core::time::{Duration, Instant, after};
use protocol_core::wire::j1939_id::{J1939Id, Pgn};
use protocol_core::wire::valve::EstimatedFlow;

use super::lane::{Item, PATIENCE};
use crate::kind::Kind;

/// A position is noted at least so often while it changes.
const GRID: Duration = Duration::from_millis(1);

/// The positions of all stand-ins.
#[derive(Debug)]
pub(super) struct Travels {
    devices: Vec<(Kind, VecDeque<(Instant, i16)>)>,
    tolerance: Duration,
}

impl Travels {
    pub(super) fn new(kinds: impl Iterator<Item = Kind>, tolerance: Duration) -> Self {
        Self { devices: kinds.map(|kind| (kind, VecDeque::new())).collect(), tolerance }
    }

    /// Notes a position, where it is another one than before.
    pub(super) fn note(&mut self, device: usize, now: Instant, position: i16) {
        if let Some((_, noted)) = self.devices.get_mut(device)
            && noted.back().is_none_or(|(_, last)| *last != position)
        {
            noted.push_back((now, position));
        }
    }

    /// Forgets what no pair is looked for any more.
    pub(super) fn forget(&mut self, known: Instant) {
        let needed = (PATIENCE + self.tolerance + GRID) * 4;
        let from = Instant::from_ticks(known.as_ticks().saturating_sub(needed.as_ticks()));
        for (_, noted) in &mut self.devices {
            while noted.get(1).is_some_and(|(at, _)| *at < from) {
                noted.pop_front();
            }
        }
    }

    /// Returns whether two frames of an identifier say the same: equal, but for a position that comes by within the
    /// tolerance.
    pub(super) fn alike(&self, logged: &Item, sent: &Item) -> bool {
        logged.frame == sent.frame
            || self.range(logged, sent).is_some_and(|(kind, range)| differ_in_position(kind, logged, sent, &range))
    }

    /// Returns the kind of the sender, and its positions from the tolerance before the first of two frames to the
    /// tolerance after the last; `None` when there is one alone.
    fn range(&self, logged: &Item, sent: &Item) -> Option<(Kind, RangeInclusive<i16>)> {
        let margin = self.tolerance + GRID;
        let (first, last) = (logged.at.min(sent.at), logged.at.max(sent.at));
        let from = Instant::from_ticks(first.as_ticks().saturating_sub(margin.as_ticks()));
        let until = after(last, margin);
        let (kind, noted) = self.devices.get(sent.device?)?;
        let begin = noted.partition_point(|(at, _)| *at <= from).saturating_sub(1);
        let within = noted.iter().skip(begin).take_while(|(at, _)| *at <= until).map(|(_, position)| *position);
        let (min, max) = within.fold((i16::MAX, i16::MIN), |(min, max), at| (min.min(at), max.max(at)));
        (min < max).then_some((*kind, min..=max))
    }
}

/// Returns whether two frames are equal but for a position, which is in the range in both: in a PDO as 0x6301 or
/// 0x6004, in an answer of SDO on the scale of the object, in an AVEF as a flow.
fn differ_in_position(kind: Kind, logged: &Item, sent: &Item, range: &RangeInclusive<i16>) -> bool {
    let (one, two) = (&logged.frame, &sent.frame);
    if one.len() != two.len() {
        return false;
    }
    let whole = i32::from(*range.start())..=i32::from(*range.end());
    let in_pdo = || places(kind, two.data(), range).any(|at| differ_at::<2>(one, two, at, &whole));
    match (one.id(), kind) {
        (Id::Standard(id), _) => match id.as_raw() {
            0x000..=0x17F | 0x600..=0x7FF => false,
            0x581..=0x5FF => match one.data() {
                [_, 0x01, 0x63, 0x01, ..] | [_, 0x04, 0x60, 0x00, ..] => differ_at::<2>(one, two, 4, &whole),
                [_, 0x04, 0x33, 0x00, ..] => differ_at::<2>(one, two, 4, &scaled(range, 1000)),
                [_, 0x01, 0x33, 0x00, ..] => differ_at::<1>(one, two, 4, &scaled(range, 127)),
                [_, 0x02, 0x33, 0x00, ..] => differ_at::<1>(one, two, 4, &scaled(range, -127)),
                _ => false,
            },
            _ => in_pdo(),
        },
        // Of a sensor alone a PDO may have a 29-bit COB-ID.
        (Id::Extended(_), Kind::Hat(_)) => in_pdo(),
        (Id::Extended(id), Kind::Pve(_)) => {
            let flow = |frame: &Frame| EstimatedFlow::parse(frame.data());
            let id = J1939Id::from_raw(id.as_raw());
            id.pgn() == Pgn::avef(id.source().get())
                && matches!((flow(one), flow(two)), (Some(logged), Some(sent))
                    if logged.state == sent.state && [logged, sent].iter().all(|flow| has(range, flow)))
        }
    }
}

/// Returns where a position may be in a PDO: anywhere, for the mapping can be any. But a status word of a valve that a
/// position follows, as in the default mapping, is none.
fn places(kind: Kind, data: &[u8], range: &RangeInclusive<i16>) -> std::ops::Range<usize> {
    let is_default = match (kind, data) {
        (Kind::Pve(_), &[a, b, low, high]) => {
            let word = u16::from_le_bytes([a, b]);
            range.contains(&i16::from_le_bytes([low, high]))
                && DeviceState::ALL.into_iter().any(|state| state.status_word() == word)
        }
        _ => false,
    };
    if is_default { 2..data.len() } else { 0..data.len() }
}

/// Returns whether two frames are equal but for the number of N bytes from a byte on, which is in the range in both.
fn differ_at<const N: usize>(one: &Frame, two: &Frame, at: usize, range: &RangeInclusive<i32>) -> bool {
    let split = |frame: &Frame| {
        let (before, rest) = frame.bytes().split_at(at.min(8));
        let (number, after) = rest.split_first_chunk::<N>()?;
        let is_whole = at + N <= frame.data().len();
        let sign = if number.last().is_some_and(|high| *high >= 0x80) { -1 } else { 0 };
        let number = number.iter().rev().fold(sign, |number, byte| number << 8 | i32::from(*byte));
        (is_whole && range.contains(&number)).then(|| (before.to_vec(), after.to_vec()))
    };
    split(one).is_some_and(|one| Some(one) == split(two))
}

/// Returns the positions of a range where so much is the full stroke, whichever way they are rounded.
fn scaled(range: &RangeInclusive<i16>, full: i32) -> RangeInclusive<i32> {
    const FULL: i32 = 16_384;
    let [start, end] = [range.start(), range.end()].map(|position| i32::from(*position) * full / FULL);
    start.min(end) - 1..=start.max(end) + 1
}

/// Returns whether a flow is of a position in the range, to the percent.
fn has(range: &RangeInclusive<i16>, flow: &EstimatedFlow) -> bool {
    scaled(range, 100).contains(&(i32::from(flow.extend) - i32::from(flow.retract)))
}
