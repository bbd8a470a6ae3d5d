//! The valve under the device state machine: control word, device mode and set-point (SPEC 4.1, 4.3).

use super::Kind;
use super::state_machine::{DeviceMode, DeviceState, StateMachine};
use crate::actuator::{
    Changes, Condition, Counters, Drive, Led, Position, Scale, SetPoint, SpoolMonitors, Valve, ValveConfig,
};
use crate::time::Instant;

/// The value for float in 0x6300 and 0x6301.
pub(super) const FLOAT: i16 = 32767;

/// The device control: the effect of set-point, control word and device mode on the valve. SDO and RPDO both use it.
#[derive(Clone, Debug)]
pub(super) struct DeviceControl {
    pub(super) valve: Valve,
    machine: StateMachine,
    mode: DeviceMode,
    control_word: u16,
    /// The last accepted set-point, which the objects return.
    set_point: SetPoint,
    /// The set-point in force.
    in_force: SetPoint,
}

impl DeviceControl {
    pub(super) const fn new(kind: Kind) -> Self {
        let config = ValveConfig {
            actuator_type: kind.actuator_type(),
            low_temperature: true,
            shared_spool_counter: true,
            spool_monitors: SpoolMonitors::WhileRegulating,
        };
        Self {
            valve: Valve::new(config, Counters::NONE, Instant::MIN),
            machine: StateMachine::new(),
            mode: DeviceMode::FullOperational,
            control_word: 0,
            set_point: SetPoint::NEUTRAL,
            in_force: SetPoint::NEUTRAL,
        }
    }

    /// Restarts the device control, for reset application. The spool position stays.
    pub(super) fn restart(&mut self, counters: Counters, now: Instant) {
        self.valve.restart(counters, now);
        self.machine = StateMachine::new();
        self.mode = DeviceMode::FullOperational;
        self.control_word = 0;
        self.set_point = SetPoint::NEUTRAL;
        self.in_force = SetPoint::NEUTRAL;
    }

    pub(super) const fn state(&self) -> DeviceState {
        self.machine.state()
    }

    pub(super) const fn mode(&self) -> DeviceMode {
        self.mode
    }

    pub(super) const fn control_word(&self) -> u16 {
        self.control_word
    }

    #[inline]
    pub(super) fn set_control_word(&mut self, word: u16, now: Instant) {
        self.control_word = word;
        let before = self.state();
        self.machine.control(word, !self.valve.faults().is_empty());
        if self.state() != before {
            self.apply(now);
        }
    }

    pub(super) fn set_mode(&mut self, mode: DeviceMode, now: Instant) {
        self.mode = mode;
        self.apply(now);
    }

    /// Accepts a valid set-point: feeds the time guard in any state, and moves the spool of a valve that regulates.
    pub(super) fn accept(&mut self, set_point: SetPoint, now: Instant) {
        self.set_point = set_point;
        if self.valve.regulating() {
            self.in_force = set_point;
            self.valve.command(Drive::Regulate(set_point), now);
        } else {
            self.valve.feed_guard(now);
        }
    }

    pub(super) fn shut_down(&mut self, now: Instant) {
        self.machine.shut_down();
        self.apply(now);
    }

    /// Returns the fault changes. Each activation shuts the valve down, transition D8. (R) In one table of the manual,
    /// some faults do not shut it down.
    pub(super) fn take_changes(&mut self, now: Instant) -> Changes {
        let mut changes = self.valve.take_changes();
        if !changes.activated.is_empty() {
            self.shut_down(now);
            // The shutdown can clear a fault that has just activated, but activates no other fault.
            let more = self.valve.take_changes();
            changes.activated = changes.activated.union(more.activated);
            changes.cleared = changes.cleared.union(more.cleared);
        }
        changes
    }

    pub(super) fn led(&self, has_node_id: bool) -> Led {
        let disabled = !has_node_id || !self.valve.regulating();
        Led::of(Condition {
            faults: self.valve.faults(),
            fault_hold: self.state() == DeviceState::FaultHold,
            disabled,
            power_save: self.valve.power_save(),
        })
    }

    /// Returns the last accepted set-point.
    pub(super) const fn set_point(&self) -> SetPoint {
        self.set_point
    }

    /// Returns the set-point on a scale of ±N. N also stands for float.
    pub(super) fn set_point_on(&self, scale: Scale) -> i16 {
        match self.set_point {
            SetPoint::Position(position) => scale.of_position(position),
            SetPoint::Float => scale.full(),
        }
    }

    /// Returns the value of 0x6300.
    pub(super) const fn set_point_raw(&self) -> i16 {
        match self.set_point {
            SetPoint::Position(position) => position.raw(),
            SetPoint::Float => FLOAT,
        }
    }

    /// Returns the actual value on a scale of ±N. The value is N when float is reached.
    pub(super) fn actual_on(&self, scale: Scale, now: Instant) -> i16 {
        if self.valve.float_reached(now) { scale.full() } else { scale.of_position(self.position(now)) }
    }

    /// Returns the value of 0x6301.
    #[inline]
    pub(super) fn actual_raw(&self, now: Instant) -> i16 {
        if self.valve.float_reached(now) { FLOAT } else { self.position(now).raw() }
    }

    fn position(&self, now: Instant) -> Position {
        self.valve.position(now)
    }

    fn drive(&self) -> Drive {
        match (self.machine.state(), self.mode) {
            (DeviceState::Active, DeviceMode::FullOperational) => Drive::Regulate(self.in_force),
            // Hand operation is `Off`, too, because the spool monitors run only while the valve regulates.
            _ => Drive::Off,
        }
    }

    /// Applies state, mode and set-point to the valve. Regulation begins with a neutral set-point.
    fn apply(&mut self, now: Instant) {
        let regulated = self.valve.regulating();
        if !regulated {
            self.in_force = SetPoint::NEUTRAL;
        }
        let drive = self.drive();
        self.valve.drive(drive, now);
        match (regulated, self.valve.regulating()) {
            (false, true) => self.valve.start_guard(now),
            (true, false) => self.valve.stop_guard(now),
            _ => {}
        }
    }
}
