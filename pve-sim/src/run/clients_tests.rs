//! Clients of a world without devices: their messages, and the order of their frames.

use std::time::Duration as WallDuration;

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::frame::standard;
use protocol_core::time::Duration;

use super::*;
use crate::inbox::{ClientEnd, PERMITS, Reply};
use hal_sim::bus::{Corruption, Delay, DestroyNext, Fault, FaultKind, FrameFilter, Masks};

struct Rig {
    world: World,
    clients: Clients,
    client_ends: Vec<(ClientId, ClientEnd)>,
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

impl Rig {
    /// Returns a rig with this many listening clients.
    fn new(count: usize) -> Self {
        let mut world = World::new(BitRate::Kbit250, 1);
        // a controller that acknowledges
        world.add_gateway("somebody");
        world.record_events(true);
        let clients = Clients::new(&mut world, false);
        let mut rig = Self { world, clients, client_ends: Vec::new() };
        for _ in 0..count {
            let (id, (to_client, mut client_end)) = (ClientId::next(), ClientQueue::new());
            rig.apply(ToWorld::Join(id, to_client));
            rig.apply(ToWorld::Listen(id, Reply::new("")));
            client_end.queue.try_recv().expect("the reply");
            rig.client_ends.push((id, client_end));
        }
        rig
    }

    fn apply(&mut self, message: ToWorld) {
        self.clients.apply(message, &mut self.world).expect("a client that keeps up");
    }

    fn send(&mut self, client: usize, frame: Frame) {
        self.apply(ToWorld::Send(self.client_ends[client].0, frame));
    }

    /// Runs until all frames are sent; returns them.
    fn run(&mut self) -> Vec<Frame> {
        let end = self.world.now() + Duration::from_secs(10);
        let mut sent = Vec::new();
        while self.world.next_event() <= end {
            self.world.step();
            for event in self.world.take_events() {
                assert!(!event.is_error_frame());
                sent.extend(event.frame());
                assert_eq!(self.clients.show(&event, Timestamp::from_micros(0), None), 0);
            }
            self.clients.send(&mut self.world);
        }
        sent
    }

    /// Takes the frames of a client.
    fn heard(&mut self, client: usize) -> Vec<Frame> {
        let queue = &mut self.client_ends[client].1.queue;
        std::iter::from_fn(|| queue.try_recv().ok())
            .map(|message| match message {
                ToClient::Frame(_, frame) => frame,
                other => panic!("{other:?}"),
            })
            .collect()
    }
}

/// As when all clients poll one object of one valve.
#[test]
fn equal_frames_of_several_clients_all_go_out() {
    let mut rig = Rig::new(3);
    let request = frame(0x620, &[0x40, 0, 0x10, 0]);
    for client in [0, 1, 2, 0, 1, 2] {
        rig.send(client, request);
    }
    assert_eq!(rig.run(), [request; 6]);
    for client in 0..3 {
        assert_eq!(rig.heard(client), [request; 4], "all but its own two");
    }
}

#[test]
fn frames_of_one_identifier_do_not_collide() {
    let mut rig = Rig::new(3);
    let frames: Vec<Frame> = (0..9).map(|number| frame(0x620, &[number])).collect();
    for (number, frame) in frames.iter().enumerate() {
        rig.send(number % 3, *frame);
    }
    assert_eq!(rig.run(), frames, "in the order they came in");
    let others: Vec<Frame> = frames.iter().enumerate().filter(|(number, _)| number % 3 != 1).map(|(_, f)| *f).collect();
    assert_eq!(rig.heard(1), others);
}

#[test]
fn urgent_frames_overtake_those_of_other_clients_only() {
    let mut rig = Rig::new(2);
    for number in 0..3 {
        rig.send(0, frame(0x700, &[number]));
    }
    rig.send(0, frame(0x001, &[]));
    rig.send(1, frame(0x100, &[]));
    let sent: Vec<String> = rig.run().iter().map(ToString::to_string).collect();
    // The first frame was already on the wire.
    assert_eq!(sent, ["700: 00", "100:", "700: 01", "700: 02", "001:"]);
}

#[test]
fn what_a_client_sent_before_it_left_goes_out() {
    let mut rig = Rig::new(2);
    let frames = [frame(0x101, &[]), frame(0x102, &[]), frame(0x103, &[])];
    for frame in frames {
        rig.send(0, frame);
    }
    let (left, _client_end) = rig.client_ends.remove(0);
    rig.apply(ToWorld::Leave(left));
    rig.apply(ToWorld::Send(left, frame(0x104, &[])));
    assert_eq!(rig.run(), frames);
    assert_eq!(rig.heard(0), frames);
}

/// Many clients send and leave at once.
#[test]
fn what_departed_clients_leave_behind_is_bounded() {
    let mut rig = Rig::new(1);
    for _ in 0..100 {
        let (to_client, _client_end) = ClientQueue::new();
        let id = ClientId::next();
        rig.apply(ToWorld::Join(id, to_client));
        for _ in 0..PERMITS {
            rig.apply(ToWorld::Send(id, frame(0x700, &[0; 8])));
        }
        rig.apply(ToWorld::Leave(id));
        rig.apply(ToWorld::Leave(id));
    }
    // A client with a single frame keeps it.
    let (to_client, _client_end) = ClientQueue::new();
    let modest = ClientId::next();
    rig.apply(ToWorld::Join(modest, to_client));
    rig.apply(ToWorld::Send(modest, frame(0x7FF, &[])));
    rig.apply(ToWorld::Leave(modest));
    let waiting: usize = rig.clients.waiting.values().map(VecDeque::len).sum();
    assert!(waiting <= ORPHANED_MAX, "{waiting}");
    assert!(rig.clients.waiting.contains_key(&modest));
    // The frame in the controller no longer counts.
    assert_eq!(rig.clients.take_dropped(), 100 * PERMITS - waiting);
    assert_eq!(rig.run().len(), waiting + 1);
    assert_eq!(rig.clients.orphaned, 0);
}

/// All frames are destroyed.
#[test]
fn a_frame_that_is_destroyed_ends_with_its_client() {
    let mut world = World::new(BitRate::Kbit250, 1);
    world.inject(DestroyNext::frames(u32::MAX));
    world.record_events(true);
    let mut clients = Clients::new(&mut world, false);
    let (id, (to_client, _client_end)) = (ClientId::next(), ClientQueue::new());
    clients.apply(ToWorld::Join(id, to_client), &mut world).unwrap();
    for number in 0..2 {
        clients.apply(ToWorld::Send(id, frame(0x123, &[number])), &mut world).unwrap();
    }
    let mut step = |clients: &mut Clients| {
        world.step();
        let events: Vec<Event> = world.take_events().collect();
        for event in &events {
            clients.withdraw(event, &mut world);
        }
        clients.send(&mut world);
        events.iter().filter(|event| event.is_error_frame()).count()
    };
    // Frames of connected clients are not withdrawn.
    let tried: usize = (0..200).map(|_| step(&mut clients)).sum();
    assert!(tried > 20, "{tried}");
    clients.remove(id);
    let tried: usize = (0..200).map(|_| step(&mut clients)).sum();
    assert!(tried <= 2, "each of them once more at the most: {tried}");
    assert!(clients.waiting.is_empty() && clients.sending.is_none());
}

/// Error frames go to the clients that want them, as reported.
#[test]
fn error_frames_are_for_clients_that_want_them() {
    for wanted in [false, true] {
        let mut rig = Rig::new(1);
        rig.clients.error_frames = wanted;
        let what = EventKind::ErrorMode { from: BusErrorMode::ErrorActive, to: BusErrorMode::ErrorPassive };
        let event = Event { at: rig.world.now(), who: "valve".into(), what };
        let at = Timestamp::from_micros(7);
        for told in [None, Some(ErrorClass::ErrorPassive), None] {
            assert_eq!(rig.clients.show(&event, at, told), 0);
        }
        let queue = &mut rig.client_ends[0].1.queue;
        let heard: Vec<ToClient> = std::iter::from_fn(|| queue.try_recv().ok()).collect();
        let told = vec![ToClient::Error(at, ErrorClass::ErrorPassive)];
        assert_eq!(heard, if wanted { told } else { Vec::new() });
    }
}

#[tokio::test(start_paused = true)]
async fn credit_comes_back_with_each_frame_that_is_sent() {
    let mut rig = Rig::new(1);
    for round in 0..3 {
        for _ in 0..PERMITS {
            let spent = tokio::time::timeout(WallDuration::from_secs(1), rig.client_ends[0].1.permits.spend());
            spent.await.expect("permit");
            rig.send(0, frame(0x123, &[round]));
        }
        assert_eq!(rig.run().len(), PERMITS);
    }
}

/// A client does not hear its own frame, whatever a fault makes of it, and nobody waits for a frame that is held back.
#[test]
fn a_frame_that_a_fault_holds_back_is_that_of_its_client() {
    let of_220 = || FrameFilter { id: Some(standard(0x220).into()), ..FrameFilter::default() };
    let toggle = Masks { toggle: [0x80, 0, 0, 0, 0, 0, 0, 0], ..Masks::default() };
    let kinds = [
        (FaultKind::Delay { delay: Delay::Constant(Duration::from_millis(5)), overtake: false }, vec![1]),
        (FaultKind::Repeat { times: 2, after: Duration::from_millis(5) }, vec![1, 1, 1]),
        (FaultKind::Corrupt(Corruption { data: toggle, ..Corruption::default() }), vec![0x81]),
    ];
    for (kind, expected) in kinds {
        let mut rig = Rig::new(2);
        let is_delay = matches!(kind, FaultKind::Delay { .. });
        rig.world.fault(Fault { frames: of_220(), ..Fault::new("fault", kind) }).expect("a fault");
        rig.send(0, frame(0x220, &[1]));
        rig.send(1, frame(0x300, &[]));
        let sent = rig.run();
        assert_eq!(sent.len(), expected.len() + 1);
        assert_eq!(sent[0] == frame(0x300, &[]), is_delay, "{sent:?}");
        assert_eq!(rig.heard(0), [frame(0x300, &[])]);
        assert_eq!(rig.heard(1), expected.iter().map(|byte| frame(0x220, &[*byte])).collect::<Vec<_>>());
    }
}

#[test]
fn the_frames_of_clients_are_swapped() {
    let mut rig = Rig::new(2);
    rig.world
        .fault(Fault { count: Some(1), ..Fault::new("fault", FaultKind::Swap { within: Duration::from_secs(1) }) })
        .expect("a fault");
    rig.send(0, frame(0x220, &[1]));
    rig.send(1, frame(0x220, &[2]));
    assert_eq!(rig.run(), [2, 1].map(|byte| frame(0x220, &[byte])));
    assert_eq!((rig.heard(0), rig.heard(1)), (vec![frame(0x220, &[2])], vec![frame(0x220, &[1])]));
}

/// A fault holds back some hundred frames; the clients keep the rest.
#[test]
fn delayed_frames_are_bounded() {
    let mut rig = Rig::new(1);
    let delay = Delay::Constant(Duration::from_secs(5));
    rig.world.fault(Fault::new("fault", FaultKind::Delay { delay, overtake: false })).expect("a fault");
    for _ in 0..1000 {
        rig.send(0, frame(0x220, &[]));
    }
    assert_eq!(rig.world.pending(rig.clients.port), 256);
    assert_eq!(rig.clients.waiting.values().map(VecDeque::len).sum::<usize>(), 1000 - 256);
}
