//! Tests of the valve through its public interface, in virtual time.

mod faults;
mod model;
mod monitors;
mod power_save;
mod spool;
mod time;

use super::*;
use crate::time::{Duration, Instant};

const CANOPEN: ValveConfig = ValveConfig {
    actuator_type: ActuatorType::Proportional,
    low_temperature: true,
    shared_spool_counter: true,
    spool_monitors: SpoolMonitors::WhileRegulating,
};

const ISOBUS: ValveConfig = ValveConfig {
    low_temperature: false,
    shared_spool_counter: false,
    spool_monitors: SpoolMonitors::ExceptHandAndStop,
    ..CANOPEN
};

const FLOAT: Drive = Drive::Regulate(SetPoint::Float);
const BLOCKED: Drive = Drive::Regulate(SetPoint::NEUTRAL);
const MICROSECOND: Duration = Duration::from_micros(1);

fn ms(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn to(raw: i16) -> Drive {
    Drive::Regulate(SetPoint::Position(Position::new(raw).unwrap()))
}

/// A valve together with its inputs. Times are in milliseconds.
struct Rig {
    valve: Valve,
    inputs: ValveInputs,
}

impl Rig {
    fn new(config: ValveConfig) -> Self {
        Self { valve: Valve::new(config, Counters::default(), ms(0)), inputs: ValveInputs::default() }
    }

    fn sense(&mut self, at: u64, change: impl FnOnce(&mut ValveInputs)) {
        change(&mut self.inputs);
        self.valve.sense(&self.inputs, ms(at));
    }

    fn lever(&mut self, at: u64, raw: i16) {
        self.sense(at, |inputs| inputs.spool.lever = Some(Position::new(raw).unwrap()));
    }

    fn release_lever(&mut self, at: u64) {
        self.sense(at, |inputs| inputs.spool.lever = None);
    }

    fn spool(&mut self, at: u64, fault: SpoolFault) {
        self.sense(at, |inputs| inputs.spool.fault = fault);
    }

    fn drive(&mut self, at: u64, drive: Drive) {
        self.valve.drive(drive, ms(at));
    }

    fn position(&self, at: u64) -> i16 {
        self.valve.position(ms(at)).raw()
    }

    /// Polls the valve and returns the active faults.
    fn active(&mut self, at: Instant) -> FaultSet {
        self.valve.poll(at);
        self.valve.faults()
    }

    /// Checks that the fault activates at this millisecond, not a microsecond earlier, and as `deadline` predicts.
    fn expect_activation(&mut self, fault: Fault, at: u64) {
        assert!(!self.active(ms(at) - MICROSECOND).contains(fault), "{fault:?} before {at} ms");
        assert_eq!(self.valve.deadline(), ms(at), "{fault:?}");
        self.valve.poll(ms(at));
        assert!(self.valve.take_changes().activated.contains(fault), "no {fault:?} at {at} ms");
    }
}
