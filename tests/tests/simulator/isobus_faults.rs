//! The eight errors of communication on ISOBUS: what a third party receives, to the microsecond, and what the valves do.

use hal_sim::bus::{Corruption, Delay, Fault, FaultKind, FrameBits, FrameFilter, INTERMISSION, Masks};
use hal_sim::{BitRate, ClientPortId, NodeId, World};
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::frame::{Frame, extended};
use protocol_core::time::{Duration, Instant, after, since};
use protocol_core::wire::valve::State;
use tests::frame;

/// The commands of the tractor to the first valve.
const AVC: u32 = 0x0CFE_3027;
const EXTEND: &str = "0CFE3027: 7D FF 31 FF FF FF FF FF";
const BLOCK: &str = "0CFE3027: 00 FF 30 FF FF FF FF FF";
/// DM1 of the first time guarding.
const TIME_GUARDING: &str = "18FECA80: 04 FF E9 8F 93 01 FF FF";

/// Two valves, their tractor, and a display that only listens.
#[derive(Clone)]
struct Bus {
    world: World,
    tractor: ClientPortId,
    display: ClientPortId,
    valves: [NodeId; 2],
}

impl Bus {
    /// A bus on which the first valve extends to half its stroke; the second one was never commanded.
    fn extending() -> Self {
        let mut world = World::new(BitRate::Kbit250, 1);
        let [tractor, display] = ["tractor", "display"].map(|name| world.add_client_port(name));
        let valves = [("boom", 0x80, 1), ("arm", 0x81, 2)].map(|(name, address, serial)| {
            let setup = Setup { node_id: Some(address), serial: Some(serial), ..Setup::new(Kind::PveaIsobus) };
            world.add(name, setup)
        });
        valves.into_iter().for_each(|valve| world.power(valve, true));
        let mut bus = Self { world, tractor, display, valves };
        bus.run_for(Duration::from_millis(1010));
        for _ in 0..4 {
            bus.send(EXTEND);
            bus.run_for(Duration::from_millis(50));
        }
        bus.received();
        bus
    }

    fn add(&mut self, fault: Fault) {
        self.world.fault(fault).expect("a fault");
    }

    fn send(&mut self, text: &str) {
        self.world.send(self.tractor, frame(text));
    }

    fn run_for(&mut self, time: Duration) {
        let end = after(self.world.now(), time);
        self.world.run_until(end);
    }

    /// Returns the frames that the display has received, without the cyclic AVEF.
    fn received(&mut self) -> Vec<(Instant, Frame)> {
        let avef = [frame("0CFE1080:").id(), frame("0CFE1181:").id()];
        self.world.take_received(self.display).filter(|(_, frame)| !avef.contains(&frame.id())).collect()
    }

    fn command(&mut self, valve: usize) -> State {
        self.world.view(self.valves[valve]).expect("power").valve.and_then(|valve| valve.command).expect("ISOBUS")
    }
}

fn of_avc(kind: FaultKind) -> Fault {
    let frames = FrameFilter { id: Some(extended(AVC).into()), ..FrameFilter::default() };
    Fault { frames, count: Some(1), ..Fault::new("fault", kind) }
}

const fn millis(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Returns the duration of a frame on the bus of 250 kbit/s.
fn length(frame: &Frame) -> Duration {
    Duration::from_micros(u64::from(FrameBits::of(frame).on_wire()) * 4)
}

/// Sends an AVC at once; returns the times and the frames that the display receives within so many milliseconds.
fn sent(bus: &mut Bus, text: &str, ms: u64) -> Vec<(Duration, Frame)> {
    let start = bus.world.now();
    bus.send(text);
    bus.run_for(millis(ms));
    bus.received().into_iter().map(|(at, frame)| (since(at, start), frame)).collect()
}

#[test]
fn a_lost_avc_is_on_the_bus_and_time_guarding_does_not_count_it() {
    let mut bus = Bus::extending();
    bus.add(of_avc(FaultKind::Lose { receivers: vec!["boom".into()] }));
    // The last AVC that the valve has received began 50 ms ago.
    let avc = frame(EXTEND);
    let dm1 = frame(TIME_GUARDING);
    let guard = millis(250 - 50) + length(&avc) + length(&dm1);
    assert_eq!(sent(&mut bus, EXTEND, 240), [(length(&avc), avc), (guard, dm1)]);
    assert_eq!(bus.command(0), State::Blocked);
}

#[test]
fn an_avc_is_late_by_its_delay() {
    let mut bus = Bus::extending();
    bus.add(of_avc(FaultKind::Delay { delay: Delay::Constant(millis(20)), overtake: false }));
    let block = frame(BLOCK);
    let mut early = bus.clone();
    assert_eq!(sent(&mut early, BLOCK, 20), []);
    assert_eq!(early.command(0), State::Extend);
    assert_eq!(sent(&mut bus, BLOCK, 40), [(millis(20) + length(&block), block)]);
    assert_eq!(bus.command(0), State::Blocked);
}

#[test]
fn copies_of_an_avc_feed_time_guarding() {
    let mut bus = Bus::extending();
    bus.add(of_avc(FaultKind::Repeat { times: 4, after: millis(200) }));
    let avc = frame(EXTEND);
    let copies = [0, 200, 400, 600, 800].map(|ms| (millis(ms) + length(&avc), avc));
    let dm1 = frame(TIME_GUARDING);
    let guard = millis(800 + 250) + length(&avc) + length(&dm1);
    let expected: Vec<(Duration, Frame)> = copies.into_iter().chain([(guard, dm1)]).collect();
    assert_eq!(sent(&mut bus, EXTEND, 1100), expected);
}

#[test]
fn an_old_avc_comes_after_a_newer_one() {
    let mut bus = Bus::extending();
    bus.add(of_avc(FaultKind::Swap { within: millis(1000) }));
    let [old, new] = [EXTEND, BLOCK].map(frame);
    assert_eq!(sent(&mut bus, EXTEND, 10), []);
    let pause = Duration::from_micros(u64::from(INTERMISSION) * 4);
    let both = [(length(&new), new), (length(&new) + pause + length(&old), old)];
    assert_eq!(sent(&mut bus, BLOCK, 10), both);
    assert_eq!(bus.command(0), State::Extend);
}

#[test]
fn a_corrupted_avc_turns_the_direction() {
    let mut bus = Bus::extending();
    let toggle = Masks { toggle: [0, 0, 0x03, 0, 0, 0, 0, 0], ..Masks::default() };
    bus.add(of_avc(FaultKind::Corrupt(Corruption { data: toggle, ..Corruption::default() })));
    let retract = frame("0CFE3027: 7D FF 32 FF FF FF FF FF");
    assert_eq!(sent(&mut bus, EXTEND, 10), [(length(&retract), retract)]);
    assert_eq!(bus.command(0), State::Retract);
}

#[test]
fn an_avc_with_another_address_moves_the_other_valve() {
    let mut bus = Bus::extending();
    let toggle = Masks { toggle: 0x100, ..Masks::default() };
    bus.add(of_avc(FaultKind::Corrupt(Corruption { id: toggle, ..Corruption::default() })));
    let (other, dm1) = (frame("0CFE3127: 7D FF 31 FF FF FF FF FF"), frame(TIME_GUARDING));
    let guard = millis(250 - 50) + length(&frame(EXTEND)) + length(&dm1);
    assert_eq!(sent(&mut bus, EXTEND, 240), [(length(&other), other), (guard, dm1)]);
    assert_eq!([bus.command(0), bus.command(1)], [State::Blocked, State::Extend]);
}

#[test]
fn an_inserted_emergency_stop_of_another_source_lasts_until_the_next_avc() {
    let mut bus = Bus::extending();
    let stop = frame("0CFE30F1: 00 FF 3E FF FF FF FF FF");
    let start = bus.world.now();
    bus.add(Fault { from: millis(5), ..Fault::new("stranger", FaultKind::Insert { frame: stop, every: None }) });
    bus.run_for(millis(10));
    assert_eq!(bus.received(), [(start + millis(5) + length(&stop), stop)]);
    assert_eq!(bus.command(0), State::EmergencyStop);
    sent(&mut bus, EXTEND, 10);
    assert_eq!(bus.command(0), State::Extend);
}

/// ISO 11783-5: a claim, and not again for 5 s.
#[test]
fn a_masquerade_is_answered_by_one_claim() {
    let mut bus = Bus::extending();
    let mine = frame("18FECA80: 00 FF 00 00 00 00 FF FF");
    let start = bus.world.now();
    let insert = FaultKind::Insert { frame: mine, every: Some(millis(10)) };
    bus.add(Fault { count: Some(3), ..Fault::new("stranger", insert) });
    bus.run_for(millis(35));
    let claim = frame("18EEFF80: 01 00 20 07 08 FF 02 20");
    let pause = Duration::from_micros(u64::from(INTERMISSION) * 4);
    let first = start + length(&mine);
    let expected = [
        (first, mine),
        (first + pause + length(&claim), claim),
        (first + millis(10), mine),
        (first + millis(20), mine),
    ];
    assert_eq!(bus.received(), expected);
    assert_eq!(bus.command(0), State::Extend);
}
