//! Under any combination of communication faults, a valve keeps to its specification: only transitions of the table, a
//! time guard that trips, nothing stored is lost.

use hal_sim::bus::{EventKind, Fault, FaultEffect, FaultKind};
use hal_sim::{ClientPortId, NodeId, World};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BitRate;
use protocol_core::device::pve::{self, DeviceState};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};
use tests::frame;

use super::clone::fault;

/// The time guard of ACTIVE (SPEC 3), and the longest time to the next step of the simulation.
const GUARD: Duration = Duration::from_millis(250);
const SLACK: Duration = Duration::from_millis(10);

/// A valve, its master, and a client that receives only.
struct Rig {
    world: World,
    valve: NodeId,
    master: ClientPortId,
    state: Option<DeviceState>,
    /// The end of the last frame that the valve can have received.
    received: Instant,
    /// A communication fault keeps the next frame from the valve.
    is_lost: bool,
}

impl Rig {
    fn new() -> Self {
        let mut world = World::new(BitRate::Kbit250, 1);
        world.record_events(true);
        let valve = world.add("device-0", pve::Kind::PveaCanopen);
        let master = world.add_client_port("client");
        world.add_client_port("tap");
        world.power(valve, true);
        let received = world.now();
        let mut rig = Self { world, valve, master, state: None, received, is_lost: false };
        rig.run_for(100);
        rig
    }

    fn send(&mut self, text: &str) {
        self.world.send(self.master, frame(text));
    }

    /// Lets time pass, and checks the transitions and the time guard at every event.
    fn run_for(&mut self, ms: u64) -> Vec<(String, Frame)> {
        let end = after(self.world.now(), Duration::from_millis(ms));
        let mut frames = Vec::new();
        while self.world.now() < end {
            let next = self.world.next_event().min(end).min(after(self.world.now(), SLACK));
            self.world.run_until(next);
            frames.extend(self.look());
        }
        frames
    }

    fn look(&mut self) -> Vec<(String, Frame)> {
        let mut frames = Vec::new();
        for event in self.world.take_events().collect::<Vec<_>>() {
            match &event.what {
                EventKind::Fault { effect: FaultEffect::Lost(receivers), .. } => {
                    self.is_lost |= receivers.is_empty() || receivers.iter().any(|name| **name == *"device-0");
                }
                // A frame may have been accepted although an error frame follows.
                EventKind::Frame { frame, .. } | EventKind::ErrorFrame { frame, .. } => {
                    let is_received = !std::mem::take(&mut self.is_lost) && *event.who != *"device-0";
                    if is_received {
                        self.received = event.at;
                    }
                    if event.frame().is_some() {
                        frames.push((event.who.to_string(), *frame));
                    }
                }
                _ => {}
            }
        }
        let state = self.world.view(self.valve).and_then(|view| view.valve?.dsm);
        if let (Some(before), Some(now)) = (self.state, state) {
            assert!(is_transition(before, now), "{before:?} -> {now:?} at {:?}", self.world.now());
        }
        self.state = state;
        if state == Some(DeviceState::Active) {
            let silence = since(self.world.now(), self.received);
            assert!(silence <= GUARD + SLACK, "ACTIVE after {} ms without a frame", silence.as_millis());
        }
        frames
    }
}

/// The transitions D2 to D8 and D11, and resets (SPEC 4.3).
fn is_transition(from: DeviceState, to: DeviceState) -> bool {
    use DeviceState::{Active, Disabled, FaultHold, Hold, Init};
    from == to
        || matches!(to, Init | FaultHold)
        || matches!((from, to), (Init | Hold, Disabled) | (Disabled | Active | FaultHold, Hold) | (Hold, Active))
}

/// What the master sends, in the order of its work.
#[derive(Clone, Copy, Debug)]
enum Act {
    Send(&'static str),
    /// Set-points in a cycle of 50 ms.
    SetPoints(u64),
    Pause(u64),
}

fn act() -> impl Strategy<Value = Act> {
    let frames = [
        "000: 01 20",
        "000: 80 20",
        "000: 02 20",
        "080:",
        "220: 0B 00 00 00",
        "220: 00 00 00 00",
        "620: 40 00 60 00 00 00 00 00",
        "620: 2B 40 60 00 07 00 00 00",
        "620: 23 10 10 01 73 61 76 65",
    ];
    prop_oneof![
        3 => select(frames.to_vec()).prop_map(Act::Send),
        4 => (1..20_u64).prop_map(Act::SetPoints),
        2 => (1..700_u64).prop_map(Act::Pause),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn transitions_and_the_time_guard(faults in vec(fault(), 1..8), acts in vec(act(), 1..30)) {
        let mut rig = Rig::new();
        rig.send("000: 01 20");
        let mut faults = faults.into_iter();
        for act in acts {
            // Faults of unknown receivers, or with a taken name, are refused.
            let _ = faults.next().map(|fault| rig.world.fault(fault));
            match act {
                Act::Send(text) => rig.send(text),
                Act::SetPoints(count) => {
                    for _ in 0..count {
                        rig.send("220: 0F 00 00 20");
                        rig.run_for(50);
                    }
                }
                Act::Pause(ms) => {
                    rig.run_for(ms);
                }
            }
            rig.run_for(5);
        }
        // Without faults, silence takes the valve out of ACTIVE.
        rig.world.end_faults();
        rig.run_for(2000);
        prop_assert_ne!(rig.state, Some(DeviceState::Active));
    }

    /// What the valve has acknowledged before its power is cut is there afterwards. A fault that changes or adds frames
    /// can store something else, and is left out.
    #[test]
    fn what_was_stored(faults in vec(fault(), 1..6), cut in 0..40_u64, pause in 0..200_u64) {
        let mut rig = Rig::new();
        let keeps = |fault: &Fault| !matches!(fault.kind, FaultKind::Corrupt(_) | FaultKind::Insert { .. });
        for fault in faults.into_iter().filter(keeps) {
            let _ = rig.world.fault(fault);
        }
        let mut has_stored = false;
        for _ in 0..10 {
            rig.send("620: 2B 17 10 00 F4 01 00 00");
            let written = rig.run_for(100 + pause).contains(&("device-0".to_owned(), frame("5A0: 60 17 10 00 00 00 00 00")));
            rig.send("620: 23 10 10 01 73 61 76 65");
            let answers = rig.run_for(cut + pause);
            has_stored = written && answers.contains(&("device-0".to_owned(), frame("5A0: 60 10 10 01 00 00 00 00")));
            if has_stored {
                break;
            }
        }
        rig.world.power(rig.valve, false);
        rig.world.end_faults();
        rig.run_for(500);
        rig.state = None;
        rig.world.power(rig.valve, true);
        let frames = rig.run_for(2000);
        let heartbeats = frames.iter().filter(|(_, sent)| *sent == frame("720: 7F")).count();
        prop_assert!(!has_stored || (3..=4).contains(&heartbeats), "{} heartbeats", heartbeats);
    }
}

/// Faults that never happen change nothing.
#[test]
fn faults_of_probability_0_change_nothing() {
    let run = |faults: Vec<Fault>| {
        let mut rig = Rig::new();
        for fault in faults {
            rig.world.fault(fault).expect("a fault");
        }
        rig.send("000: 01 20");
        let mut frames = Vec::new();
        for _ in 0..40 {
            rig.send("220: 0F 00 00 20");
            rig.send("620: 40 18 10 01 00 00 00 00");
            frames.extend(rig.run_for(50));
        }
        (frames, rig.world.now(), rig.world.view(rig.valve).map(|view| view.position))
    };
    let kinds = [
        FaultKind::Lose { receivers: Vec::new() },
        FaultKind::Delay { delay: hal_sim::bus::Delay::Constant(Duration::from_millis(30)), overtake: true },
        FaultKind::Repeat { times: 3, after: Duration::from_millis(1) },
        FaultKind::Swap { within: Duration::from_millis(100) },
        FaultKind::Insert { frame: frame("220: 0B 00 00 00"), every: Some(Duration::from_millis(7)) },
        FaultKind::Destroy,
        FaultKind::Omit { receivers: vec!["device-0".into()] },
    ];
    let names = ["a", "b", "c", "d", "e", "f", "g"];
    let faults = names.into_iter().zip(kinds).map(|(name, kind)| Fault { probability: 0, ..Fault::new(name, kind) });
    assert_eq!(run(faults.collect()), run(Vec::new()));
}
