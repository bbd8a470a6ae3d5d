//! Two faults with their instants, and their runs.

use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use protocol_core::time::Instant;

use crate::campaign::fault::PlanFault;
use crate::campaign::golden::Golden;
use crate::campaign::master::Scripted;
use crate::campaign::observe::{Spectator, observe};
use crate::campaign::plan::Plan;
use crate::campaign::rig::Rig;
use crate::campaign::run::Campaign;
use crate::campaign::verdict::{Observed, Verdict};
use crate::scenario::OWN;
use crate::scenario::runner::Watch;
use crate::simulation::{Command, Happened, Simulation};

/// Two faults of a run, each at its instant, in the order of time.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The number of the golden run.
    pub(super) golden: usize,
    pub(super) faults: [Timed; 2],
}

/// A fault at its instant.
#[derive(Clone, Debug)]
pub(super) struct Timed {
    pub(super) fault: PlanFault,
    pub(super) at_ms: u32,
}

/// The result of a pair.
#[derive(Debug)]
pub struct Tried {
    pub(super) outcome: Outcome,
    /// The hashes of the states that the controller and the devices reached.
    pub(super) states: BTreeSet<u64>,
}

#[derive(Debug)]
pub(super) enum Outcome {
    Passed,
    /// At least one of the faults changed nothing.
    NotInjected,
    /// The pair fails, but so does at least one of the faults alone.
    Single,
    Fails(Failing),
}

/// A run of a pair that fails.
#[derive(Debug)]
pub(super) struct Failing {
    pub(super) verdict: Verdict,
    pub(super) observed: Observed,
    /// The verdict on each fault alone, with the same observation time as for the pair.
    pub(super) singles: [Verdict; 2],
    /// The number of steps of the scenario that were over at the first fault.
    pub(super) completed: usize,
    /// The instant at which each step acted.
    pub(super) acted: Vec<Instant>,
}

impl Timed {
    pub(super) const fn at(&self) -> Instant {
        Instant::from_millis(self.at_ms as u64)
    }
}

impl Pair {
    /// Returns the instant of the first fault.
    pub(super) const fn begin(&self) -> Instant {
        self.faults[0].at()
    }

    /// Puts the faults into the order of time.
    pub(super) fn sorted(mut self) -> Self {
        self.faults.sort_by_key(|fault| fault.at_ms);
        self
    }

    /// Returns whether the faults can act together. Faults of the same kind cannot, nor can faults that set the same
    /// plant word or the power of the same device, because one fault undoes the other.
    pub(super) fn acts_together(&self) -> bool {
        let [one, other] = self.faults.each_ref().map(|timed| &timed.fault);
        let undo = match (&one.command, &other.command) {
            (Command::Plant(device, _), Command::Plant(same, _)) => {
                device == same && words(one).iter().any(|word| words(other).contains(word))
            }
            (Command::Power(device, _), Command::Power(same, _)) => device == same,
            _ => kind(one) == kind(other),
        };
        !undo
    }

    /// Returns the kinds of the faults, without numbers and instants, in alphabetical order.
    pub(super) fn kinds(&self) -> String {
        let mut kinds = self.faults.each_ref().map(|fault| kind(&fault.fault));
        kinds.sort();
        kinds.join("; ")
    }

    /// Returns the faults with their instants, in words.
    pub(super) fn text(&self) -> String {
        let [first, second] =
            self.faults.each_ref().map(|Timed { fault, at_ms }| format!("{} at {at_ms} ms", fault.text));
        format!("{first}; {second}")
    }
}

/// Returns the kind of a fault as text: its keys without numbers, and the plant words that it sets.
pub(super) fn kind(fault: &PlanFault) -> String {
    fn without_numbers(mut table: toml::Table) -> toml::Table {
        table.retain(|_, value| !value.is_integer());
        for (_, value) in &mut table {
            if let toml::Value::Table(inner) = value {
                *inner = without_numbers(std::mem::take(inner));
            }
        }
        table
    }
    // A word of the plant counts, whatever its number.
    format!("{}{}", toml::Value::Table(without_numbers(fault.entry.clone())), words(fault).join(" "))
}

/// Returns the plant words that a fault sets.
fn words(fault: &PlanFault) -> Vec<&str> {
    let keys = fault.entry.get("plant").and_then(toml::Value::as_table).into_iter().flatten();
    keys.filter_map(|(key, value)| match key.as_str() {
        "for_ms" => None,
        "profile" => value.get("word").and_then(toml::Value::as_str),
        word => Some(word),
    })
    .collect()
}

/// Returns whether a verdict is a failure of a fault that changed something.
const fn fails(verdict: Verdict) -> bool {
    !verdict.passed() && !matches!(verdict, Verdict::NotInjected)
}

/// Creates the golden run of a pair, which has not begun.
pub(super) fn golden<'a>(plan: &'a Plan, golden: &Golden) -> Rig<'a, Simulation> {
    Rig::new(plan, &Scripted, golden.seed, false)
}

impl Campaign<'_> {
    /// Runs each pair in a fork of its golden run at the instant of the first fault. Returns the results in the order
    /// of `pairs`; this order does not affect the results.
    #[must_use]
    pub fn run_pairs(&self, pairs: &[Pair]) -> Vec<Tried> {
        let mut places: Vec<(usize, &Pair)> = pairs.iter().enumerate().collect();
        places.sort_by_key(|(_, pair)| (pair.golden, pair.begin()));
        let mut tried: Vec<(usize, Tried)> = Vec::new();
        for places in places.chunk_by(|(_, one), (_, other)| one.golden == other.golden) {
            let golden = &self.goldens[places[0].1.golden];
            let mut base = self::golden(self.plan(), golden);
            tried.extend(places.iter().map(|(place, pair)| (*place, Tried::of(self, golden, &mut base, pair))));
        }
        tried.sort_by_key(|(place, _)| *place);
        tried.into_iter().map(|(_, tried)| tried).collect()
    }
}

impl Tried {
    /// Runs a pair in a fork of `base`, the golden run, which advances to the instant of the first fault. If the pair
    /// fails, also runs each fault alone.
    pub(super) fn of(campaign: &Campaign<'_>, golden: &Golden, base: &mut Rig<'_, Simulation>, pair: &Pair) -> Self {
        let plan = campaign.plan();
        base.pass(pair.begin(), &mut ());
        let mut reached = Reached::default();
        let [first, second] = pair.faults.each_ref().map(|timed| (timed.at(), Some(&timed.fault)));
        let run = |faults: Vec<_>, spectator: &mut dyn Spectator| {
            let (rig, observed) = observe(plan, golden, base.clone(), faults, spectator);
            (rig, observed, Verdict::of(&observed, &plan.limits))
        };
        let (rig, observed, verdict) = run(vec![first, second], &mut reached);
        let outcome = match verdict {
            verdict if verdict.passed() => Outcome::Passed,
            Verdict::NotInjected => Outcome::NotInjected,
            _ => {
                let alone = [vec![first, (second.0, None)], vec![(first.0, None), second], vec![first]];
                let [one, other, cell] = alone.map(|faults| run(faults, &mut ()).2);
                if [one, other, cell].into_iter().any(fails) {
                    Outcome::Single
                } else {
                    let (completed, acted) = (base.run.completed(), rig.run.acted().to_vec());
                    Outcome::Fails(Failing { verdict, observed, singles: [one, other], completed, acted })
                }
            }
        };
        Self { outcome, states: reached.states }
    }
}

/// The states that a run reaches. Each state combines the frames that the controller sent since the last sample with
/// the states of the devices.
#[derive(Default)]
struct Reached {
    frames: u64,
    states: BTreeSet<u64>,
}

impl Watch for Reached {
    fn event(&mut self, happened: &Happened) {
        if let Some(frame) = happened.event.frame()
            && *happened.event.who == *OWN
        {
            let mut hasher = DefaultHasher::new();
            (frame.key(), frame.data()).hash(&mut hasher);
            self.frames = self.frames.wrapping_add(hasher.finish());
        }
    }
}

impl Spectator for Reached {
    fn sample(&mut self, golden: &Golden, simulation: &Simulation) {
        let mut hasher = DefaultHasher::new();
        std::mem::take(&mut self.frames).hash(&mut hasher);
        golden.all_states(simulation).for_each(|state| state.hash(&mut hasher));
        self.states.insert(hasher.finish());
    }
}
