//! Injects faults into a run, and observes the run from the first fault until the verdict is decided.

use protocol_core::time::{Instant, NEVER, after};

use super::fault::PlanFault;
use super::golden::Golden;
use super::injection::Injection;
use super::master::Subject;
use super::oracles::next_sample;
use super::plan::Plan;
use super::rig::Rig;
use super::verdict::Observed;
use crate::scenario::runner::Watch;
use crate::simulation::Simulation;

/// An observer of a run with faults.
pub(super) trait Spectator: Watch {
    /// Observes the devices at a sample instant.
    fn sample(&mut self, _golden: &Golden, _simulation: &Simulation) {}
}

impl Spectator for () {}

/// Injects faults into a run that has reached the instant of the first fault, and observes the run until the verdict is
/// decided. The oracles begin at the first instant, and their limits count from the last instant. Both rules also apply
/// to an instant without a fault (`None`).
///
/// Returns the run, the observations, and the smallest [number of affected frames](Injection::struck) of all faults.
pub(super) fn observe<'a, T: Subject>(
    plan: &Plan,
    golden: &Golden,
    mut rig: Rig<'a, T>,
    faults: &[(Instant, Option<&PlanFault>)],
    spectator: &mut dyn Spectator,
) -> (Rig<'a, T>, Observed, u64) {
    let mut now = faults.first().map_or(NEVER, |(at, _)| *at);
    let end = after(faults.last().map_or(now, |(at, _)| *at), plan.observe);
    let mut to_come = faults.iter().peekable();
    let mut injections: Vec<Injection<'_>> = Vec::new();
    rig.run.forgive();
    loop {
        while let Some((_, fault)) = to_come.next_if(|(at, _)| *at <= now) {
            let injection = fault.map(|fault| Injection::begin(fault, &mut rig.target));
            let name = injection.as_ref().and_then(Injection::name);
            rig.oracles.begin(name, rig.target.simulation());
            injections.extend(injection);
        }
        let struck = |simulation: &Simulation| injections.iter().map(|it| it.struck(simulation)).min().unwrap_or(0);
        let simulation = rig.target.simulation();
        let is_decided = rig.oracles.are_decided() && rig.oracles.has_effect() && to_come.peek().is_none();
        if now >= end || !rig.target.is_alive() || (is_decided && struck(simulation) > 0) {
            let observed = Observed {
                was_injected: struck(simulation) > 0,
                is_alive: rig.target.is_alive(),
                had_effect: rig.oracles.has_effect(),
                detected: rig.oracles.detected(),
                safe: rig.oracles.safe(now),
            };
            let struck = struck(simulation);
            return (rig, observed, struck);
        }
        let sample = next_sample(now);
        let next = to_come.peek().map_or(NEVER, |(at, _)| *at);
        let due = injections.iter().map(Injection::due).fold(sample.min(end).min(next), Instant::min);
        now = rig.oracles.due(simulation, due);
        rig.pass(now, spectator);
        injections.iter_mut().for_each(|injection| injection.poll(now, &mut rig.target));
        if now == sample {
            spectator.sample(golden, rig.target.simulation());
            if !rig.oracles.has_effect() && !golden.is_as(rig.target.simulation()) {
                rig.oracles.note_effect(now);
            }
        }
        rig.oracles.look(rig.target.simulation());
    }
}
