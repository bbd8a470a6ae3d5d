//! The frame matcher: pairs the logged and the sent frames of one identifier.
//!
//! Two equal frames that are close in time form a pair. If the two oldest frames do not form a pair, the cheapest
//! alignment of the next frames decides, so that a missing or additional frame does not shift all later pairs.

use std::collections::VecDeque;

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};

use super::identifier::is_cannot_claim;
use super::item::{Item, PATIENCE};
use super::position::PositionTolerance;
use super::report::What;

/// The additional tolerance of a cannot-claim: each node that loses its address delays this message randomly (SAE
/// J1939-81).
pub(super) const CANNOT_CLAIM: Duration = Duration::from_micros(255 * 600);

/// The maximum number of logged frames and of sent frames that an alignment considers.
const AHEAD: usize = 16;

/// The costs of alignment steps: a pair with different data, a frame without a partner, and a pair too far apart in
/// time.
const UNLIKE: u32 = 2;
const ALONE: u32 = 2;
const APART: u32 = 3;

/// The verdict on a frame without a partner, or on a pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Verdict {
    /// The difference; `None` if the frame was sent with the logged data, within the time tolerance.
    pub(super) what: Option<What>,
    /// The end of the logged frame, or of an additional sent frame.
    pub(super) at: Instant,
    /// The logged frame; `None` for an additional sent frame.
    pub(super) logged: Option<Item>,
    /// The sent frame; `None` for a missing frame.
    pub(super) sent: Option<Item>,
}

/// The logged and sent frames of one identifier that have no verdict yet, oldest first.
#[derive(Debug, Default)]
pub(super) struct FrameMatcher {
    pub(super) logged: VecDeque<Item>,
    pub(super) sent: VecDeque<Item>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Pair,
    Missing,
    Additional,
}

impl FrameMatcher {
    /// Judges and removes the oldest frame or pair. Returns `None` if no frame is left, or if the verdict depends on
    /// frames after `known`, the time up to which all frames are known.
    pub(super) fn next(
        &mut self,
        known: Instant,
        tolerance: Duration,
        positions: &PositionTolerance,
    ) -> Option<Verdict> {
        let is_over = |item: &Item| since(known, item.at) > tolerance + PATIENCE;
        let step = match (self.logged.front(), self.sent.front()) {
            (None, None) => return None,
            (Some(logged), Some(sent)) => {
                if pair(logged, sent, tolerance, positions) == Some(0) {
                    Step::Pair
                } else if is_over(logged) || is_over(sent) {
                    self.best(known, tolerance, positions)
                } else {
                    return None;
                }
            }
            (Some(logged), None) if is_over(logged) => Step::Missing,
            (None, Some(sent)) if is_over(sent) => Step::Additional,
            _ => return None,
        };
        let logged = if step == Step::Additional { None } else { self.logged.pop_front() };
        let sent = if step == Step::Missing { None } else { self.sent.pop_front() };
        let what = match (&logged, &sent) {
            (Some(_), None) => Some(What::Missing),
            (None, _) => Some(What::Additional),
            (Some(logged), Some(sent)) => match pair(logged, sent, tolerance, positions) {
                Some(0) => None,
                Some(UNLIKE) => Some(What::Different),
                _ if sent.at < logged.at => Some(What::Early(since(logged.at, sent.at))),
                _ => Some(What::Late(since(sent.at, logged.at))),
            },
        };
        Some(Verdict { what, at: logged.as_ref().or(sent.as_ref())?.at, logged, sent })
    }

    /// Returns the first step of the cheapest alignment of the next frames.
    fn best(&self, known: Instant, tolerance: Duration, positions: &PositionTolerance) -> Step {
        let logged: Vec<&Item> = self.logged.iter().take(AHEAD).collect();
        let sent: Vec<&Item> = self.sent.iter().take(AHEAD).collect();
        // A frame left at the end costs nothing if its partner may be beyond the look-ahead or later than `known`.
        let rest = |items: &[&Item], others: &VecDeque<Item>| {
            let whole = others.len() <= AHEAD;
            let alone = items.iter().filter(|item| whole && after(item.at, tolerance) < known).count();
            ALONE * u32::try_from(alone).unwrap_or(u32::MAX / ALONE)
        };
        let mut costs = vec![vec![0; sent.len() + 1]; logged.len() + 1];
        let mut first = Step::Pair;
        for at in (0..=logged.len()).rev() {
            for other in (0..=sent.len()).rev() {
                let (left, right) = (&logged[at..], &sent[other..]);
                let (Some(one), Some(two)) = (left.first(), right.first()) else {
                    costs[at][other] = rest(left, &self.sent) + rest(right, &self.logged);
                    continue;
                };
                let ways = [
                    pair(one, two, tolerance, positions).map(|cost| (cost + costs[at + 1][other + 1], Step::Pair)),
                    Some((ALONE + costs[at + 1][other], Step::Missing)),
                    Some((ALONE + costs[at][other + 1], Step::Additional)),
                ];
                // Among equal costs, a pair is preferred, then the earlier of two frames without a partner.
                let earlier = if one.at <= two.at { Step::Missing } else { Step::Additional };
                let rank = |step: Step| (step != Step::Pair, step != earlier);
                if let Some((cost, step)) = ways.into_iter().flatten().min_by_key(|(cost, step)| (*cost, rank(*step))) {
                    costs[at][other] = cost;
                    first = step;
                }
            }
        }
        first
    }
}

/// Returns the time tolerance of a frame.
pub(super) fn tolerance_of(frame: &Frame, tolerance: Duration) -> Duration {
    if is_cannot_claim(frame) { tolerance + CANNOT_CLAIM } else { tolerance }
}

/// Returns the cost of pairing two frames; `None` if they cannot be a pair.
fn pair(logged: &Item, sent: &Item, tolerance: Duration, positions: &PositionTolerance) -> Option<u32> {
    let tolerance = tolerance_of(&logged.frame, tolerance);
    let apart = since(logged.at, sent.at).max(since(sent.at, logged.at));
    let alike = apart <= tolerance + PATIENCE && positions.alike(logged, sent);
    match (alike, apart <= tolerance) {
        (true, true) => Some(0),
        (true, false) => Some(APART),
        (false, true) => Some(UNLIKE),
        (false, false) => None,
    }
}
