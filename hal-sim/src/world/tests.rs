//! The public interface of the world: time, power, plant, effects, trace.

use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::device::{Inputs, StartCause};
use protocol_core::frame::{Frame, standard};
use protocol_core::memory::{RecordKey, StoreError};
use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::probe::{Command, DONE, ECHO, ECHO_ANSWER, HEARTBEAT, Plan, Probe, command};
use super::*;
use crate::bus::{BusError, DestroyNext, FrameBits};

mod clients;
mod events;

const RATE: BitRate = BitRate::Kbit250;

fn std_frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

fn millis(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

fn bits(count: u32) -> Duration {
    Duration::from_ticks(u64::from(count * 4))
}

/// A world with devices 1, 2 …, powered since time 0, and a client; the world has run to 10 ms.
struct Rig {
    world: World,
    client: ClientPortId,
    nodes: Vec<NodeId>,
}

impl Rig {
    fn of(count: u8) -> Self {
        Self::with(count, 1, |id| Plan::new(id, RATE))
    }

    fn with(count: u8, seed: u64, plan: impl Fn(u8) -> Plan) -> Self {
        let mut world = World::new(RATE, seed);
        world.record_events(true);
        let add = |id| world.add_device(&format!("probe-{id}"), plan(id).factory(), Memory::in_ram());
        let nodes = (1..=count).map(add).collect();
        let client = world.add_client_port("client");
        world.power_all(Duration::from_ticks(0));
        world.run_until(millis(10));
        Self { world, client, nodes }
    }

    fn probe(&self, number: usize) -> &Probe {
        self.world.device_as(self.nodes[number]).expect("powered")
    }

    fn run_for(&mut self, ms: u64) {
        let end = after(self.world.now(), Duration::from_millis(ms));
        self.world.run_until(end);
    }

    fn command(&mut self, what: Command, id: u8, data: &[u8]) {
        self.world.send(self.client, command(what, id, data));
    }

    /// Takes the frames and error frames since the last call.
    fn trace(&mut self) -> Vec<Event> {
        let of_bus = |event: &Event| event.frame().is_some() || event.is_error_frame();
        self.world.take_events().filter(of_bus).collect()
    }

    fn received(&mut self) -> Vec<Frame> {
        self.world.take_received(self.client).map(|(_, frame)| frame).collect()
    }
}

#[test]
fn a_world_can_be_moved_to_another_thread() {
    fn is_send<T: Send>(_: &T) {}
    is_send(&World::new(RATE, 0));
}

#[test]
fn nothing_happens_in_an_idle_world() {
    let mut rig = Rig::of(2);
    assert_eq!(rig.world.next_event(), NEVER);
    rig.world.step();
    assert_eq!(rig.world.now(), millis(10));
    rig.run_for(1_000_000);
    assert_eq!(rig.world.now(), millis(1_000_010));
    assert_eq!(rig.world.take_events().count(), 0);
}

#[test]
fn a_device_answers_a_client() {
    let mut rig = Rig::of(1);
    let (question, answer) = (std_frame(ECHO + 1, &[1, 2, 3]), std_frame(ECHO_ANSWER + 1, &[1, 2, 3]));
    rig.world.send(rig.client, question);
    assert_eq!((rig.world.pending(rig.client), rig.world.next_event()), (1, millis(10)));
    rig.run_for(10);
    let first = after(millis(10), bits(FrameBits::of(&question).on_wire()));
    let second = after(first, bits(3 + FrameBits::of(&answer).on_wire()));
    let answered = after(first, bits(3));
    assert_eq!(
        rig.trace(),
        [
            Event { at: first, who: "client".into(), what: EventKind::Frame { frame: question, start: millis(10) } },
            Event { at: second, who: "probe-1".into(), what: EventKind::Frame { frame: answer, start: answered } },
        ]
    );
    assert_eq!(rig.world.pending(rig.client), 0);
    let received: Vec<_> = rig.world.take_received(rig.client).collect();
    assert_eq!(received, [(second, answer)]);
    assert_eq!(rig.world.take_received(rig.client).count(), 0);
}

#[test]
fn clients_hear_each_other_but_not_themselves() {
    let mut rig = Rig::of(0);
    let other = rig.world.add_client_port("other");
    for byte in 0..10 {
        // Clients send in FIFO order, regardless of the identifiers.
        rig.world.send(rig.client, std_frame(0x700 - u16::from(byte), &[byte]));
    }
    rig.run_for(100);
    assert_eq!(rig.received(), []);
    let heard: Vec<_> = rig.world.take_received(other).map(|(_, frame)| frame.data()[0]).collect();
    assert_eq!(heard, (0..10).collect::<Vec<_>>());
    // The client is alone on the bus again and not acknowledged; a removed client loses its frames.
    rig.world.remove_client_port(other);
    rig.world.send(rig.client, std_frame(1, &[]));
    rig.run_for(100);
    assert_eq!(rig.world.pending(rig.client), 1);
    assert_eq!(rig.world.client_port(rig.client).mode(), BusErrorMode::ErrorPassive);
    rig.world.remove_client_port(rig.client);
    assert_eq!(rig.world.pending(rig.client), 0);
    rig.run_for(100);
    assert_eq!(rig.world.next_event(), NEVER);
}

#[test]
fn clients_come_and_go_without_a_trace() {
    let mut rig = Rig::of(1);
    for round in 0..1000_u16 {
        let visitor = rig.world.add_client_port("visitor");
        rig.world.send(visitor, std_frame(ECHO + 1, &round.to_le_bytes()));
        rig.run_for(1);
        let heard: Vec<_> = rig.world.take_received(visitor).map(|(_, frame)| frame).collect();
        assert_eq!(heard, [std_frame(ECHO_ANSWER + 1, &round.to_le_bytes())]);
        // Removed while its own frame is on the wire.
        rig.world.send(visitor, std_frame(0x123, &[]));
        rig.world.step();
        rig.world.remove_client_port(visitor);
    }
    rig.run_for(10);
    let broken = |event: &Event| event.is_error_frame() && event.who.as_ref() == "visitor";
    assert_eq!(rig.trace().into_iter().filter(broken).count(), 1000);
    assert_eq!(rig.world.owners.len(), 3, "one device, one client, one place for all the visitors");
}

#[test]
fn a_gateway_without_a_client_acknowledges_and_keeps_nothing() {
    let mut world = World::new(RATE, 0);
    let gateway = world.add_gateway("gateway");
    let node =
        world.add_device("probe", Plan::new(1, RATE).beating(Duration::from_millis(10)).factory(), Memory::in_ram());
    world.power(node, true);
    world.run_until(millis(1005));
    assert_eq!((world.port(node).mode(), world.port(node).pending()), (BusErrorMode::ErrorActive, 0));
    assert_eq!(world.port(node).confinement().transmit_errors(), 0);
    assert_eq!(world.take_received(gateway).count(), 0);
}

#[test]
fn a_step_is_one_instant() {
    let mut rig = Rig::of(1);
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    let mut instants = Vec::new();
    while rig.world.next_event() != NEVER {
        rig.world.step();
        instants.push(rig.world.now());
    }
    assert!(instants.is_sorted_by(|a, b| a < b), "{instants:?}");
    // Start and end of the request, start and end of the response.
    assert_eq!(instants.len(), 4);
}

#[test]
fn a_write_takes_its_time_and_is_answered_once_the_memory_holds_it() {
    let mut rig = Rig::of(1);
    for (what, key, time) in
        [(Command::Store, RecordKey::Parameters, WRITE_TIME), (Command::Log, RecordKey::FaultLog, FAULT_LOG_WRITE_TIME)]
    {
        rig.command(what, 1, b"abc");
        rig.run_for(100);
        let (at, _) = rig.world.take_received(rig.client).next_back().unwrap();
        // The write begins when the response has been sent.
        let stored = *rig.probe(0).stored.last().unwrap();
        assert_eq!(stored, (key, Ok(()), after(at, time)));
    }
    rig.world.power(rig.nodes[0], false);
    rig.world.power(rig.nodes[0], true);
    assert_eq!(rig.probe(0).parameters.as_deref(), Some(&b"abc"[..]));
}

#[test]
fn a_failing_memory_is_reported_and_keeps_what_it_had() {
    let mut rig = Rig::of(1);
    rig.command(Command::Store, 1, b"old");
    rig.run_for(100);
    rig.world.memory_mut(rig.nodes[0]).set_write_fails(true);
    rig.command(Command::Store, 1, b"new");
    rig.run_for(100);
    assert_eq!(rig.probe(0).stored.last().unwrap().1, Err(StoreError));
    rig.world.power(rig.nodes[0], false);
    rig.world.power(rig.nodes[0], true);
    assert_eq!(rig.probe(0).parameters.as_deref(), Some(&b"old"[..]));
    rig.world.memory_mut(rig.nodes[0]).set_write_fails(false);
    rig.command(Command::Store, 1, b"new");
    rig.run_for(100);
    assert_eq!(rig.probe(0).stored.last().unwrap().1, Ok(()));
}

#[test]
fn a_power_cut_at_any_moment_of_a_write_leaves_the_old_or_the_new_record() {
    let (mut old, mut new) = (0, 0);
    for cut in (0..=10_000).step_by(100) {
        let mut rig = Rig::of(1);
        rig.command(Command::Store, 1, b"before");
        rig.run_for(100);
        let _ = rig.received();
        rig.command(Command::Store, 1, b"after");
        // The response is sent, then the write begins.
        while rig.world.take_received(rig.client).count() == 0 {
            rig.world.step();
        }
        let cut_at = after(rig.world.now(), Duration::from_micros(cut));
        rig.world.run_until(cut_at);
        rig.world.power(rig.nodes[0], false);
        assert!(rig.world.device(rig.nodes[0]).is_none());
        rig.run_for(100);
        rig.world.power(rig.nodes[0], true);
        match rig.probe(0).parameters.as_deref() {
            Some(b"before") => old += 1,
            Some(b"after") => new += 1,
            other => panic!("cut after {cut} us: {other:?}"),
        }
        // The memory can be written again.
        rig.command(Command::Store, 1, b"again");
        rig.run_for(100);
        assert_eq!(rig.probe(0).stored.last().unwrap().1, Ok(()));
    }
    assert!(old > 50 && new > 0, "{old} old, {new} new");
}

#[test]
fn a_damaged_memory_is_told_at_one_start() {
    let mut rig = Rig::of(1);
    rig.world.memory_mut(rig.nodes[0]).flash_mut().fill(|cell| (cell * 7) as u8);
    for damaged in [true, false] {
        rig.world.power(rig.nodes[0], false);
        rig.world.power(rig.nodes[0], true);
        assert_eq!(rig.probe(0).damaged, damaged);
    }
}

#[test]
fn power_off_is_at_once() {
    let mut rig = Rig::with(1, 1, |id| Plan::new(id, RATE).beating(Duration::from_millis(10)));
    rig.run_for(5);
    assert_eq!(rig.received().len(), 2);
    rig.world.power(rig.nodes[0], false);
    assert_eq!((rig.world.outputs(rig.nodes[0]), rig.world.next_event()), (None, NEVER));
    rig.run_for(1000);
    assert_eq!(rig.received(), []);
    rig.world.power_with(rig.nodes[0], StartCause::Watchdog);
    assert_eq!(rig.probe(0).cause, StartCause::Watchdog);
    assert!(rig.world.outputs(rig.nodes[0]).is_some());
    rig.run_for(5);
    assert_eq!(rig.received(), [std_frame(HEARTBEAT + 1, &[5])]);
    // A watchdog reset restarts a running device; repeated power-on does not.
    rig.world.power(rig.nodes[0], true);
    assert_eq!(rig.probe(0).cause, StartCause::Watchdog);
    rig.world.power_with(rig.nodes[0], StartCause::Watchdog);
    rig.run_for(5);
    assert_eq!(rig.received(), [std_frame(HEARTBEAT + 1, &[5])]);
}

#[test]
fn a_restart_reads_the_memory_again() {
    let mut rig = Rig::of(1);
    rig.command(Command::Store, 1, b"abc");
    rig.run_for(100);
    assert_eq!(rig.probe(0).parameters, None);
    rig.command(Command::Restart, 1, &[]);
    rig.run_for(100);
    let probe = rig.probe(0);
    assert_eq!((probe.restarts, probe.parameters.as_deref()), (1, Some(&b"abc"[..])));
    // The response to the command was not lost.
    assert_eq!(rig.received().last(), Some(&std_frame(DONE + 1, &[4])));
}

#[test]
fn the_plant_reaches_the_device_at_once() {
    let mut rig = Rig::of(1);
    let node = rig.nodes[0];
    let low = Inputs { internal_fault: true, bus: BusErrorMode::BusOff, ..*rig.world.inputs(node) };
    rig.world.set_inputs(node, low);
    let expected = Inputs { bus: BusErrorMode::ErrorActive, ..low };
    assert_eq!(rig.probe(0).inputs, expected);
    // The plant is unchanged while the device is off.
    rig.world.power(node, false);
    rig.world.power(node, true);
    assert_eq!(rig.probe(0).inputs, expected);
    assert_eq!(rig.world.inputs(node), &expected);
}

#[test]
fn bus_off_is_sensed_and_so_is_the_recovery() {
    let mut rig = Rig::of(2);
    let node = rig.nodes[0];
    rig.world.force_bus_off(node, true);
    assert!(rig.world.is_bus_off_forced(node));
    assert_eq!(rig.probe(0).inputs.bus, BusErrorMode::BusOff);
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    rig.run_for(100);
    assert_eq!(rig.received(), []);
    rig.world.force_bus_off(node, false);
    let released = rig.world.now();
    while rig.probe(0).inputs.bus == BusErrorMode::BusOff {
        rig.world.step();
    }
    assert_eq!(since(rig.world.now(), released), bits(128 * 11));
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    rig.run_for(100);
    assert_eq!(rig.received(), [std_frame(ECHO_ANSWER + 1, &[])]);
    // Forced bus-off persists without power.
    rig.world.force_bus_off(node, true);
    rig.world.power(node, false);
    rig.world.power(node, true);
    assert_eq!(rig.probe(0).inputs.bus, BusErrorMode::BusOff);
    rig.run_for(1000);
    assert_eq!(rig.probe(0).inputs.bus, BusErrorMode::BusOff);
}

#[test]
fn a_sender_that_is_disturbed_goes_through_every_mode() {
    let mut rig = Rig::of(1);
    rig.world.inject(DestroyNext::frames_of("probe-1", 32));
    rig.world.send(rig.client, std_frame(ECHO + 1, &[7]));
    let mut modes = vec![BusErrorMode::ErrorActive];
    while rig.world.next_event() != NEVER {
        rig.world.step();
        let mode = rig.probe(0).inputs.bus;
        if modes.last() != Some(&mode) {
            modes.push(mode);
        }
    }
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};
    assert_eq!(modes, [ErrorActive, ErrorPassive, BusOff, ErrorActive]);
    let answer = std_frame(ECHO_ANSWER + 1, &[7]);
    let errors = rig.trace().into_iter().filter(|event| {
        matches!(&event.what, EventKind::ErrorFrame { frame, error: BusError::Bit, .. } if *frame == answer)
            && event.who.as_ref() == "probe-1"
    });
    assert_eq!(errors.count(), 32);
    assert_eq!(rig.received(), [], "what waited in the controller is out of date after the recovery");
}

#[test]
fn the_master_follows_a_device_to_another_bit_rate() {
    let mut rig = Rig::of(1);
    rig.command(Command::Rate, 1, &[BitRate::Kbit500.table_index()]);
    rig.run_for(10);
    assert_eq!(rig.received(), [std_frame(DONE + 1, &[3])]);
    assert_eq!(rig.world.port(rig.nodes[0]).bit_rate(), BitRate::Kbit500);
    rig.world.set_bit_rate(BitRate::Kbit500);
    assert_eq!(rig.world.bit_rate(), BitRate::Kbit500);
    rig.trace();
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    rig.run_for(10);
    assert_eq!(rig.received(), [std_frame(ECHO_ANSWER + 1, &[])]);
    assert!(rig.trace().iter().all(|event| event.frame().is_some()), "no error frame");
}

#[test]
fn a_device_at_another_bit_rate_is_not_heard() {
    let mut rig = Rig::with(2, 1, |id| Plan::new(id, if id == 1 { BitRate::Kbit125 } else { RATE }));
    rig.world.send(rig.client, std_frame(ECHO + 1, &[]));
    rig.run_for(100);
    assert_eq!((rig.received(), rig.probe(0).heard), (vec![], 0));
    // The port has destroyed 15 attempts and is then error-passive.
    let errors = rig.trace().iter().filter(|event| event.is_error_frame()).count();
    assert_eq!((errors, rig.probe(0).inputs.bus), (15, BusErrorMode::ErrorPassive));
    assert_eq!(rig.probe(1).heard, 1);
}

#[test]
fn two_runs_with_one_seed_are_the_same() {
    let run = |seed| {
        let mut rig = Rig::with(5, seed, |id| Plan::new(id, RATE).beating(Duration::from_millis(7)));
        for node in rig.nodes.clone() {
            rig.world.power(node, false);
        }
        rig.world.power_all(SUPPLY_JITTER);
        for byte in 0..20 {
            rig.command(Command::Store, byte % 5 + 1, &[byte]);
            rig.run_for(13);
        }
        let text: Vec<_> = rig.world.take_events().map(|event| format!("{event:?}\n")).collect();
        assert!(text.len() > 100);
        text.concat()
    };
    assert_eq!(run(7), run(7));
    assert_ne!(run(7), run(8), "the seed decides when devices on one supply start");
}

#[test]
fn a_shutdown_stores_what_waits() {
    let mut rig = Rig::of(2);
    rig.command(Command::Later, 1, b"late");
    rig.run_for(1000);
    assert_eq!(rig.probe(0).stored, []);
    rig.world.flush_all();
    assert_eq!(rig.probe(0).stored.len(), 1);
    assert_eq!(rig.world.now(), after(millis(1010), WRITE_TIME));
}

#[test]
fn a_shutdown_stores_on_a_dead_bus_too() {
    let mut rig = Rig::with(1, 1, |id| Plan::new(id, RATE).beating(Duration::from_millis(10)));
    rig.command(Command::Later, 1, b"late");
    rig.run_for(5);
    rig.world.remove_client_port(rig.client);
    rig.run_for(100);
    assert!(rig.world.port(rig.nodes[0]).pending() > 0);
    rig.world.flush_all();
    assert_eq!(rig.probe(0).stored.iter().map(|stored| stored.1).collect::<Vec<_>>(), [Ok(())]);
    assert!(rig.world.now() <= after(millis(115), FLUSH_PATIENCE + WRITE_TIME));
}

#[test]
fn devices_are_found_by_name() {
    let rig = Rig::of(3);
    assert_eq!(rig.world.find("probe-2"), Some(rig.nodes[1]));
    assert_eq!(rig.world.find("probe-4"), None);
    assert_eq!(rig.world.devices().collect::<Vec<_>>(), rig.nodes);
    assert_eq!(rig.world.device(rig.nodes[2]).and_then(|device| device.node_id()), Some(3));
}

#[test]
fn a_power_cut_planned_for_a_word_takes_the_device_along() {
    let mut rig = Rig::of(1);
    rig.world.memory_mut(rig.nodes[0]).flash_mut().cut_power_after(2);
    rig.command(Command::Store, 1, b"abc");
    rig.run_for(100);
    assert!(!rig.world.is_powered(rig.nodes[0]));
    rig.world.power(rig.nodes[0], true);
    assert_eq!((rig.probe(0).parameters.as_deref(), rig.probe(0).damaged), (None, false));
    rig.command(Command::Store, 1, b"abc");
    rig.run_for(100);
    assert_eq!(rig.probe(0).stored.last().unwrap().1, Ok(()));
}

#[test]
fn the_position_of_a_valve_at_rest_without_power_changes_at_an_event_alone() {
    let mut world = World::new(RATE, 1);
    let valve = world.add("valve", crate::ValveKind::PveaCanopen);
    for _ in 0..2 {
        let limit = after(world.now(), Duration::from_secs(10));
        assert_eq!(world.next_inside(valve, &(100..=200), limit), limit);
        world.power(valve, true);
        world.run_until(after(world.now(), Duration::from_millis(50)));
        world.power(valve, false);
    }
}
