//! The spool monitors, compared with an independent model derived from SPEC 2.
//!
//! The valve computes deadlines ahead, and evaluates as rarely as possible while it follows set-points. The model
//! evaluates every millisecond, and locates a change within a millisecond by bisection.

use super::time::Numbers;
use super::*;

/// Microseconds since power-up.
type Micros = i64;

/// The full stroke, in steps for which every rate here is an integer per microsecond.
const STROKE: i64 = 768_000_000;
const UNIT: i64 = STROKE / Position::FULL as i64;
const SOLENOIDS: i64 = STROKE / 250_000;
const SPRINGS: i64 = STROKE / 150_000;

/// A monitor, and the time since when its reading has been bad.
#[derive(Debug)]
struct Watch {
    fault: Fault,
    delay: Micros,
    since: Option<Micros>,
}

impl Watch {
    fn look(&mut self, bad: bool, now: Micros) {
        self.since = bad.then_some(self.since.unwrap_or(now));
    }
}

#[derive(Debug)]
struct Model {
    config: ValveConfig,
    drive: Drive,
    slow: bool,
    lever: Option<i64>,
    /// The start of the present movement: travel and time.
    from: (i64, Micros),
    now: Micros,
    watches: [Watch; 2],
}

impl Model {
    fn new(config: ValveConfig) -> Self {
        let watches = [(Fault::SpoolNotAtSetPoint, 500_000), (Fault::FloatNotReached, 1_000_000)];
        let watches = watches.map(|(fault, delay)| Watch { fault, delay, since: None });
        Self { config, drive: Drive::Off, slow: false, lever: None, from: (0, 0), now: 0, watches }
    }

    /// Returns the destination and the speed of the spool.
    fn course(&self) -> (i64, i64) {
        match self.drive {
            Drive::Regulate(SetPoint::Position(position)) => (i64::from(position.raw()) * UNIT, SOLENOIDS),
            Drive::Regulate(SetPoint::Float) => (STROKE, SOLENOIDS),
            Drive::Off | Drive::Hand | Drive::EmergencyStop => (0, SPRINGS),
        }
    }

    fn place(&self, now: Micros) -> i64 {
        let ((from, start), (to, rate)) = (self.from, self.course());
        let way = (now - start) * if self.slow { rate / 8 } else { rate };
        self.lever.unwrap_or(if from < to { to.min(from + way) } else { to.max(from - way) })
    }

    /// Returns whether the reading of each monitor is bad.
    fn bad(&self, now: Micros) -> [bool; 2] {
        let place = self.place(now);
        let runs = match self.drive {
            Drive::Regulate(set_point) => set_point != SetPoint::Float,
            Drive::Off => self.config.spool_monitors == SpoolMonitors::ExceptHandAndStop,
            Drive::Hand | Drive::EmergencyStop => false,
        };
        let percent = if self.drive == Drive::Off { 5 } else { 15 };
        let away = (place - self.course().0).abs() > STROKE / 100 * percent;
        let short = STROKE - place > STROKE / 100 * 5;
        [runs && away, self.drive == FLOAT && short]
    }

    /// Advances the time; returns the first fault that activates, and its time.
    fn pass(&mut self, until: Micros) -> Option<(Fault, Micros)> {
        while self.now < until {
            let next = (self.now + 1000).min(until);
            let (before, after) = (self.bad(self.now), self.bad(next));
            for (index, watch) in self.watches.iter_mut().enumerate() {
                watch.look(before[index], self.now);
            }
            for index in 0..self.watches.len() {
                let (mut old, mut new) = (self.now, next);
                while after[index] != before[index] && new - old > 1 {
                    let middle = (old + new) / 2;
                    *(if self.bad(middle)[index] == before[index] { &mut old } else { &mut new }) = middle;
                }
                // `new` is the first time of a changed reading: a reading that is bad only until then does not count.
                let watch = &mut self.watches[index];
                let due = watch.since.map_or(Micros::MAX, |since| since + watch.delay);
                if due < new || (due == new && after[index]) {
                    return Some((watch.fault, due));
                }
                watch.look(after[index], new);
            }
            self.now = next;
        }
        None
    }

    /// Applies a change now: the spool starts a new movement from its present travel.
    fn change(&mut self, change: impl FnOnce(&mut Self)) {
        self.from = (self.place(self.now), self.now);
        let (drive, config) = (self.drive, self.config.spool_monitors);
        change(self);
        let regulates = |drive| matches!(drive, Drive::Regulate(_));
        let begins = match config {
            SpoolMonitors::WhileRegulating => !regulates(drive) && regulates(self.drive),
            SpoolMonitors::ExceptHandAndStop => matches!(drive, Drive::Hand | Drive::EmergencyStop),
        };
        if begins && drive != self.drive {
            self.watches[0].since = None;
        }
        let bad = self.bad(self.now);
        for (watch, bad) in self.watches.iter_mut().zip(bad) {
            watch.look(bad, self.now);
        }
    }
}

/// Returns a set-point, usually far away, so that a frequently reversing spool stays outside the tolerance for long.
fn set_point(numbers: &mut Numbers) -> Drive {
    match numbers.next(20) {
        0 => BLOCKED,
        1 => FLOAT,
        2..=7 => to(Position::FULL),
        8..=13 => to(-Position::FULL),
        _ => to(numbers.position()),
    }
}

/// Plays set-points and occasional other events until a fault activates; returns the fault and the number of events.
fn run(seed: u64, config: ValveConfig) -> Option<(Fault, u32)> {
    let mut numbers = Numbers::new(seed);
    let (mut valve, mut model) = (Valve::new(config, Counters::default(), ms(0)), Model::new(config));
    let mut inputs = ValveInputs::default();
    for event in 0..40 {
        let pause = if numbers.next(16) == 0 { 1_500_000 } else { 200_000 };
        let next = model.now + 1 + numbers.next(pause) as Micros;
        let activated = model.pass(next);
        let at = |micros: Micros| Instant::from_micros(micros as u64);
        while valve.deadline() < at(next) {
            let due = valve.deadline();
            valve.poll(due);
            // A fault that activates while the spool passes through neutral clears at once.
            if let Some(fault) = valve.take_changes().activated.highest() {
                assert_eq!(activated.map(|(fault, micros)| (fault, at(micros))), Some((fault, due)), "seed {seed}");
                return Some((fault, event));
            }
        }
        if let Some((fault, micros)) = activated {
            // A fault due at the time of the next event activates with that event.
            valve.poll(at(next));
            let changes = valve.take_changes();
            assert!(micros == next && changes.activated.contains(fault), "seed {seed}: {fault:?} at {micros}");
            return Some((fault, event));
        }
        match numbers.next(16) {
            0 => model.change(|model| model.lever = (numbers.next(3) == 0).then_some(STROKE / 2)),
            1 => model.change(|model| model.slow = numbers.next(3) == 0),
            2 => {
                let drives = [Drive::Off, Drive::Hand, Drive::EmergencyStop, BLOCKED, FLOAT];
                let drive = drives[numbers.next(5) as usize];
                model.change(|model| model.drive = drive);
                valve.drive(drive, at(next));
            }
            3 => valve.command(model.drive, at(next)),
            _ => {
                let drive = set_point(&mut numbers);
                model.change(|model| model.drive = drive);
                valve.command(drive, at(next));
            }
        }
        inputs.spool.fault = if model.slow { SpoolFault::Slow } else { SpoolFault::None };
        inputs.spool.lever = model.lever.map(|place| Position::clamped((place / UNIT) as i32));
        valve.sense(&inputs, at(next));
        assert_eq!(i64::from(valve.position(at(next)).raw()), model.place(next) / UNIT, "seed {seed}");
        assert!(!valve.has_changes(), "seed {seed}");
    }
    None
}

#[test]
fn the_spools_faults_come_in_the_microsecond_of_the_model() {
    for config in [CANOPEN, ISOBUS] {
        let ends: [_; 1000] = core::array::from_fn(|seed| run(seed as u64 + 1, config));
        let count = |fault| ends.iter().flatten().filter(|(found, _)| *found == fault).count();
        let late = ends.iter().flatten().filter(|(_, event)| *event > 20).count();
        let seen = (count(Fault::SpoolNotAtSetPoint), count(Fault::FloatNotReached), late);
        assert!(seen.0 > 500 && seen.1 > 0 && seen.2 > 100, "{seen:?}");
    }
}
