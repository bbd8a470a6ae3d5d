//! What an AVC does to the valve; shutdown by a fault, and recovery by two neutral set-points (SPEC 5).

use crate::actuator::{
    Changes, Condition, Counters, Drive, FaultSet, Led, Position, Regulation, Scale, SetPoint, SpoolMonitors, Valve,
    ValveConfig,
};
use crate::time::Instant;
use crate::wire::valve::{Command, EstimatedFlow, State};

/// So many neutral set-points, one after the other, end a shutdown.
const NEUTRAL_SET_POINTS: u8 = 2;

/// A fault has shut the regulation down.
#[derive(Clone, Copy, Debug, Default)]
struct Shutdown {
    /// What has occurred since it began: logged as previously active when it ends.
    faults: FaultSet,
    /// How many set-points in a row were neutral, with the spool in neutral and nothing active.
    neutral: u8,
}

/// The valve under the commands of the bus.
#[derive(Debug)]
pub(super) struct Commander {
    pub(super) valve: Valve,
    /// The last valid one; block before the first.
    command: Command,
    /// The time guard runs: from the first valid set-point on (A).
    guarded: bool,
    shutdown: Option<Shutdown>,
    /// What AVEF tells: that of the command, blocked in a shutdown.
    state: State,
}

impl Commander {
    pub(super) fn new(regulation: Regulation, counters: Counters, now: Instant) -> Self {
        let config = ValveConfig {
            regulation,
            low_temperature: false,
            shared_spool_counter: false,
            spool_monitors: SpoolMonitors::ExceptHandAndStop,
        };
        let mut commander = Self {
            valve: Valve::new(config, counters, now),
            command: Command::Block,
            guarded: false,
            shutdown: None,
            state: State::Blocked,
        };
        commander.apply(now);
        commander
    }

    /// The device starts anew: everything but the spool, which is where it is.
    pub(super) fn restart(&mut self, counters: Counters, now: Instant) {
        self.valve.restart(counters, now);
        self.command = Command::Block;
        self.guarded = false;
        self.shutdown = None;
        self.apply(now);
    }

    /// A valid AVC was received. The faults that were active in a shutdown which it ends, if it does.
    #[inline]
    pub(super) fn obey(&mut self, command: Command, now: Instant) -> FaultSet {
        if !self.guarded || self.shutdown.is_some() {
            return self.obey_first_or_shut_down(command, now);
        }
        self.command = command;
        self.state = command.state();
        self.valve.command(drive(command), now);
        FaultSet::EMPTY
    }

    /// The same for the first AVC, and in a shutdown.
    #[inline(never)]
    fn obey_first_or_shut_down(&mut self, command: Command, now: Instant) -> FaultSet {
        if !self.guarded {
            self.guarded = true;
            self.valve.start_guard(now);
        }
        self.command = command;
        self.valve.feed_guard(now);
        let ended = self.recover(command, now);
        self.apply(now);
        ended
    }

    /// The address is lost: blocked, and nobody is waited for.
    pub(super) fn block(&mut self, now: Instant) {
        self.command = Command::Block;
        self.guarded = false;
        self.valve.stop_guard(now);
        self.apply(now);
    }

    /// What became of the faults; every one that was activated has shut the regulation down.
    pub(super) fn take_changes(&mut self, now: Instant) -> Changes {
        let mut changes = self.valve.take_changes();
        if !changes.activated.is_empty() {
            let faults = self.shutdown.map_or(FaultSet::EMPTY, |shutdown| shutdown.faults);
            self.shutdown = Some(Shutdown { faults: faults.union(changes.activated), neutral: 0 });
            self.apply(now);
            // Switching the drive off can clear what was just activated, never activate.
            let more = self.valve.take_changes();
            changes.activated = changes.activated.union(more.activated);
            changes.cleared = changes.cleared.union(more.cleared);
        }
        changes
    }

    /// What the valve tells of itself: its state and where the spool lets the oil flow.
    #[inline]
    pub(super) fn estimated_flow(&self, now: Instant) -> EstimatedFlow {
        let percent = Scale::Percent.of_position(self.valve.position(now));
        EstimatedFlow {
            extend: percent.max(0) as u8,
            retract: percent.saturating_neg().max(0) as u8,
            state: self.state,
        }
    }

    pub(super) fn led(&self, address_lost: bool) -> Led {
        Led::of(Condition {
            faults: self.valve.faults(),
            fault_hold: self.shutdown.is_some(),
            disabled: address_lost || !self.valve.regulating(),
            power_save: self.valve.power_save(),
        })
    }

    /// Counts neutral set-points while nothing is active; the second ends the shutdown, and acts no more itself.
    fn recover(&mut self, command: Command, now: Instant) -> FaultSet {
        let Some(shutdown) = &mut self.shutdown else { return FaultSet::EMPTY };
        let counts = self.valve.faults().is_empty() && command.is_neutral() && self.valve.in_neutral(now);
        shutdown.neutral = if counts { shutdown.neutral.saturating_add(1) } else { 0 };
        if shutdown.neutral < NEUTRAL_SET_POINTS {
            return FaultSet::EMPTY;
        }
        let ended = shutdown.faults;
        self.shutdown = None;
        self.command = Command::Block;
        ended
    }

    /// Lets the valve do what the command says. In a shutdown the solenoids are off, and hand operation and emergency
    /// stop still keep the faults of the spool from being looked for.
    fn apply(&mut self, now: Instant) {
        self.state = if self.shutdown.is_some() { State::Blocked } else { self.command.state() };
        let drive = match drive(self.command) {
            Drive::Regulate(_) if self.shutdown.is_some() => Drive::Off,
            drive => drive,
        };
        self.valve.drive(drive, now);
    }
}

/// What a command lets the valve do when nothing keeps it from it.
#[inline]
fn drive(command: Command) -> Drive {
    match command {
        Command::HandOperation => Drive::Hand,
        Command::EmergencyStop => Drive::EmergencyStop,
        Command::Block => Drive::Regulate(SetPoint::NEUTRAL),
        Command::Extend(flow) => Drive::Regulate(SetPoint::Position(position(flow))),
        Command::Retract(flow) => Drive::Regulate(SetPoint::Position(position(flow).mirrored())),
        Command::Float => Drive::Regulate(SetPoint::Float),
    }
}

/// The position of a port flow command, 0–250.
#[inline]
fn position(flow: u8) -> Position {
    Scale::Per250.to_position(flow.into()).unwrap_or(Position::NEUTRAL)
}
