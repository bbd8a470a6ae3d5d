//! The device state machine (SPEC 4.3): every event in every state, against the tables of that section.

use proptest::prelude::*;
use tests::Rig;

use super::{SAVE, SAVED};

const INIT: u32 = 0x08;
const DISABLED: u32 = 0x09;
const HOLD: u32 = 0x0B;
const ACTIVE: u32 = 0x0F;
const FAULT_HOLD: u32 = 0x03;

const STATES: [u32; 5] = [INIT, DISABLED, HOLD, ACTIVE, FAULT_HOLD];

/// The transitions that a control word takes, by its bits R M H D. D11 takes two words and has a test of its own.
const TRANSITIONS: [(&str, u32, &str, u32); 6] = [
    ("D2", INIT, "xxx1", DISABLED),
    ("D3", DISABLED, "xx11", HOLD),
    ("D4", HOLD, "x111", ACTIVE),
    ("D5", ACTIVE, "x0xx", HOLD),
    ("D6", HOLD, "x00x", DISABLED),
    ("D7", DISABLED, "x000", INIT),
];

type Event = fn(&mut Rig);

/// What the other events do: the state after each, from INIT, DISABLED, HOLD, ACTIVE, FAULT_HOLD.
const EVENTS: [(&str, Event, [u32; 5]); 10] = [
    ("a fault", |valve| valve.sense(|inputs| inputs.internal_fault = true), [FAULT_HOLD; 5]),
    ("reset application", |valve| valve.send("000: 81 00"), [INIT; 5]),
    ("reset communication", |valve| valve.send("000: 82 20"), [FAULT_HOLD; 5]),
    ("stop", |valve| valve.send("000: 02 00"), [FAULT_HOLD; 5]),
    ("start", |valve| valve.send("000: 01 00"), STATES),
    ("pre-operational", |valve| valve.send("000: 80 00"), STATES),
    ("hand operation", |valve| valve.write(0x6042, 0, 1, 2).unwrap(), STATES),
    ("full operational", |valve| valve.write(0x6042, 0, 1, 1).unwrap(), STATES),
    ("an emergency stop", |valve| valve.send("0A1: 00 10 01 00 00 00 00 00"), EMERGENCY_STOP),
    ("another emergency", |valve| valve.send("0A1: 01 10 01 00 00 00 00 00"), STATES),
];

const EMERGENCY_STOP: [u32; 5] = [INIT, DISABLED, HOLD, FAULT_HOLD, FAULT_HOLD];

/// A valve in this state, in NMT pre-operational or operational, brought there by SDO.
fn valve_in(state: u32, operational: bool, mode: u32) -> Rig {
    let mut valve = Rig::booted();
    valve.write_all(&[(0x1028, 1, 4, 0xA1), (0x6042, 0, 1, mode)]);
    if operational {
        valve.send("000: 01 00");
    }
    let words: &[u32] = match state {
        INIT => &[],
        DISABLED => &[0x1],
        HOLD => &[0x1, 0x3],
        _ => &[0x1, 0x3, 0x7],
    };
    for word in words {
        valve.write(0x6040, 0, 2, *word).unwrap();
    }
    if state == FAULT_HOLD {
        valve.send("0A1: 00 10 01 00 00 00 00 00");
    }
    assert_eq!(valve.status(), state, "the way to {state:#04X}");
    valve.expect_nothing();
    valve
}

/// The state now. A stopped node does not answer: it is started, which changes nothing.
fn state_after(valve: &mut Rig) -> u32 {
    valve.send("000: 01 00");
    valve.take();
    valve.status()
}

fn matches(pattern: &str, word: u32) -> bool {
    pattern.bytes().zip([8, 4, 2, 1]).all(|(wanted, bit)| match wanted {
        b'x' => true,
        b'1' => word & bit != 0,
        _ => word & bit == 0,
    })
}

fn next(state: u32, word: u32) -> u32 {
    let mut taken = TRANSITIONS.iter().filter(|(_, from, pattern, _)| *from == state && matches(pattern, word));
    let next = taken.next().map_or(state, |(.., to)| *to);
    assert!(taken.next().is_none(), "the table is ambiguous");
    next
}

#[test]
fn every_control_word_in_every_state_over_sdo_and_by_rpdo() {
    for state in STATES {
        for word in 0..=0xF {
            for upper in [0x0000, 0xFFF0, 0x5A50] {
                for mode in [1, 2] {
                    let what = format!("{:04X} in {state:#04X}, mode {mode}", word | upper);
                    let mut valve = valve_in(state, false, mode);
                    valve.write(0x6040, 0, 2, word | upper).unwrap();
                    assert_eq!(valve.status(), next(state, word), "{what}, SDO");
                    assert_eq!(valve.read(0x6040, 0), word | upper, "{what}");

                    let mut valve = valve_in(state, true, mode);
                    valve.send(&format!("220: {:02X} {:02X} 00 00", word | upper & 0xFF, upper >> 8));
                    valve.expect(&format!("1A0: {:02X} 00 00 00", next(state, word)));
                    assert_eq!(valve.status(), next(state, word), "{what}, RPDO");
                    assert_eq!(valve.read(0x6040, 0), word | upper, "{what}");
                }
            }
        }
    }
}

#[test]
fn every_other_event_in_every_state() {
    for (name, event, after) in EVENTS {
        for (state, expected) in STATES.into_iter().zip(after) {
            for operational in [false, true] {
                for mode in [1, 2] {
                    let mut valve = valve_in(state, operational, mode);
                    event(&mut valve);
                    let after = state_after(&mut valve);
                    assert_eq!(after, expected, "{name} in {state:#04X}, operational: {operational}, mode {mode}");
                }
            }
        }
    }
}

/// Control words in FAULT_HOLD, `!` and `.` a fault that comes and goes between them; the state at the end.
const WAYS_OUT: [(&str, u32); 18] = [
    ("3 B", HOLD),
    ("3", FAULT_HOLD),
    ("B", FAULT_HOLD),
    ("B 3", FAULT_HOLD),
    ("B 3 B", HOLD),
    ("3 3 B", HOLD),
    ("3 F B", FAULT_HOLD),
    ("3 0 B", FAULT_HOLD),
    ("3 B B", HOLD),
    ("7 B", FAULT_HOLD),
    ("3 F", FAULT_HOLD),
    ("3 B F", ACTIVE),
    // a 0011 counts even if a fault was active then
    ("! 3 . B", HOLD),
    // a fault enters FAULT_HOLD anew
    ("3 ! . B", FAULT_HOLD),
    // a 1011 while one is active is lost: 0011 must come again
    ("! 3 B . B", FAULT_HOLD),
    ("! 3 B . 3 B", HOLD),
    ("3 ! B . B", FAULT_HOLD),
    ("! . 3 B", HOLD),
];

#[test]
fn the_way_out_of_fault_hold() {
    for (way, expected) in WAYS_OUT {
        for by_rpdo in [false, true] {
            let mut valve = valve_in(FAULT_HOLD, true, 1);
            for step in way.split(' ') {
                match step {
                    "!" => valve.sense(|inputs| inputs.internal_fault = true),
                    "." => valve.sense(|inputs| inputs.internal_fault = false),
                    word if by_rpdo => valve.send(&format!("220: 0{word} 00 00 00")),
                    word => valve.send(&format!("620: 2B 40 60 00 0{word} 00 00 00")),
                }
            }
            valve.take();
            assert_eq!(valve.status(), expected, "{way}, by RPDO: {by_rpdo}");
        }
    }
}

#[test]
fn the_upper_bits_do_not_matter_on_the_way_out() {
    let mut valve = valve_in(FAULT_HOLD, true, 1);
    valve.exchange("220: F3 FF 00 00", &["1A0: 03 00 00 00"]);
    valve.exchange("220: 5B 12 00 00", &["1A0: 0B 00 00 00"]);
}

#[test]
fn an_sdo_and_an_rpdo_go_the_way_out_together() {
    let mut valve = valve_in(FAULT_HOLD, true, 1);
    valve.write(0x6040, 0, 2, 0x03).unwrap();
    valve.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
}

/// Only an RPDO that has a control word brings one: a set-point alone does not come between 0011 and 1011.
#[test]
fn a_set_point_over_sdo_does_not_come_between_the_two_words() {
    let mut valve = valve_in(FAULT_HOLD, true, 1);
    valve.write_all(&[(0x6040, 0, 2, 0x03), (0x6300, 1, 2, 0x1000), (0x6040, 0, 2, 0x0B)]);
    assert_eq!(valve.status(), HOLD);
}

/// Use case 2: back in ACTIVE with the cyclic control word.
#[test]
fn the_cyclic_control_word_leads_back_to_active() {
    let mut valve = Rig::active();
    valve.sense(|inputs| inputs.internal_fault = true);
    valve.take();
    valve.exchange("220: 0F 00 00 10", &["1A0: 03 00 00 00"]);
    valve.sense(|inputs| inputs.internal_fault = false);
    valve.take();
    valve.exchange("220: 03 00 00 00", &["1A0: 03 00 00 00"]);
    valve.exchange("220: 0B 00 00 00", &["1A0: 0B 00 00 00"]);
    valve.exchange("220: 0F 00 00 40", &["1A0: 0F 00 00 00"]);
    valve.advance(125);
    valve.exchange("220: 0F 00 00 40", &["1A0: 0F 00 00 20"]);
}

/// What a state does, SPEC 4.3: set-points act and the spool is controlled, it is monitored, time is guarded.
#[test]
fn what_acts_in_which_state() {
    let table = [(INIT, 1, false), (DISABLED, 1, false), (HOLD, 1, false), (ACTIVE, 1, true), (ACTIVE, 2, false)];
    for (state, mode, acts) in table.into_iter().chain([(FAULT_HOLD, 1, false), (FAULT_HOLD, 2, false)]) {
        let what = format!("state {state:#04X}, mode {mode}");
        let keep = match state {
            INIT => "00",
            DISABLED => "01",
            HOLD => "03",
            _ => "07",
        };
        let rpdo = format!("220: {keep} 00 00 20");

        let mut valve = valve_in(state, true, mode);
        valve.send(&rpdo);
        assert_eq!(valve.take(), [format!("1A0: {state:02X} 00 00 00")], "{what}: a TPDO in every state");
        assert_eq!(valve.read(0x6300, 1), 0x2000, "{what}: a set-point reads back in any state");
        valve.advance(100);
        assert_eq!(valve.read(0x6301, 1) != 0, acts, "{what}: spool control");
        assert_eq!(valve.outputs().solenoids, acts, "{what}: solenoids");

        let mut valve = valve_in(state, true, mode);
        valve.advance(1000);
        let guarded = ["0A0: 03 80 91 01 00 00 00 00"];
        assert_eq!(valve.take(), if acts { &guarded[..] } else { &[] }, "{what}: time guarding");

        let mut valve = valve_in(state, true, mode);
        valve.sense(|inputs| inputs.spool.lever = protocol_core::actuator::Position::new(8192));
        valve.advance_cyclic(1200, &format!("220: {keep} 00 00 00"));
        let emcys = valve.take_under("0A0");
        let away = ["0A0: 05 83 21 01 00 00 00 00"];
        assert_eq!(emcys, if acts { &away[..] } else { &[] }, "{what}: spool monitoring");
        if !acts {
            assert_eq!(valve.read(0x6301, 1), 8192, "{what}: the actual value follows a lever");
        }
    }
}

#[test]
fn on_entering_active_the_set_point_is_neutral_until_the_next() {
    let mut valve = valve_in(HOLD, true, 1);
    valve.write_all(&[(0x6300, 1, 2, 0x4000), (0x6040, 0, 2, 0x07)]);
    valve.advance(200);
    assert_eq!((valve.read(0x6301, 1), valve.read(0x6300, 1)), (0, 0x4000));
    valve.write(0x3300, 0, 1, 127).unwrap();
    valve.advance(125);
    assert_eq!(valve.read(0x6301, 1), 8192, "half of the 250 ms of a full stroke");

    // the set-point of the RPDO that leads there acts
    let mut valve = valve_in(HOLD, true, 1);
    valve.exchange("220: 07 00 00 40", &["1A0: 0F 00 00 00"]);
    valve.advance(125);
    assert_eq!(valve.read(0x6301, 1), 8192);
}

#[test]
fn a_change_of_mode_begins_with_a_neutral_set_point_too() {
    let mut valve = valve_in(ACTIVE, true, 1);
    valve.write(0x6300, 1, 2, 0x4000).unwrap();
    valve.advance(100);
    valve.write(0x6042, 0, 1, 2).unwrap();
    assert!(!valve.outputs().solenoids, "hand operation takes the solenoids away at once");
    valve.advance(150);
    assert_eq!(valve.read(0x6301, 1), 0, "sprung to neutral");
    valve.write(0x6042, 0, 1, 1).unwrap();
    valve.advance(200);
    assert_eq!((valve.status(), valve.read(0x6301, 1), valve.read(0x6300, 1)), (ACTIVE, 0, 0x4000));
    valve.write(0x6300, 1, 2, 0x4000).unwrap();
    valve.advance(125);
    assert_eq!(valve.read(0x6301, 1), 8192);
}

/// A mode that changes restarts the time guard (8) and the monitors of the spool (1, 2).
#[test]
fn a_change_of_mode_restarts_the_monitors() {
    let mut valve = valve_in(ACTIVE, true, 1);
    valve.advance(200);
    valve.write_all(&[(0x6042, 0, 1, 2), (0x6042, 0, 1, 1)]);
    valve.silent_until(250, &["0A0: 03 80 91 01 00 00 00 00"]);

    let mut valve = valve_in(ACTIVE, true, 1);
    valve.sense(|inputs| inputs.spool.lever = protocol_core::actuator::Position::new(8192));
    let feed = |valve: &mut Rig, ms| {
        valve.advance_cyclic(ms, "220: 0F 00 00 00");
        valve.take_under("0A0")
    };
    assert!(feed(&mut valve, 400).is_empty());
    valve.write_all(&[(0x6042, 0, 1, 2), (0x6042, 0, 1, 1)]);
    assert!(feed(&mut valve, 499).is_empty());
    assert_eq!(feed(&mut valve, 1), ["0A0: 05 83 21 01 00 00 00 00"]);
}

/// A controller that maps the mode into its RPDO sends it with every set-point: that is no change.
#[test]
fn the_mode_in_force_written_again_restarts_nothing() {
    let mut valve = valve_in(ACTIVE, true, 1);
    valve.write(0x6300, 1, 2, 0x2000).unwrap();
    valve.advance(200);
    valve.write(0x6042, 0, 1, 1).unwrap();
    valve.silent_until(50, &["0A0: 03 80 91 01 00 00 00 00"]);
    assert_eq!(valve.read(0x6301, 1), 0x2000);
}

#[test]
fn other_modes_are_refused_and_change_nothing() {
    for mode in [0, 3, 0x7F, 0x80, 0xFF] {
        let mut valve = valve_in(ACTIVE, true, 1);
        assert_eq!(valve.write(0x6042, 0, 1, mode), Err(0x0609_0030), "mode {mode}");
        assert_eq!((valve.read(0x6042, 0), valve.status()), (1, ACTIVE));
    }
}

/// One event of a walk.
#[derive(Clone, Copy, Debug)]
enum Step {
    Word { command: u32, by_rpdo: bool },
    Fault(bool),
    Order(u8),
    EmergencyStop,
}

fn step() -> impl Strategy<Value = Step> {
    // the commands that lead somewhere more often than the others
    let command = prop_oneof![0..16_u32, Just(0x1), Just(0x3), Just(0x7), Just(0xB), Just(0xF)];
    prop_oneof![
        10 => (command, any::<bool>()).prop_map(|(command, by_rpdo)| Step::Word { command, by_rpdo }),
        2 => any::<bool>().prop_map(Step::Fault),
        2 => prop::sample::select(vec![0x01, 0x02, 0x80, 0x81, 0x82]).prop_map(Step::Order),
        1 => Just(Step::EmergencyStop),
    ]
}

/// The tables above as a machine, with the NMT states as far as they decide what is served.
struct Model {
    state: u32,
    /// The last control word was 0011.
    reset_begun: bool,
    fault: bool,
    nmt: u8,
}

impl Model {
    fn take(&mut self, step: Step) {
        match step {
            Step::Word { by_rpdo: true, .. } if self.nmt != 0x01 => {}
            Step::Word { by_rpdo: false, .. } | Step::EmergencyStop if self.nmt == 0x02 => {}
            Step::Word { command, .. } => {
                let out = self.state == FAULT_HOLD && self.reset_begun && command == 0xB && !self.fault;
                self.reset_begun = self.state == FAULT_HOLD && command == 0x3;
                self.state = if out { HOLD } else { next(self.state, command) };
            }
            Step::Fault(active) => {
                if active && !self.fault {
                    self.shut_down();
                }
                self.fault = active;
            }
            Step::Order(0x81) => {
                *self = Self { state: INIT, reset_begun: false, fault: false, nmt: 0x80 };
            }
            Step::Order(0x82) => {
                self.shut_down();
                self.nmt = 0x80;
            }
            Step::Order(order) => {
                if order == 0x02 && self.nmt != 0x02 {
                    self.shut_down();
                }
                self.nmt = order;
            }
            Step::EmergencyStop if self.state == ACTIVE => self.shut_down(),
            Step::EmergencyStop => {}
        }
    }

    /// FAULT_HOLD is entered anew.
    fn shut_down(&mut self) {
        self.reset_begun = false;
        self.state = FAULT_HOLD;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_walk_through_the_states(steps in prop::collection::vec(step(), 1..60)) {
        let mut valve = Rig::booted();
        valve.write(0x1028, 1, 4, 0xA1).unwrap();
        valve.exchange(SAVE, &[SAVED]);
        let mut model = Model { state: INIT, reset_begun: false, fault: false, nmt: 0x80 };
        for step in steps {
            model.take(step);
            match step {
                Step::Word { command, by_rpdo: true } => valve.send(&format!("220: {command:02X} 00 00 00")),
                Step::Word { command, by_rpdo: false } => {
                    valve.send(&format!("620: 2B 40 60 00 {command:02X} 00 00 00"));
                }
                Step::Fault(active) => valve.sense(|inputs| inputs.internal_fault = active),
                Step::Order(0x81) => {
                    valve.sense(|inputs| inputs.internal_fault = false);
                    valve.send("000: 81 00");
                }
                Step::Order(order) => valve.send(&format!("000: {order:02X} 20")),
                Step::EmergencyStop => valve.send("0A1: 00 10 01 00 00 00 00 00"),
            }
            valve.take();
            if model.nmt != 0x02 {
                prop_assert_eq!(valve.status(), model.state);
                prop_assert_eq!(valve.read(0x1001, 0), u32::from(model.fault));
            }
        }
    }
}
