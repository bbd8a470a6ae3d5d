//! The judge of a cell whose controller is outside this library: a program, or a client of the control interface.

use std::ops::ControlFlow;

use protocol_core::time::{Instant, NEVER, after};

use super::cell::{Cell, CellResult};
use super::golden::Golden;
use super::observe::Observation;
use super::oracles::Oracles;
use super::run::{Campaign, Row};
use crate::scenario::runner::Watch as _;
use crate::simulation::{Happened, Simulation};

/// The judge of a cell. Injects the fault into a running simulation, and judges the reaction. The steps of the scenario
/// are not executed.
///
/// After each advance of the simulation, call [`event`](Self::event) for each event, then [`poll`](Self::poll). No
/// advance may pass [`due`](Self::due).
#[derive(Debug)]
pub struct Judge {
    campaign: &'static Campaign<'static>,
    row: &'static Row,
    golden: &'static Golden,
    cell: Cell,
    is_exact: bool,
    oracles: Oracles<'static>,
    observation: Observation<'static>,
    /// The states of the devices just before the fault.
    before: Option<Vec<u32>>,
    due: Instant,
    result: Option<CellResult>,
}

impl Judge {
    /// Creates the judge of a cell, and the simulation of the scenario, with unpowered devices; `None` for an unknown
    /// row.
    ///
    /// An *exact* controller acts at the same instants in each run. With an exact controller, the devices are compared
    /// with the golden run at each call. Otherwise power, NMT state, device state machine and active faults must have
    /// their values just before the fault, or any of their values in the golden run during the observation.
    #[must_use]
    pub fn new(campaign: &'static Campaign<'static>, cell: Cell, is_exact: bool) -> Option<(Simulation, Self)> {
        let (row, golden) = campaign.place(cell)?;
        let simulation = campaign.plan().scenario.simulation(row.seed);
        let judge = Self {
            campaign,
            row,
            golden,
            cell,
            is_exact,
            oracles: Oracles::new(campaign.plan(), &simulation),
            observation: Observation::new(campaign.plan(), vec![(cell.at, Some(&row.fault))]),
            before: None,
            due: cell.at,
            result: None,
        };
        Some((simulation, judge))
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
        self.before.get_or_insert_with(|| self.golden.states(simulation));
        self.observation.inject(simulation, &mut self.oracles);
        self.observation.poll(simulation);
        self.compare(simulation);
        self.oracles.look(simulation);
        self.due = match self.observation.next(simulation, &self.oracles) {
            ControlFlow::Break(observed) => {
                self.result = Some(self.campaign.result(self.cell, self.row, self.golden, &observed));
                NEVER
            }
            ControlFlow::Continue(due) => due,
        };
    }

    fn compare(&mut self, simulation: &Simulation) {
        match &self.before {
            Some(before) if !self.is_exact => {
                let period = (self.cell.at, self.end());
                if !self.oracles.has_effect() && !self.golden.is_among(before, period, simulation) {
                    self.oracles.note_effect(simulation.now());
                }
            }
            _ => self.golden.compare(&mut self.oracles, simulation),
        }
    }
}
