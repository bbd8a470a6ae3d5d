//! The judge of a cell whose controller is outside this library: a program, or a client of the control interface.

use std::ops::ControlFlow;

use protocol_core::time::{Instant, NEVER, after};

use super::cell::{Cell, CellResult};
use super::golden::{CampaignError, Golden};
use super::observe::Observation;
use super::oracles::Oracles;
use super::run::{Campaign, Row};
use super::verdict::Observed;
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
    /// The search for the proof before the fault, from the first instant of the plan on; `None` from the fault on.
    unfaulted: Option<Oracles<'static>>,
    observation: Observation<'static>,
    /// The states of the devices just before the fault.
    before: Option<Vec<u32>>,
    due: Instant,
    result: Option<CellResult>,
    /// The reason for the verdict if the proof held before the fault.
    reason: Option<String>,
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
            unfaulted: Some(Oracles::of_proof(campaign.plan(), &simulation)),
            observation: Observation::new(campaign.plan(), vec![(cell.at, Some(&row.fault))]),
            before: None,
            due: campaign.plan().instants.begin().min(cell.at),
            result: None,
            reason: None,
        };
        Some((simulation, judge))
    }

    /// Observes a bus event.
    pub fn event(&mut self, happened: &Happened) {
        self.oracles.event(happened);
        if let Some(unfaulted) = &mut self.unfaulted {
            unfaulted.event(happened);
        }
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

    /// Returns the reason for the verdict [`NotInjected`](super::Verdict::NotInjected) if the proof of detection held
    /// before the fault.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        self.reason.as_deref()
    }

    /// Injects the fault once its instant is reached, and checks devices and oracles afterwards.
    pub fn poll(&mut self, simulation: &mut Simulation) {
        self.look_before_fault(simulation);
        let now = simulation.now();
        // Events at the instant of the fault precede the fault.
        let is_early = now < self.cell.at || (now == self.cell.at && simulation.next() <= now);
        if self.result.is_some() || is_early {
            return;
        }
        self.unfaulted = None;
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

    /// Decides the cell if the proof holds before the fault: a controller that gives the proof without a fault detects
    /// nothing. The golden run has another controller.
    fn look_before_fault(&mut self, simulation: &Simulation) {
        let now = simulation.now();
        let Some(oracles) = self.unfaulted.as_mut().filter(|_| now >= self.campaign.plan().instants.begin()) else {
            return;
        };
        if oracles.have_begun() {
            oracles.look(simulation);
        } else {
            oracles.begin(None, simulation);
        }
        self.due = oracles.due(simulation, self.cell.at);
        if let Some(detected) = oracles.detected() {
            let at = after(self.campaign.plan().instants.begin(), detected);
            self.reason = Some(CampaignError::proof_without_fault(at, self.row.seed).to_string());
            let observed = Observed { struck: 0, is_alive: true, had_effect: false, detected: None, safe: None };
            self.result = Some(self.campaign.result(self.cell, self.row, self.golden, &observed));
            (self.due, self.unfaulted) = (NEVER, None);
        }
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
