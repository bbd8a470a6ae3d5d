//! The search for pairs of faults that fail only together. A fault or pair *fails* if its verdict is not a pass.
//!
//! ```text
//! pair    two faults, and their runs       draw    draws and mutates pairs
//! shrink  the shortest failing case        write   a find as a scenario
//! ```
//!
//! The search uses neither threads nor a clock. The caller runs the pairs of a round in any order
//! ([`Campaign::run_pairs`]), and passes the results to [`Explorer::take`] in the order of the round. The same plan,
//! seed and number of rounds give the same finds.

mod draw;
mod pair;
mod shrink;
#[cfg(test)]
mod tests;
mod write;

use std::collections::BTreeSet;

use super::run::Campaign;
use super::verdict::Verdict;

use draw::Source;
use pair::Outcome;
pub use pair::{Pair, Tried};

/// The number of pairs in a round.
const ROUND: usize = 64;

/// A search for pairs of faults that fail together although neither fails alone.
pub struct Explorer<'a> {
    campaign: &'a Campaign<'a>,
    source: Source<'a>,
    /// The pairs that reached a new state.
    corpus: Vec<Pair>,
    /// The hashes of the reached states.
    states: BTreeSet<u64>,
    /// For each find so far, its kinds of faults and its verdict.
    known: BTreeSet<(String, Verdict)>,
    /// The number of recorded pairs.
    pub pairs: u64,
    /// The number of failing pairs in which a fault also fails alone.
    pub singles: u64,
    /// The number of pairs in which a fault changed nothing.
    pub not_injected: u64,
}

/// A pair of faults that fails, although neither of its faults alone does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Find {
    /// The verdict on the pair.
    pub verdict: Verdict,
    /// The two faults with their instants, in words.
    pub faults: String,
    /// The seed of the run.
    pub seed: u64,
    /// A scenario that reproduces the failure; `None` if no scenario does.
    pub scenario: Option<String>,
}

impl<'a> Explorer<'a> {
    /// Creates a search in a campaign without a separate controller.
    #[must_use]
    pub fn new(campaign: &'a Campaign<'a>, seed: u64) -> Self {
        Self {
            campaign,
            source: Source::new(campaign, seed),
            corpus: Vec::new(),
            states: BTreeSet::new(),
            known: BTreeSet::new(),
            pairs: 0,
            singles: 0,
            not_injected: 0,
        }
    }

    /// Draws the pairs of the next round. The round is shorter if no further faults are found that can act together.
    pub fn round(&mut self) -> Vec<Pair> {
        (0..ROUND).map_while(|_| self.source.pair(&self.corpus)).collect()
    }

    /// Records the result of a pair. Must be called in the order of the round. Returns the pair in its shortest form if
    /// the pair is a find: neither of its faults fails alone, and no earlier find has the same kinds of faults and the
    /// same verdict.
    pub fn take(&mut self, pair: Pair, tried: Tried) -> Option<Find> {
        self.pairs += 1;
        let before = self.states.len();
        self.states.extend(tried.states);
        match tried.outcome {
            Outcome::Passed if self.states.len() > before => self.corpus.push(pair),
            Outcome::Passed => {}
            Outcome::NotInjected => self.not_injected += 1,
            Outcome::Single => self.singles += 1,
            Outcome::Fails(failing) if self.known.insert((pair.kinds(), failing.verdict)) => {
                return Some(shrink::shrink(self.campaign, &pair, failing));
            }
            Outcome::Fails(_) => {}
        }
        None
    }

    /// Returns the number of different states that the controller and the devices have reached.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states.len()
    }

    /// Returns the number of passing pairs that reached a new state; new pairs are mostly variations of these.
    #[must_use]
    pub fn corpus(&self) -> usize {
        self.corpus.len()
    }
}
