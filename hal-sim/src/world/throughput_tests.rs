//! Long runs of full buses: that nothing is lost, and, with `cargo test --release -- --ignored`, how long they take.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant as WallClock;

use protocol_core::controller::BitRate;
use protocol_core::frame::{Frame, standard};
use protocol_core::time::{Duration, Instant, after};

use super::probe::{ECHO, Plan, Probe};
use super::*;

/// 100 devices with a heartbeat a second at 500 kbit/s: the frames on the bus, and the deliveries.
fn heartbeats(time: Duration) -> (u64, u64) {
    let mut world = World::new(BitRate::Kbit500, 1);
    for id in 1..=100 {
        let plan = Plan::new(id, BitRate::Kbit500).beating(Duration::from_secs(1));
        world.add_device(&format!("probe-{id}"), plan.factory(), Memory::in_ram());
    }
    world.power_all(Duration::from_ticks(0));
    let frames = Arc::new(AtomicU64::new(0));
    let counter = frames.clone();
    world.set_observer(Box::new(move |event| {
        assert!(event.frame().is_some(), "an error frame on a healthy bus: {event:?}");
        counter.fetch_add(1, Ordering::Relaxed);
    }));
    world.run_until(after(Instant::from_ticks(0), time));
    let heard = world.devices().map(|node| u64::from(world.device_as::<Probe>(node).unwrap().heard)).sum();
    (frames.load(Ordering::Relaxed), heard)
}

/// 20 devices at 250 kbit/s, polled by a client so that the bus is loaded to some 80 %: the load, the echoes missing.
fn echoes(time: Duration) -> (u8, u64) {
    let mut world = World::new(BitRate::Kbit250, 1);
    for id in 1..=20 {
        world.add_device(&format!("probe-{id}"), Plan::new(id, BitRate::Kbit250).factory(), Memory::in_ram());
    }
    let tap = world.add_tap("master");
    world.power_all(SUPPLY_JITTER);
    let end = after(Instant::from_ticks(0), time);
    let mut missing = 0;
    let mut next = Instant::from_millis(10);
    while next < end {
        world.run_until(next);
        missing -= world.take_received(tap).count() as u64;
        for id in 1..=20 {
            world.send(tap, Frame::full(standard(ECHO + id).into(), [0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xDE, 0xF1]));
        }
        missing += 20;
        next = after(next, Duration::from_micros(22_300));
    }
    let load = world.load();
    world.run_until(after(end, Duration::from_millis(100)));
    (load, missing - world.take_received(tap).count() as u64)
}

#[test]
fn every_heartbeat_reaches_everybody() {
    assert_eq!(heartbeats(Duration::from_millis(10_500)), (1100, 1100 * 99));
}

#[test]
fn every_echo_comes_back_on_a_loaded_bus() {
    let (load, missing) = echoes(Duration::from_secs(5));
    assert!((78..=82).contains(&load), "{load} %");
    assert_eq!(missing, 0);
}

#[test]
#[ignore = "a measurement: run with --release"]
fn an_hour_of_heartbeats_takes_less_than_three_seconds() {
    let start = WallClock::now();
    let counts = heartbeats(Duration::from_secs(3600 - 1) + Duration::from_millis(500));
    let wall = start.elapsed();
    println!("an hour of 100 heartbeats: {wall:?}");
    assert_eq!(counts, (360_000, 360_000 * 99));
    assert!(wall.as_secs_f64() < 3.0, "{wall:?}");
}

#[test]
#[ignore = "a measurement: run with --release"]
fn ten_minutes_of_a_loaded_bus_take_less_than_thirty_seconds() {
    let start = WallClock::now();
    let (load, missing) = echoes(Duration::from_secs(600));
    let wall = start.elapsed();
    println!("ten minutes at {load} %: {wall:?}");
    assert_eq!(missing, 0);
    assert!(wall.as_secs_f64() < 30.0, "{wall:?}");
}
