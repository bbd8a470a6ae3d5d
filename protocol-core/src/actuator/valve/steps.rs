//! The timers and monitors of a valve. A step evaluates all of them at one time. A late call steps from deadline to
//! deadline.

use super::super::fault::Fault;
use super::super::monitor::{Reading, tolerance};
use super::super::set_point::SetPoint;
use super::super::spool::{Action, IN_FLOAT, IN_NEUTRAL};
use super::super::travel::{Band, Travel};
use super::{Drive, SpoolMonitors, Valve};
use crate::time::{Instant, NEVER};

/// The band of monitor 1 during a shutdown, for [`SpoolMonitors::ExceptHandAndStop`] (A): the neutral band. A shutdown
/// can end only in neutral, so a spool held outside it must raise a fault.
const SHUTDOWN_BAND: Band = IN_NEUTRAL;

/// The maximum number of deadlines that a late call handles separately. Fewer deadlines can lie between two fault
/// changes: solenoids and springs each move the spool once, and each movement crosses a band at most twice.
const CATCH_UP_STEPS: u32 = 16;

impl Valve {
    /// Returns the band that monitor 1 allows; `None` while the monitor does not run.
    pub(super) fn wanted(&self) -> Option<Band> {
        match self.drive {
            Drive::Regulate(SetPoint::Position(position)) => Some(tolerance(self.target(position))),
            Drive::Off if self.config.spool_monitors == SpoolMonitors::ExceptHandAndStop => Some(SHUTDOWN_BAND),
            Drive::Regulate(SetPoint::Float) | Drive::Off | Drive::Hand | Drive::EmergencyStop => None,
        }
    }

    /// Handles the timers due up to `now`, each at its due time where possible. Returns the time of the call, which is
    /// never earlier than the time of the previous call.
    #[inline]
    pub(super) fn catch_up(&mut self, now: Instant) -> Instant {
        self.now = self.now.max(now);
        if self.now >= self.deadline {
            self.run(self.now);
        }
        self.now
    }

    /// Steps from deadline to deadline up to `now`. After a fault change it handles all remaining deadlines at `now`,
    /// because the protocol must handle the change first.
    // `inline(never)` saves 10 instructions on an SDO download and on an AVEF.
    #[inline(never)]
    fn run(&mut self, now: Instant) {
        for _ in 0..CATCH_UP_STEPS {
            self.step(self.deadline.min(now));
            if self.deadline > now {
                return;
            }
            if !self.faults.changes.is_empty() {
                break;
            }
        }
        // A fault that cleared during catch-up restarts its delay now, because the caller could not act earlier.
        let cleared = self.faults.changes.cleared;
        self.at_set_point.restart_after(cleared);
        self.in_float.restart_after(cleared);
        self.step(now);
    }

    /// Evaluates all monitors at `now`, which must not be earlier than the previous step.
    pub(super) fn step(&mut self, now: Instant) {
        self.environment.observe(self.inputs.supply_mv, self.inputs.temperature_c, &mut self.faults, now);
        self.guard.observe(&mut self.faults, now);
        self.step_spool(now);
        self.schedule();
    }

    /// Evaluates power save and the spool monitors.
    pub(super) fn step_spool(&mut self, now: Instant) {
        let here = self.spool.at(now);
        let neutral = IN_NEUTRAL.contains(here);
        self.energise(here, neutral, now);

        let wanted = self.wanted();
        let away = wanted.is_some_and(|band| !band.contains(here));
        self.at_set_point.observe(Reading { trips: away, clears: neutral }, &mut self.faults, now);
        let short = self.floats() && !IN_FLOAT.contains(here);
        self.in_float.observe(Reading { trips: short, clears: neutral }, &mut self.faults, now);

        self.spool_due = self.at_set_point.due().min(self.in_float.due());
        let rests = self.spool.rests();
        self.spool_due = self.spool_due.min(self.power_save.due(rests));
        if now < rests {
            self.spool_due = self.spool_due.min(self.next_crossing(wanted, now));
        }
    }

    /// Updates power save, and applies solenoids or springs to the spool, which is at `here`.
    fn energise(&mut self, here: Travel, neutral: bool, now: Instant) {
        let commanded = self.drive == Drive::Regulate(SetPoint::NEUTRAL);
        self.power_save.update(commanded, neutral, self.spool.rests(), now);
        let action = match self.drive {
            Drive::Regulate(_) if self.power_save() => Action::Release,
            Drive::Regulate(SetPoint::Position(position)) => Action::Move(self.target(position)),
            Drive::Regulate(SetPoint::Float) => Action::Float,
            Drive::Off | Drive::Hand | Drive::EmergencyStop => Action::Release,
        };
        self.spool.act(action, here, now);
        self.power_save.note_return(|| self.spool.crosses(IN_NEUTRAL, now));
    }

    /// Returns the next time at which the moving spool crosses a monitored limit.
    fn next_crossing(&self, wanted: Option<Band>, now: Instant) -> Instant {
        let mut due = NEVER;
        let mut watch = |band| due = due.min(self.spool.crosses(band, now));
        if let Some(band) = wanted {
            watch(band);
        }
        if self.floats() {
            watch(IN_FLOAT);
        }
        if self.is_active(Fault::SpoolNotAtSetPoint) || self.is_active(Fault::FloatNotReached) {
            watch(IN_NEUTRAL);
        }
        due
    }

    pub(super) fn schedule(&mut self) {
        self.deadline = self.spool_due.min(self.environment.due()).min(self.guard.due());
    }
}
