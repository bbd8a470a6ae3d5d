//! The judge of a cell whose controller is outside this library: a program, or a client of the control interface.

use protocol_core::time::{Instant, NEVER, after};

use super::cell::{Cell, CellResult};
use super::golden::Golden;
use super::injection::Injection;
use super::oracles::{Oracles, next_sample};
use super::plan::Plan;
use super::run::Campaign;
use super::verdict::Observed;
use crate::scenario::runner::Watch as _;
use crate::simulation::{Happened, Simulation};

/// The judge of a cell. Injects the fault into a running simulation, and judges the reaction. The steps of the scenario
/// are not executed.
///
/// After each advance of the simulation, call [`event`](Self::event) for each event, then [`poll`](Self::poll). No
/// advance may pass [`due`](Self::due).
pub struct Judge {
    campaign: &'static Campaign<'static>,
    cell: Cell,
    is_exact: bool,
    oracles: Oracles<'static>,
    injection: Option<Injection<'static>>,
    /// The states of the devices just before the fault.
    before: Vec<u32>,
    /// The instant of the last sample.
    sampled: Instant,
    due: Instant,
    result: Option<CellResult>,
}

impl std::fmt::Debug for Judge {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Judge").field("cell", &self.cell).field("result", &self.result).finish_non_exhaustive()
    }
}

impl Plan {
    /// Creates the simulation of the scenario, with unpowered devices.
    #[must_use]
    pub fn simulation(&self, seed: u64) -> Simulation {
        self.scenario.simulation(seed)
    }
}

impl Judge {
    /// Creates the judge of a cell; `None` for an unknown row.
    ///
    /// An *exact* controller acts at the same instants in each run. With an exact controller, the devices are compared
    /// with the golden run at each sample. Otherwise power, NMT state, device state machine and active faults must have
    /// their values just before the fault, or any of their values in the golden run during the observation.
    #[must_use]
    pub fn new(
        campaign: &'static Campaign<'static>,
        cell: Cell,
        is_exact: bool,
        simulation: &Simulation,
    ) -> Option<Self> {
        campaign.place(cell)?;
        Some(Self {
            campaign,
            cell,
            is_exact,
            oracles: Oracles::new(campaign.plan(), simulation),
            injection: None,
            before: Vec::new(),
            sampled: cell.at,
            due: cell.at,
            result: None,
        })
    }

    /// Observes a bus event.
    pub fn event(&mut self, happened: &Happened) {
        self.oracles.event(happened);
    }

    /// Returns the next instant at which the caller must call [`poll`](Self::poll).
    #[must_use]
    pub const fn due(&self) -> Instant {
        self.due
    }

    /// Returns the end of the observation: the latest instant at which the cell is decided.
    #[must_use]
    pub fn end(&self) -> Instant {
        after(self.cell.at, self.campaign.plan().observe)
    }

    /// Returns the result; `None` until the cell is decided.
    #[must_use]
    pub const fn result(&self) -> Option<&CellResult> {
        self.result.as_ref()
    }

    /// Injects the fault once its instant is reached, and checks devices and oracles afterwards.
    pub fn poll(&mut self, simulation: &mut Simulation) {
        let now = simulation.now();
        // Events at the instant of the fault precede the fault.
        let is_early = now < self.cell.at || (now == self.cell.at && simulation.next() <= now);
        if self.result.is_some() || is_early {
            return;
        }
        let Some((row, golden)) = self.campaign.place(self.cell) else { return };
        if self.injection.is_none() {
            self.before = golden.states(simulation);
            let injection = Injection::begin(&row.fault, simulation);
            self.oracles.begin(injection.name(), simulation);
            self.injection = Some(injection);
        }
        let end = self.end();
        let Some(injection) = &mut self.injection else { return };
        injection.poll(now, simulation);
        let is_sample = now >= next_sample(self.sampled);
        if is_sample {
            self.sampled = now;
        }
        if !self.oracles.has_effect() && self.differs(golden, is_sample, simulation) {
            self.oracles.note_effect(now);
        }
        self.oracles.look(simulation);
        let Some(injection) = &self.injection else { return };
        let struck = injection.struck(simulation);
        if (self.oracles.are_decided() && self.oracles.has_effect() && struck > 0) || now >= end {
            let observed = Observed {
                was_injected: struck > 0,
                // The caller watches the controller.
                is_alive: true,
                had_effect: self.oracles.has_effect(),
                detected: self.oracles.detected(),
                safe: self.oracles.safe(now),
            };
            self.due = NEVER;
            self.result = Some(self.campaign.result(self.cell, row, golden, &observed, struck));
        } else {
            let limit = next_sample(self.sampled).min(end).min(injection.due());
            self.due = self.oracles.due(simulation, limit);
        }
    }

    fn differs(&self, golden: &Golden, is_sample: bool, simulation: &Simulation) -> bool {
        if self.is_exact {
            is_sample && !golden.is_as(simulation)
        } else {
            !golden.is_among(&self.before, (self.cell.at, self.end()), simulation)
        }
    }
}
