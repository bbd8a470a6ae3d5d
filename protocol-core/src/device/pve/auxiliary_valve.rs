//! The auxiliary valve of ISO 11783-7 (SPEC 5): the effect of AVC, the shutdown by a fault, the recovery by two neutral
//! commands, and the data of AVEF and DM2.

use super::fault_codes::codes;
use crate::actuator::{
    ActuatorType, Changes, Condition, Counters, Drive, Fault, FaultSet, Led, Position, Scale, SetPoint, SpoolMonitors,
    Valve, ValveConfig,
};
use crate::isobus::node::Product;
use crate::time::Instant;
use crate::wire::dm::Trouble;
use crate::wire::valve::{Command, EstimatedFlow, State};

/// The number of consecutive neutral commands that end a shutdown.
const NEUTRAL_COMMANDS: u8 = 2;

/// A shutdown of the regulation by faults.
#[derive(Clone, Copy, Debug, Default)]
struct Shutdown {
    /// All faults activated since the shutdown began, including the faults that caused it.
    faults: FaultSet,
    /// The number of consecutive neutral commands received with the spool in neutral and no fault active.
    neutral: u8,
}

/// An auxiliary valve.
#[derive(Clone, Debug)]
pub(super) struct AuxiliaryValve {
    pub(super) valve: Valve,
    /// The last valid command; block before the first command.
    command: Command,
    /// Whether the time guard runs. The first valid command starts it (A).
    guarded: bool,
    shutdown: Option<Shutdown>,
}

impl AuxiliaryValve {
    pub(super) fn new(actuator_type: ActuatorType, now: Instant) -> Self {
        let config = ValveConfig {
            actuator_type,
            low_temperature: false,
            shared_spool_counter: false,
            spool_monitors: SpoolMonitors::ExceptHandAndStop,
        };
        let valve = Valve::new(config, Counters::default(), now);
        Self { valve, command: Command::Block, guarded: false, shutdown: None }
    }

    /// Restarts the valve with these counters. The spool position stays.
    pub(super) fn restart(&mut self, counters: Counters, now: Instant) {
        self.valve.restart(counters, now);
        self.shutdown = None;
        self.block(now);
    }

    /// Executes a valid AVC.
    pub(super) fn execute(&mut self, command: Command, now: Instant) {
        if !self.guarded {
            self.guarded = true;
            self.valve.start_guard(now);
        }
        self.command = command;
        if self.shutdown.is_some() {
            self.valve.feed_guard(now);
            self.recover(now);
            self.apply(now);
        } else {
            self.valve.command(drive(command), now);
        }
    }

    /// Blocks the valve until the next command. The time guard stops, and fault 8 clears.
    pub(super) fn block(&mut self, now: Instant) {
        self.command = Command::Block;
        self.guarded = false;
        self.valve.stop_guard(now);
        self.valve.feed_guard(now);
        self.apply(now);
    }

    /// Blocks the valve with its solenoids off, because a restart is pending. No command arrives before the restart.
    pub(super) fn switch_off(&mut self, now: Instant) {
        self.block(now);
        self.valve.drive(Drive::Off, now);
    }

    /// Returns the fault changes. Every activation shuts the regulation down.
    pub(super) fn take_changes(&mut self, now: Instant) -> Changes {
        let mut changes = self.valve.take_changes();
        if !changes.activated.is_empty() {
            self.shutdown = Some(Shutdown { faults: self.in_shutdown().union(changes.activated), neutral: 0 });
            self.apply(now);
            // The shutdown can clear a fault that has just activated, but activates no other fault.
            let more = self.valve.take_changes();
            changes.activated = changes.activated.union(more.activated);
            changes.cleared = changes.cleared.union(more.cleared);
        }
        changes
    }

    /// Returns the previously active faults: the faults that have occurred, are not active, and are not part of the
    /// shutdown.
    pub(super) fn previously_active_faults(&self) -> FaultSet {
        let counters = self.valve.counters();
        let counted: FaultSet = FaultSet::ALL.into_iter().filter(|fault| counters.get(*fault) > 0).collect();
        counted.difference(self.valve.faults()).difference(self.in_shutdown())
    }

    /// Returns the trouble code of a fault, with its occurrence count and lamp.
    pub(super) fn trouble(&self, fault: Fault) -> Trouble {
        let codes = codes(fault);
        Trouble { lamp: codes.lamp, dtc: codes.dtc, count: self.valve.counters().get(fault) }
    }

    /// Returns the state of the LED. After the loss of the address the LED does not show a shutdown, because no command
    /// can end it.
    pub(super) fn led(&self, address_lost: bool) -> Led {
        Led::of(Condition {
            faults: self.valve.faults(),
            fault_hold: self.shutdown.is_some() && !address_lost,
            disabled: address_lost || !self.valve.regulating(),
            power_save: self.valve.power_save(),
        })
    }

    /// Returns the state in AVEF. During a shutdown the state is blocked.
    pub(super) const fn state(&self) -> State {
        if self.shutdown.is_some() { State::Blocked } else { self.command.state() }
    }

    /// Returns the set-point of the last command. It is neutral during a shutdown, in hand operation and in an
    /// emergency stop.
    pub(super) fn set_point(&self) -> SetPoint {
        match drive(self.command) {
            Drive::Regulate(set_point) if self.shutdown.is_none() => set_point,
            _ => SetPoint::NEUTRAL,
        }
    }

    fn in_shutdown(&self) -> FaultSet {
        self.shutdown.map_or(FaultSet::EMPTY, |shutdown| shutdown.faults)
    }

    /// Counts consecutive neutral commands while the spool is in neutral and no fault is active. The second command
    /// ends the shutdown and blocks the valve.
    fn recover(&mut self, now: Instant) {
        let Some(shutdown) = &mut self.shutdown else { return };
        let counts = self.valve.faults().is_empty() && self.command.is_neutral() && self.valve.in_neutral(now);
        shutdown.neutral = if counts { shutdown.neutral.saturating_add(1) } else { 0 };
        if shutdown.neutral >= NEUTRAL_COMMANDS {
            self.shutdown = None;
            self.command = Command::Block;
        }
    }

    /// Applies the command to the valve. In a shutdown the solenoids are off, but hand operation and emergency stop
    /// still disable the spool monitors.
    fn apply(&mut self, now: Instant) {
        let drive = match drive(self.command) {
            Drive::Regulate(_) if self.shutdown.is_some() => Drive::Off,
            drive => drive,
        };
        self.valve.drive(drive, now);
    }
}

impl Product for AuxiliaryValve {
    /// Encodes AVEF.
    #[inline]
    fn report(&self, now: Instant) -> [u8; 8] {
        let percent = Scale::Percent.of_position(self.valve.position(now));
        let flow = EstimatedFlow {
            extend: percent.max(0) as u8,
            retract: percent.saturating_neg().max(0) as u8,
            state: self.state(),
        };
        flow.emit()
    }

    fn previously_active(&self) -> impl Iterator<Item = Trouble> + Clone {
        self.previously_active_faults().into_iter().map(|fault| self.trouble(fault))
    }
}

/// Returns the drive for a command, without regard to a shutdown.
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

/// Returns the position for a port flow command, 0–250.
fn position(flow: u8) -> Position {
    Scale::Per250.to_position(flow.into()).unwrap_or(Position::NEUTRAL)
}
