//! The valve: ties spool, power save, monitors and faults together (SPEC 2).
//!
//! ```text
//! valve   what the protocol tells the valve and asks it
//! steps   what happens to it in time
//! ```

mod steps;

use super::counters::Counters;
use super::environment::Environment;
use super::fault::{Fault, FaultSet, InternalCause, InternalCauses};
use super::monitor::{FLOAT_DELAY, Monitor, SET_POINT_DELAY, TimeGuard, tolerance};
use super::power_save::PowerSave;
use super::register::{Changes, FaultRegister};
use super::set_point::{Position, SetPoint};
use super::spool::{IN_FLOAT, IN_NEUTRAL, Spool, SpoolSense};
use super::travel::Travel;
use crate::time::{Instant, NEVER};

/// The type of actuator: how a set-point moves the spool (SPEC 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActuatorType {
    /// PVEA: to the set-point.
    Proportional,
    /// PVEO: to full stroke in the direction of any set-point that is not neutral (A).
    OnOff,
}

/// The states in which the two monitors of the spool's position run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpoolMonitors {
    /// Only in [`Drive::Regulate`].
    WhileRegulating,
    /// Always but in [`Drive::Hand`] and [`Drive::EmergencyStop`]; with the drive off the spool has to be in neutral.
    ExceptHandAndStop,
}

/// In what the valves differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValveConfig {
    /// Proportional or on/off.
    pub actuator_type: ActuatorType,
    /// The temperature has a lower limit as well.
    pub low_temperature: bool,
    /// Both faults of the spool share one occurrence counter: either activation counts for both.
    pub shared_spool_counter: bool,
    /// The states in which the monitors of the spool run.
    pub spool_monitors: SpoolMonitors,
}

/// The inputs of a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValveInputs {
    /// Supply voltage, mV.
    pub supply_mv: u32,
    /// Temperature, °C.
    pub temperature_c: i16,
    /// The influences on the spool.
    pub spool: SpoolSense,
}

impl ValveInputs {
    /// A healthy valve on a 24 V supply at room temperature.
    pub const HEALTHY: Self = Self { supply_mv: 24_000, temperature_c: 25, spool: SpoolSense::FREE };
}

impl Default for ValveInputs {
    fn default() -> Self {
        Self::HEALTHY
    }
}

/// The drive that the protocol permits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// Nothing: solenoids off.
    Off,
    /// Hand operation: solenoids off; spool-position faults are not monitored.
    Hand,
    /// Emergency stop: solenoids off; spool-position faults are not monitored.
    EmergencyStop,
    /// Follow the set-point; a neutral one is *blocked*.
    Regulate(SetPoint),
}

/// A valve without a protocol.
///
/// The protocol gives it the inputs ([`sense`](Self::sense)), the permitted drive ([`drive`](Self::drive)) and each valid
/// set-point ([`feed_guard`](Self::feed_guard)), and after every call reports [`take_changes`](Self::take_changes) to the
/// bus. **A fault does not switch the drive**: the protocol shuts the regulation down, by `drive(Drive::Off, now)`.
///
/// Timers due up to an instant act before a call at that instant, polled for or not: the number of
/// [`poll`](Self::poll)s, and their order among the frames of an instant, do not matter. An instant earlier than the last
/// counts as the last. In a late call, timers act as in time up to the first change of a fault, and the rest acts now.
#[derive(Clone, Debug)]
pub struct Valve {
    /// The earliest of all deadlines.
    deadline: Instant,
    /// The earliest deadline of the spool: a monitor, a level that it crosses, power save.
    spool_due: Instant,
    now: Instant,
    config: ValveConfig,
    drive: Drive,
    inputs: ValveInputs,
    spool: Spool,
    power_save: PowerSave,
    faults: FaultRegister,
    internal: InternalCauses,
    at_set_point: Monitor,
    in_float: Monitor,
    environment: Environment,
    guard: TimeGuard,
}

impl Valve {
    /// The full stroke in the unit of [`opening`](Self::opening).
    pub const STROKE: i32 = Travel::FULL;

    /// Returns a valve that is powered up: off, its spool in neutral, all well until [`sense`](Self::sense) says
    /// otherwise.
    #[must_use]
    // 250 bytes, wanted by each device twice: as it is made and as it starts.
    #[inline(never)]
    pub const fn new(config: ValveConfig, counters: Counters, now: Instant) -> Self {
        Self {
            deadline: NEVER,
            spool_due: NEVER,
            now,
            config,
            drive: Drive::Off,
            inputs: ValveInputs::HEALTHY,
            spool: Spool::new(now),
            power_save: PowerSave::Off,
            faults: FaultRegister::new(counters, config.shared_spool_counter),
            internal: InternalCauses::NONE,
            at_set_point: Monitor::new(Fault::SpoolNotAtSetPoint, SET_POINT_DELAY),
            in_float: Monitor::new(Fault::FloatNotReached, FLOAT_DELAY),
            environment: Environment::new(config.low_temperature),
            guard: TimeGuard::STOPPED,
        }
    }

    /// Starts anew without a loss of the supply: as [`new`](Self::new), but the spool is where it is and what
    /// was sensed still holds. Faults are forgotten, and found again after their delay where their causes last; those
    /// without delay have to be set again.
    pub fn restart(&mut self, counters: Counters, now: Instant) {
        let now = self.catch_up(now);
        let Self { inputs, spool, .. } = *self;
        *self = Self::new(self.config, counters, now);
        self.inputs = inputs;
        self.spool = spool;
        self.step(now);
    }

    /// Takes the inputs; costs next to nothing when nothing has changed.
    pub fn sense(&mut self, inputs: &ValveInputs, now: Instant) {
        let now = self.catch_up(now);
        if *inputs != self.inputs {
            self.inputs = *inputs;
            self.note_arrival(now);
            self.spool.sense(inputs.spool, now);
            self.step(now);
        }
    }

    /// Lets what is due act; returns after one comparison when nothing is.
    #[inline]
    pub fn poll(&mut self, now: Instant) {
        self.catch_up(now);
    }

    /// Tells the valve what it may do from now on.
    ///
    /// The same drive again changes nothing and restarts no timer. Another set-point moves the spool, and monitor 1
    /// goes on counting as long as the spool is away. Coming from another drive, regulation begins with fresh monitors
    /// 1 and 2.
    pub fn drive(&mut self, drive: Drive, now: Instant) {
        let now = self.catch_up(now);
        if drive == self.drive {
            return;
        }
        self.note_arrival(now);
        // Where the monitors also run while the drive is off, the end of that is no beginning for them.
        let begins = match self.config.spool_monitors {
            SpoolMonitors::WhileRegulating => matches!(drive, Drive::Regulate(_)) && !self.regulating(),
            SpoolMonitors::ExceptHandAndStop => matches!(self.drive, Drive::Hand | Drive::EmergencyStop),
        };
        self.drive = drive;
        if begins {
            // Monitor 2 runs in float alone and begins anew by itself.
            self.at_set_point.restart();
        }
        self.step_spool(now);
        self.schedule();
    }

    /// Restarts monitor 1 of a spool that has come within the tolerance since the last look. Call it before a change.
    fn note_arrival(&mut self, now: Instant) {
        if self.wanted().is_some_and(|band| band.contains(self.spool.at(now))) {
            self.at_set_point.restart();
        }
    }

    /// Begins to guard that set-points come, or begins anew.
    pub fn start_guard(&mut self, now: Instant) {
        let now = self.catch_up(now);
        self.guard.start(now);
        self.schedule();
    }

    /// Stops the time guard. An active fault 8 stays until [`feed_guard`](Self::feed_guard).
    pub fn stop_guard(&mut self, now: Instant) {
        self.catch_up(now);
        self.guard = TimeGuard::STOPPED;
        self.schedule();
    }

    /// Takes note of a valid set-point, acting or not: winds up the guard if it runs, and ends fault 8 in any case.
    pub fn feed_guard(&mut self, now: Instant) {
        let now = self.catch_up(now);
        self.guard.feed(&mut self.faults, now);
        self.schedule();
    }

    /// Takes a set-point that acts: [`feed_guard`](Self::feed_guard) and [`drive`](Self::drive) in one. A valve that
    /// follows already, with nothing due, takes 570 instructions less for a new set-point.
    #[inline(always)]
    pub fn command(&mut self, drive: Drive, now: Instant) {
        let now = now.max(self.now);
        match drive {
            Drive::Regulate(SetPoint::Position(to)) if now < self.deadline && !to.is_neutral() && self.follows() => {
                self.now = now;
                self.guard.wind_up(now);
                if drive != self.drive {
                    self.follow(to, now);
                }
                self.schedule();
            }
            _ => self.command_in_general(drive, now),
        }
    }

    #[inline(never)]
    fn command_in_general(&mut self, drive: Drive, now: Instant) {
        self.feed_guard(now);
        self.drive(drive, now);
    }

    /// Returns whether a sound spool follows a position other than neutral without an active fault. Float, springs and
    /// power save then play no part, and monitor 1 alone can become due with the spool.
    #[inline]
    fn follows(&self) -> bool {
        matches!(self.drive, Drive::Regulate(SetPoint::Position(_)))
            && self.power_save == PowerSave::Off
            && self.faults.active.is_empty()
            && self.spool.is_free()
    }

    /// Does what [`drive`](Self::drive) does, for a valve that [follows](Self::follows).
    ///
    /// No crossing is computed ahead: the spool only comes closer to its target. Its arrival within the tolerance is
    /// found at the next call that moves it, or when monitor 1 is due.
    #[inline]
    fn follow(&mut self, to: Position, now: Instant) {
        let here = self.spool.at_in_cycle(now);
        if tolerance(self.spool.destination()).contains(here) {
            self.at_set_point.restart();
        }
        let target = self.target(to);
        self.drive = Drive::Regulate(SetPoint::Position(to));
        self.spool.retarget(target, here, now);
        self.at_set_point.watch(!tolerance(target).contains(here), now);
        self.spool_due = self.at_set_point.due();
    }

    /// Notes that a cause of the internal error is there, or gone. The fault is active while any is.
    pub fn set_internal(&mut self, cause: InternalCause, present: bool, now: Instant) {
        self.catch_up(now);
        self.internal.set(cause, present);
        self.faults.set(Fault::Internal, self.internal.any());
    }

    /// Notes that the CAN controller is bus-off, or has recovered.
    pub fn set_bus_off(&mut self, bus_off: bool, now: Instant) {
        self.catch_up(now);
        self.faults.set(Fault::CanBus, bus_off);
    }

    /// Sets the occurrence counters of these faults to 0. It counts as stored: the memory has the zeros already.
    pub fn clear_counters(&mut self, faults: FaultSet) {
        self.faults.counters.clear(faults);
    }

    /// Sets all occurrence counters to 0, and returns what they were. It counts as stored: whoever takes them has the
    /// zeros written.
    pub fn take_counters(&mut self) -> Counters {
        self.faults.counters_changed = false;
        core::mem::take(&mut self.faults.counters)
    }

    /// Adds to the occurrence counters: what was cleared and could not be stored so.
    pub fn add_counters(&mut self, counters: Counters) {
        self.faults.counters = self.faults.counters.plus(counters);
        self.faults.counters_changed = true;
    }

    /// Returns the changes of the faults since this was last called; to be asked after every call that takes a time.
    #[inline]
    pub fn take_changes(&mut self) -> Changes {
        core::mem::take(&mut self.faults.changes)
    }

    /// Returns whether [`take_changes`](Self::take_changes) has something to tell.
    #[inline]
    #[must_use]
    pub const fn has_changes(&self) -> bool {
        !self.faults.changes.is_empty()
    }

    /// Returns whether a counter has changed since this was last called: there is something to be stored.
    pub fn take_counters_changed(&mut self) -> bool {
        core::mem::take(&mut self.faults.counters_changed)
    }

    /// Returns the active faults.
    #[inline]
    #[must_use]
    pub const fn faults(&self) -> FaultSet {
        self.faults.active
    }

    /// Returns whether the fault is active.
    #[inline]
    #[must_use]
    pub const fn is_active(&self, fault: Fault) -> bool {
        self.faults.active.contains(fault)
    }

    /// Returns how often the faults have occurred.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.faults.counters
    }

    /// Returns whether the valve follows set-points.
    #[inline]
    #[must_use]
    pub const fn regulating(&self) -> bool {
        matches!(self.drive, Drive::Regulate(_))
    }

    /// Returns where the spool is.
    #[must_use]
    #[inline]
    pub fn position(&self, now: Instant) -> Position {
        self.spool.at_in_cycle(now.max(self.now)).position()
    }

    /// Returns the travel of the spool from neutral towards the B-port, of [`STROKE`](Self::STROKE) at full stroke: exact
    /// in each microsecond, for a simulation of the flow.
    #[must_use]
    pub fn opening(&self, now: Instant) -> i32 {
        self.travel(now).steps()
    }

    /// Returns the end of the present straight line of [`opening`](Self::opening) in time, if no call changes it.
    /// [`NEVER`] for a spool that rests.
    #[must_use]
    pub fn bends(&self, now: Instant) -> Instant {
        self.spool.bends(now)
    }

    /// Returns whether the spool is in neutral: within 5 % (A).
    #[must_use]
    pub fn in_neutral(&self, now: Instant) -> bool {
        IN_NEUTRAL.contains(self.travel(now))
    }

    /// Returns whether float acts and the spool has reached it, within 5 % (A).
    #[must_use]
    pub fn float_reached(&self, now: Instant) -> bool {
        self.floats() && IN_FLOAT.contains(self.travel(now))
    }

    /// Returns whether the solenoids are energised.
    #[inline]
    #[must_use]
    pub fn solenoids(&self) -> bool {
        self.regulating() && !self.power_save()
    }

    /// Returns whether the valve is blocked and spares its solenoids.
    #[inline]
    #[must_use]
    pub fn power_save(&self) -> bool {
        self.power_save == PowerSave::On
    }

    /// Returns when [`poll`](Self::poll) is next due, to the microsecond; [`NEVER`] when only a call can change
    /// anything.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.deadline
    }

    #[inline]
    fn travel(&self, now: Instant) -> Travel {
        self.spool.at(now.max(self.now))
    }

    fn floats(&self) -> bool {
        self.drive == Drive::Regulate(SetPoint::Float)
    }

    /// Returns where a set-point moves the spool.
    fn target(&self, position: Position) -> Travel {
        match self.config.actuator_type {
            ActuatorType::OnOff if position > Position::NEUTRAL => Travel::FULL_B,
            ActuatorType::OnOff if position < Position::NEUTRAL => Travel::FULL_A,
            ActuatorType::OnOff | ActuatorType::Proportional => position.into(),
        }
    }
}
