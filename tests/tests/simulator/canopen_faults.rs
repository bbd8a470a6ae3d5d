//! The eight errors of communication on CANopen: what sender, named receiver and third party see, to the microsecond.

use hal_sim::bus::{Corruption, Delay, Fault, FaultKind, FrameBits, FrameFilter, INTERMISSION, Masks};
use hal_sim::{BitRate, ClientPortId, NodeId, World};
use protocol_core::device::pve::{DeviceState, Kind, Setup};
use protocol_core::frame::{Frame, standard};
use protocol_core::time::{Duration, after, since};
use tests::frame;

/// ACTIVE at 25 %, and HOLD.
const ACTIVE: &str = "220: 0F 00 00 10";
const HOLD: &str = "220: 0B 00 00 00";
/// What the valve answers to them while its spool is at 25 %.
const IS_ACTIVE: &str = "1A0: 0F 00 00 10";
const IS_HOLD: &str = "1A0: 0B 00 00 10";
/// EMCY of time guarding.
const TIME_GUARDING: &str = "0A0: 03 80 91 01 00 00 00 00";

/// Two valves, their master, and a display that only listens.
#[derive(Clone)]
struct Bus {
    world: World,
    master: ClientPortId,
    display: ClientPortId,
    valves: [NodeId; 2],
}

impl Bus {
    /// A bus on which the first valve is ACTIVE at 25 %, and the second one OPERATIONAL in INIT. The last RPDO began
    /// 50 ms ago.
    fn active() -> Self {
        let mut world = World::new(BitRate::Kbit250, 1);
        let [master, display] = ["master", "display"].map(|name| world.add_client_port(name));
        let valves = [("boom", 0x20, 1), ("arm", 0x21, 2)].map(|(name, node_id, serial)| {
            let setup = Setup { node_id: Some(node_id), serial: Some(serial), ..Setup::new(Kind::PveaCanopen) };
            world.add(name, setup)
        });
        valves.into_iter().for_each(|valve| world.power(valve, true));
        let mut bus = Self { world, master, display, valves };
        bus.run_for(millis(100));
        bus.send("000: 01 00");
        bus.run_for(millis(10));
        for _ in 0..6 {
            bus.send(ACTIVE);
            bus.run_for(millis(50));
        }
        bus.world.take_received(bus.display);
        bus
    }

    fn add(&mut self, fault: Fault) {
        self.world.fault(fault).expect("a fault");
    }

    fn send(&mut self, text: &str) {
        self.world.send(self.master, frame(text));
    }

    fn run_for(&mut self, time: Duration) {
        let end = after(self.world.now(), time);
        self.world.run_until(end);
    }

    /// Sends an RPDO now; returns the times and the frames that the display receives within so many milliseconds. The
    /// master has sent all by then, and its controller has seen no error.
    fn sent(&mut self, text: &str, ms: u64) -> Vec<(Duration, Frame)> {
        let start = self.world.now();
        self.send(text);
        self.run_for(millis(ms));
        assert_eq!(self.world.client_port(self.master).confinement().transmit_errors(), 0);
        self.world.take_received(self.display).map(|(at, frame)| (since(at, start), frame)).collect()
    }

    fn state(&mut self, valve: usize) -> DeviceState {
        self.world.view(self.valves[valve]).expect("power").valve.and_then(|valve| valve.dsm).expect("CANopen")
    }
}

fn of_rpdo(kind: FaultKind) -> Fault {
    let frames = FrameFilter { id: Some(standard(0x220).into()), ..FrameFilter::default() };
    Fault { frames, count: Some(1), ..Fault::new("fault", kind) }
}

const fn millis(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Returns the duration of a frame on the bus of 250 kbit/s.
fn length(text: &str) -> Duration {
    Duration::from_micros(u64::from(FrameBits::of(&frame(text)).on_wire()) * 4)
}

/// Returns the ends of frames that follow one another without a gap; the first one begins at `start`.
fn in_a_row(start: Duration, texts: &[&str]) -> Vec<(Duration, Frame)> {
    let pause = Duration::from_micros(u64::from(INTERMISSION) * 4);
    let mut at = start;
    let ends = texts.iter().map(|text| {
        let end = at + length(text);
        at = end + pause;
        (end, frame(text))
    });
    ends.collect()
}

/// Time guarding counts from the end of an RPDO that began at `start`.
fn guarded(start: Duration) -> Vec<(Duration, Frame)> {
    in_a_row(start + length(ACTIVE), &[TIME_GUARDING])
}

const NOW: Duration = Duration::from_ticks(0);

#[test]
fn a_lost_rpdo_is_on_the_bus_and_time_guarding_does_not_count_it() {
    let mut bus = Bus::active();
    bus.add(of_rpdo(FaultKind::Lose { receivers: vec!["boom".into()] }));
    let expected = [in_a_row(NOW, &[ACTIVE]), guarded(millis(250 - 50))].concat();
    assert_eq!(bus.sent(ACTIVE, 240), expected);
    assert_eq!(bus.state(0), DeviceState::FaultHold);
}

#[test]
fn an_rpdo_is_late_by_its_delay() {
    let mut bus = Bus::active();
    bus.add(of_rpdo(FaultKind::Delay { delay: Delay::Constant(millis(20)), overtake: false }));
    let mut early = bus.clone();
    assert_eq!(early.sent(HOLD, 20), []);
    assert_eq!((early.state(0), early.world.pending(early.master)), (DeviceState::Active, 1));
    assert_eq!(bus.sent(HOLD, 40), in_a_row(millis(20), &[HOLD, IS_HOLD]));
    assert_eq!((bus.state(0), bus.world.pending(bus.master)), (DeviceState::Hold, 0));
}

#[test]
fn copies_of_an_rpdo_feed_time_guarding() {
    let mut bus = Bus::active();
    bus.add(of_rpdo(FaultKind::Repeat { times: 4, after: millis(200) }));
    let copies = [0, 200, 400, 600, 800].map(|ms| in_a_row(millis(ms), &[ACTIVE, IS_ACTIVE])).concat();
    assert_eq!(bus.sent(ACTIVE, 1100), [copies, guarded(millis(800 + 250))].concat());
}

#[test]
fn an_old_rpdo_comes_after_a_newer_one() {
    let mut bus = Bus::active();
    bus.add(of_rpdo(FaultKind::Swap { within: millis(1000) }));
    assert_eq!(bus.sent(ACTIVE, 10), []);
    // The answer to the newer one is more urgent than the older one.
    assert_eq!(bus.sent(HOLD, 10)[..3], in_a_row(NOW, &[HOLD, IS_HOLD, ACTIVE]));
    assert_eq!(bus.state(0), DeviceState::Active);
}

#[test]
fn a_corrupted_rpdo_is_another_set_point() {
    let mut bus = Bus::active();
    let toggle = Masks { toggle: [0, 0, 0, 0x20, 0, 0, 0, 0], ..Masks::default() };
    bus.add(of_rpdo(FaultKind::Corrupt(Corruption { data: toggle, ..Corruption::default() })));
    assert_eq!(bus.sent(ACTIVE, 240)[..2], in_a_row(NOW, &["220: 0F 00 00 30", IS_ACTIVE]));
    assert_eq!(bus.world.view(bus.valves[0]).expect("power").position, 0x3000);
}

#[test]
fn an_rpdo_with_another_identifier_is_that_of_the_other_valve() {
    let mut bus = Bus::active();
    bus.add(of_rpdo(FaultKind::Corrupt(Corruption {
        id: Masks { toggle: 0x001, ..Masks::default() },
        ..Corruption::default()
    })));
    let other = in_a_row(NOW, &["221: 0F 00 00 10", "1A1: 09 00 00 00"]);
    assert_eq!(bus.sent(ACTIVE, 240), [other, guarded(millis(250 - 50))].concat());
    assert_eq!([bus.state(0), bus.state(1)], [DeviceState::FaultHold, DeviceState::Disabled]);
}

#[test]
fn an_inserted_nmt_stop_is_obeyed_in_silence() {
    let mut bus = Bus::active();
    let stop = FaultKind::Insert { frame: frame("000: 02 20"), every: None };
    bus.add(Fault { from: millis(5), ..Fault::new("stranger", stop) });
    let expected = [in_a_row(NOW, &[ACTIVE, IS_ACTIVE]), in_a_row(millis(5), &["000: 02 20"])].concat();
    assert_eq!(bus.sent(ACTIVE, 300), expected);
    assert_eq!(bus.state(0), DeviceState::FaultHold);
}

#[test]
fn a_masquerade_is_not_told_from_the_valve() {
    let mut bus = Bus::active();
    let insert = FaultKind::Insert { frame: frame(IS_HOLD), every: Some(millis(10)) };
    bus.add(Fault { count: Some(3), from: millis(5), ..Fault::new("stranger", insert) });
    let strange = [5, 15, 25].map(|ms| in_a_row(millis(ms), &[IS_HOLD])).concat();
    assert_eq!(bus.sent(ACTIVE, 35), [in_a_row(NOW, &[ACTIVE, IS_ACTIVE]), strange].concat());
    assert_eq!(bus.state(0), DeviceState::Active);
}
