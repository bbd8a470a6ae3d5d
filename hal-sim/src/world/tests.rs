//! The world as its users see it: time, power, memory, plant, trace.
#![allow(dead_code, unused_imports)]

use std::sync::mpsc::{Receiver, channel};

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::device::{Senses, StartCause};
use protocol_core::frame::{Frame, standard};
use protocol_core::memory::{RecordKey, StoreError};
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::probe::{Command, ECHO, ECHO_ANSWER, HEARTBEAT, Plan, Probe, command};
use super::*;

const RATE: BitRate = BitRate::Kbit250;

fn std_frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

fn micros(us: u64) -> Instant {
    Instant::from_micros(us)
}

fn trace(world: &mut World) -> Receiver<TraceEvent> {
    let (sender, receiver) = channel();
    world.set_observer(Box::new(move |event| sender.send(event.clone()).unwrap_or(())));
    receiver
}

fn probe(world: &World, node: NodeId) -> &Probe {
    world.device_as(node).unwrap()
}

#[test]
fn a_world_can_be_moved_to_another_thread() {
    fn is_send<T: Send>(_: &T) {}
    is_send(&World::new(RATE, 0));
}

#[test]
fn a_device_answers_a_client() {
    let mut world = World::new(RATE, 0);
    let node = world.add_device("probe", Plan::new(5, RATE).factory(), Memory::in_ram());
    let tap = world.add_tap("client");
    world.power(node, true);
    world.run_until(micros(1000));
    world.send(tap, std_frame(ECHO + 5, &[1, 2, 3]));
    assert_eq!((world.pending(tap), world.next_event()), (1, micros(1000)));
    world.run_until(micros(3000));
    let received: Vec<_> = world.take_received(tap).collect();
    assert_eq!(received.len(), 1);
    assert_eq!(received[0].1, std_frame(ECHO_ANSWER + 5, &[1, 2, 3]));
    assert_eq!(world.pending(tap), 0);
    assert_eq!(world.next_event(), NEVER);
    assert_eq!(world.take_received(tap).count(), 0);
}
