//! An external controller on a bus with simulated controllers.

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::{Frame, standard};
use protocol_core::time::Instant;

use super::WireEvent::{self, Begins, Ends, Joined, LostArbitration, NotReceived, NotSent, Received, Recovered, Sent};
use super::{Bus, BusError, DestroyNext, FrameBits, INTERMISSION, PortId};

const RATE: BitRate = BitRate::Kbit250;
const BIT_US: u64 = 4;

struct Rig {
    bus: Bus,
    controller: PortId,
    client: PortId,
    now: Instant,
}

impl Rig {
    /// Creates a controller and a client at 250 kbit/s; the controller starts to listen at 0.
    fn new(silent: bool) -> Self {
        let start = Instant::from_micros(0);
        let mut bus = Bus::default();
        let client = bus.add_client("client".into(), RATE, usize::MAX, start);
        let controller = bus.add_external("controller".into(), RATE);
        bus.attach(controller, RATE, silent, start);
        Self { bus, controller, client, now: start }
    }

    /// Creates a rig whose controller is bus-off because all its frames were destroyed.
    fn in_bus_off() -> Self {
        let mut rig = Self::new(false);
        rig.run(100);
        rig.bus.inject(DestroyNext::frames_of("controller", 32));
        while rig.bus.port(rig.controller).mode() != BusErrorMode::BusOff {
            rig.offer(frame(0x101, &[]));
            let next = rig.bus.next_event().as_micros();
            rig.run(next);
        }
        rig.happened();
        rig
    }

    fn run(&mut self, until_us: u64) {
        let until = Instant::from_micros(until_us);
        self.bus.begin(self.now);
        while self.bus.next_event() <= until {
            self.now = self.now.max(self.bus.next_event());
            self.bus.finish(self.now);
            self.bus.begin(self.now);
        }
        self.now = until;
    }

    fn send(&mut self, frame: Frame) {
        embedded_can::nb::Can::transmit(self.bus.port_mut(self.client), &frame).expect("a client's queue has room");
        self.bus.refresh(self.client, self.now);
    }

    fn offer(&mut self, frame: Frame) {
        self.bus.offer(self.controller, Some(frame), self.now);
    }

    fn events(&mut self) -> Vec<(u64, WireEvent)> {
        let events = self.bus.take_wire_events(self.controller).expect("it is external");
        events.map(|(at, event)| (at.as_micros(), event)).collect()
    }

    fn happened(&mut self) -> Vec<WireEvent> {
        self.events().into_iter().map(|(_, event)| event).collect()
    }
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

fn length_us(frame: &Frame) -> u64 {
    u64::from(FrameBits::of(frame).on_wire()) * BIT_US
}

#[test]
fn it_takes_part_after_eleven_recessive_bits() {
    let mut rig = Rig::new(false);
    rig.offer(frame(0x123, &[1]));
    rig.run(1000);
    let joined = 11 * BIT_US;
    let end = joined + length_us(&frame(0x123, &[1]));
    assert_eq!(rig.events(), [(joined, Joined), (joined, Begins { own: true }), (end, Sent), (end, Ends)]);
}

#[test]
fn a_frame_that_begins_before_eleven_recessive_bits_is_waited_for() {
    let mut rig = Rig::new(false);
    rig.bus.add_client("listener".into(), RATE, usize::MAX, rig.now);
    rig.run(5 * BIT_US);
    rig.send(frame(0x100, &[]));
    let end = 5 * BIT_US + length_us(&frame(0x100, &[]));
    // The acknowledge delimiter, the end of frame and the intermission are 11 recessive bits.
    let joined = end + u64::from(INTERMISSION) * BIT_US;
    rig.run(end);
    assert_eq!(rig.happened(), []);
    rig.run(1000);
    assert_eq!(rig.events(), [(joined, Joined)]);
}

#[test]
fn the_less_urgent_frame_loses_and_the_winner_is_received() {
    let mut rig = Rig::new(false);
    rig.run(100);
    rig.send(frame(0x100, &[7]));
    rig.offer(frame(0x101, &[]));
    let won = frame(0x100, &[7]);
    rig.run(100 + length_us(&won));
    assert_eq!(rig.happened(), [Joined, LostArbitration, Begins { own: false }, Received(won), Ends]);
    rig.run(1000);
    assert_eq!(rig.happened(), [Begins { own: true }, Sent, Ends], "the offer stands");
}

#[test]
fn a_destroyed_frame_is_told_to_sender_and_listener() {
    let mut rig = Rig::new(false);
    rig.run(100);
    rig.bus.inject(DestroyNext::frames(1));
    rig.offer(frame(0x101, &[]));
    rig.run(400);
    assert_eq!(rig.happened(), [Joined, Begins { own: true }, NotSent(BusError::Bit), Ends]);
    rig.bus.inject(DestroyNext::frames(1));
    rig.send(frame(0x102, &[]));
    rig.run(600);
    let happened = rig.happened();
    assert_eq!(happened[..3], [Begins { own: false }, NotReceived { first: false }, Ends]);
}

#[test]
fn a_silent_one_hears_but_acknowledges_and_sends_nothing() {
    let mut rig = Rig::new(true);
    rig.run(100);
    rig.offer(frame(0x101, &[]));
    rig.send(frame(0x102, &[]));
    rig.run(400);
    assert_eq!(rig.bus.port(rig.client).confinement().transmit_errors(), 8, "nobody acknowledged");
    assert!(!rig.happened().contains(&Begins { own: true }));
}

#[test]
fn it_comes_back_from_bus_off_only_when_it_wants_to() {
    let mut rig = Rig::in_bus_off();
    let idle = rig.now.as_micros() + 10_000_000;
    rig.run(idle);
    assert_eq!(rig.happened(), [], "it waits");
    rig.bus.start_recovery(rig.controller, rig.now);
    rig.run(idle + 10_000_000);
    assert_eq!(rig.events(), [(idle + 128 * 11 * BIT_US, Recovered)]);
    assert_eq!(rig.bus.port(rig.controller).mode(), BusErrorMode::ErrorActive);
}

#[test]
fn a_recovery_that_begins_during_a_frame_counts_from_its_end() {
    let mut rig = Rig::in_bus_off();
    rig.bus.add_client("listener".into(), RATE, usize::MAX, rig.now);
    rig.bus.detach(rig.controller, false, rig.now);
    let start = rig.now.as_micros() + 1000;
    rig.run(start);
    rig.send(frame(0x100, &[]));
    rig.run(start + 10 * BIT_US);
    rig.bus.attach(rig.controller, RATE, false, rig.now);
    rig.bus.start_recovery(rig.controller, rig.now);
    rig.run(start + 1_000_000);
    // The end of the frame and the intermission are the first of the 128 sequences.
    let end = start + length_us(&frame(0x100, &[])) + u64::from(INTERMISSION) * BIT_US;
    let recovered = end + 127 * 11 * BIT_US;
    assert!(rig.events().contains(&(recovered, Recovered)), "not at {recovered}");
}
