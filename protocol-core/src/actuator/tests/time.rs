//! The time and frequency of polling have no effect on the valve.

extern crate std;

use std::vec::Vec;

use super::*;
use crate::time::{NEVER, after};

/// A pseudo-random sequence that is the same in every run (xorshift).
pub(super) struct Numbers(u64);

impl Numbers {
    pub(super) const fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(super) fn next(&mut self, below: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % below
    }

    pub(super) fn position(&mut self) -> i16 {
        i16::try_from(self.next(32769)).map_or(Position::FULL, |raw| raw - Position::FULL)
    }
}

/// The polling of the valve between two events.
#[derive(Clone, Copy, Debug)]
enum Polling {
    /// At every deadline.
    Deadlines,
    /// At this interval in microseconds.
    Every(u64),
    /// Not at all.
    Never,
}

/// The observed positions and fault changes of a valve.
#[derive(Debug, Default, PartialEq)]
struct Story {
    positions: Vec<(i16, bool)>,
    changes: Vec<(Instant, Changes)>,
}

/// A function that applies a set-point.
type Order = fn(&mut Valve, Drive, Instant);

/// Calls the guard and the drive separately; together they are equivalent to a command.
fn one_by_one(valve: &mut Valve, drive: Drive, now: Instant) {
    valve.feed_guard(now);
    valve.drive(drive, now);
}

/// Applies a random event to the valve.
fn happen(valve: &mut Valve, inputs: &mut ValveInputs, numbers: &mut Numbers, order: Order, now: Instant) {
    match numbers.next(12) {
        0 => valve.drive(Drive::Off, now),
        1 => valve.drive(Drive::Hand, now),
        2 => order(valve, BLOCKED, now),
        3 => order(valve, FLOAT, now),
        4..=6 => order(valve, to(numbers.position()), now),
        7 => inputs.spool.lever = (numbers.next(3) == 0).then(|| Position::new(numbers.position()).unwrap()),
        8 => {
            use SpoolFault::{Drifting, NoFloat, None, Slow, Stuck};
            inputs.spool.fault = [None, None, Stuck, Slow, Drifting, NoFloat][numbers.next(6) as usize];
        }
        9 => inputs.supply_mv = [8_000, 10_000, 24_000, 24_000, 34_000, 37_000][numbers.next(6) as usize],
        10 => inputs.temperature_c = [-50, -38, 20, 20, 118, 130][numbers.next(6) as usize],
        _ if numbers.next(2) == 0 => valve.start_guard(now),
        _ => valve.feed_guard(now),
    }
    valve.sense(inputs, now);
}

/// Applies the same events, at whole milliseconds, to a valve with the given polling.
fn run(seed: u64, config: ValveConfig, polling: Polling, order: Order) -> Story {
    let (mut numbers, mut story) = (Numbers::new(seed), Story::default());
    let (mut valve, mut inputs) = (Valve::new(config, Counters::default(), ms(0)), ValveInputs::default());
    let mut now = ms(0);
    for _ in 0..60 {
        let next = after(now, Duration::from_millis(1 + numbers.next(900)));
        let mut note = |valve: &mut Valve, at| match valve.take_changes() {
            changes if changes.is_empty() => {}
            changes => story.changes.push((at, changes)),
        };
        loop {
            let at = match polling {
                Polling::Deadlines => valve.deadline(),
                Polling::Every(micros) => after(now, Duration::from_micros(micros)),
                Polling::Never => NEVER,
            };
            if at > next {
                break;
            }
            assert!(at > now, "a deadline that has passed");
            now = at;
            valve.poll(now);
            note(&mut valve, now);
        }
        now = next;
        if !matches!(polling, Polling::Never) {
            valve.poll(now);
            note(&mut valve, now);
        }
        happen(&mut valve, &mut inputs, &mut numbers, order, now);
        note(&mut valve, now);
        story.positions.push((valve.position(now).raw(), valve.solenoids()));
    }
    story
}

#[test]
fn polling_at_deadlines_alone_finds_every_fault_when_polling_all_the_time_does() {
    for seed in 1..=150 {
        for config in [CANOPEN, ISOBUS] {
            let exact = run(seed, config, Polling::Deadlines, Valve::command);
            let often = run(seed, config, Polling::Every(1000), Valve::command);
            assert!(!exact.changes.is_empty());
            assert_eq!(exact.positions, often.positions, "seed {seed}");
            let whole = |at: Instant| Instant::from_millis(at.as_micros().div_ceil(1000));
            let rounded = exact.changes.iter().map(|&(at, changes)| (whole(at), changes));
            assert!(rounded.eq(often.changes.iter().copied()), "seed {seed}\n{exact:#?}\n{often:#?}");
        }
    }
}

#[test]
fn positions_do_not_depend_on_polls() {
    for seed in 1..=150 {
        let polled = run(seed, CANOPEN, Polling::Deadlines, Valve::command);
        for polling in [Polling::Every(777), Polling::Every(123_456), Polling::Never] {
            assert_eq!(
                run(seed, CANOPEN, polling, Valve::command).positions,
                polled.positions,
                "seed {seed}, {polling:?}"
            );
        }
    }
}

#[test]
fn a_command_is_the_guard_and_the_drive_in_one() {
    for seed in 1..=300 {
        for config in [CANOPEN, ISOBUS] {
            for polling in [Polling::Deadlines, Polling::Never] {
                let [one, other] = [Valve::command, one_by_one].map(|order| run(seed, config, polling, order));
                assert_eq!(one, other, "seed {seed}, {polling:?}");
            }
        }
    }
}

#[test]
fn a_deadline_is_always_ahead_and_nothing_happens_before_it() {
    let (mut numbers, mut inputs) = (Numbers::new(99), ValveInputs::default());
    let mut valve = Valve::new(ISOBUS, Counters::default(), ms(0));
    let mut now = ms(0);
    for _ in 0..20_000 {
        assert!(valve.deadline() > now);
        let deadline = valve.deadline();
        let before = (valve.faults(), valve.power_save(), valve.solenoids());
        let next = after(now, Duration::from_micros(numbers.next(300_000)));
        valve.poll(next.min(deadline - MICROSECOND));
        assert_eq!((valve.faults(), valve.power_save(), valve.solenoids()), before);
        assert_eq!(valve.deadline(), deadline);
        now = next;
        happen(&mut valve, &mut inputs, &mut numbers, Valve::command, now);
        valve.take_changes();
    }
}

#[test]
fn time_that_runs_backwards_counts_as_the_last_instant() {
    let mut rig = Rig::new(CANOPEN);
    rig.valve.poll(ms(1000));
    rig.drive(0, to(16384));
    assert_eq!([0, 1000, 1125].map(|at| rig.position(at)), [0, 0, 8192]);
    rig.valve.poll(ms(1125));
    assert_eq!(rig.position(1050), 8192);
    rig.valve.start_guard(ms(5));
    rig.valve.poll(ms(700));
    assert_eq!(rig.valve.faults(), FaultSet::EMPTY);
    rig.expect_activation(Fault::TimeGuarding, 1375);
}

#[test]
fn the_end_of_time_is_survived() {
    let mut rig = Rig::new(CANOPEN);
    rig.spool(0, SpoolFault::Stuck);
    rig.drive(0, to(16384));
    rig.valve.start_guard(ms(0));
    rig.valve.poll(NEVER);
    assert!(rig.valve.is_active(Fault::TimeGuarding));
    rig.drive(0, FLOAT);
    rig.sense(0, |inputs| inputs.supply_mv = u32::MAX);
    rig.valve.poll(NEVER);
    assert_eq!(rig.position(0), 0);
}

/// A set-point that arrives exactly when the guard time expires is too late, whether or not the valve was polled.
#[test]
fn what_is_due_at_the_instant_of_a_set_point_happens_before_it() {
    for polled in [true, false] {
        let mut rig = Rig::new(CANOPEN);
        rig.drive(0, to(8192));
        rig.valve.start_guard(ms(0));
        rig.valve.poll(ms(240));
        if polled {
            rig.valve.poll(ms(250));
        }
        rig.valve.command(to(4096), ms(250));
        assert!(rig.valve.take_changes().activated.contains(Fault::TimeGuarding), "polled: {polled}");
    }
}
