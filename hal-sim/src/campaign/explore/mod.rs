//! The search beyond the grid: pairs of faults, each with its values and its instant.
//!
//! ```text
//! pair    two faults, and their runs       draw    draws and mutates pairs
//! shrink  the shortest failing case        write   a find as a scenario
//! ```
//!
//! A search without threads and clock: the caller runs the pairs of a round, in any order ([`Campaign::run_pairs`]), and
//! hands over the results in the order of the round. The same plan, seed and number of rounds give the same finds.

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

/// A search for pairs of faults that the controller does not survive, although it survives each of the two.
pub struct Explorer<'a> {
    campaign: &'a Campaign<'a>,
    source: Source<'a>,
    /// The pairs that reached a new state.
    corpus: Vec<Pair>,
    /// The hashes of the reached states.
    states: BTreeSet<u64>,
    /// The kinds of faults and the verdict of each find.
    known: BTreeSet<(String, Verdict)>,
    pairs: u64,
    singles: u64,
    not_injected: u64,
}

/// A pair of faults that fails, although neither of its faults alone does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Find {
    /// The verdict.
    pub verdict: Verdict,
    /// The two faults with their instants, in words.
    pub faults: String,
    /// The seed of the run.
    pub seed: u64,
    /// The find as a scenario, which fails alone; `None` if no scenario reproduces the find.
    pub scenario: Option<String>,
}

impl<'a> Explorer<'a> {
    /// Creates a search in a campaign whose controller is the steps of the scenario.
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

    /// Draws the pairs of the next round; none if the plan has no two faults that can act together.
    pub fn round(&mut self) -> Vec<Pair> {
        (0..ROUND).map_while(|_| self.source.pair(&self.corpus)).collect()
    }

    /// Takes the result of a pair, in the order of the round. Returns the pair in its shortest form if it is a find: it
    /// fails, each of its faults alone does not, and no earlier find has the same kinds of faults and the same verdict.
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

    /// Returns the number of pairs so far.
    #[must_use]
    pub const fn pairs(&self) -> u64 {
        self.pairs
    }

    /// Returns the number of states that controller and devices have reached.
    #[must_use]
    pub fn states(&self) -> usize {
        self.states.len()
    }

    /// Returns the number of pairs that vary further, because they reached a new state.
    #[must_use]
    pub fn corpus(&self) -> usize {
        self.corpus.len()
    }

    /// Returns the number of pairs of which one fault fails alone.
    #[must_use]
    pub const fn singles(&self) -> u64 {
        self.singles
    }

    /// Returns the number of pairs of which one fault did not act.
    #[must_use]
    pub const fn not_injected(&self) -> u64 {
        self.not_injected
    }
}
