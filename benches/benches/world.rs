//! How fast virtual time passes, in seconds of this machine: hundreds of valves, a busy bus.
//!
//! Seconds of processor time: what else the machine does at the moment does not count.
//! Prints a line for each scene and fails when one takes longer than its limit.

use std::process::ExitCode;
use std::time::Duration as WallTime;

use hal_sim::{Memory, World};
use protocol_core::controller::BitRate;
use protocol_core::device::pve::{Kind, PveCanopen, Setup};
use protocol_core::frame::{Frame, standard};
use protocol_core::time::{Duration, Instant, after};
use rustix::time::{ClockId, clock_gettime};

/// A world of so many valves at node IDs 1, 2, 3 …, all at this bit rate, powered.
fn valves(count: u8, bit_rate: BitRate) -> World {
    let mut world = World::new(bit_rate, 0);
    for node_id in 1..=count {
        let setup = Setup { kind: Kind::PveaCanopen, node_id: Some(node_id), serial: Some(node_id.into()) };
        let memory = Memory::in_ram();
        world.add_device(
            &format!("valve-{node_id}"),
            move |image, cause, now| Box::new(PveCanopen::power_on(setup, image, cause, now)),
            memory,
        );
    }
    world
}

fn main() -> ExitCode {
    let scenes: [(&str, fn(), WallTime); 2] = [
        ("100 valves, heartbeats of 1 s, 500 kbit/s, 1 h of virtual time", heartbeats, WallTime::from_secs(3)),
        ("20 valves driven by SYNC at 80 % load, 10 min of virtual time", sync_driven, WallTime::from_secs(30)),
    ];
    let mut in_time = true;
    for (name, scene, limit) in scenes {
        let start = processor_time();
        scene();
        let took = processor_time().saturating_sub(start);
        println!("{name}: {:.2} s, limit {} s", took.as_secs_f64(), limit.as_secs());
        in_time &= took <= limit;
    }
    if in_time { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What this thread has used so far.
fn processor_time() -> WallTime {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    WallTime::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// An hour of 100 valves that only heartbeat.
fn heartbeats() {
    let mut world = valves(100, BitRate::Kbit250);
    world.power_all(Duration::from_millis(5));
    let master = world.add_tap("master");
    world.run_until(Instant::from_millis(500));
    switch_to_500k(&mut world, master);
    for node_id in 1..=100 {
        let write = [0x2B, 0x17, 0x10, 0x00, 0xE8, 0x03, 0, 0];
        world.send(master, Frame::full(standard(0x600 | node_id).into(), write));
    }
    let begin = world.now();
    world.take_received(master).for_each(drop);
    world.run_until(after(begin, Duration::from_secs(3600)));
    let frames = world.take_received(master).count();
    assert!((360_000..=361_000).contains(&frames), "{frames} frames");
}

/// All valves to 500 kbit/s, by LSS, as in use case 5.
fn switch_to_500k(world: &mut World, master: hal_sim::TapId) {
    for text in
        ["000: 02 00", "7E5: 04 01 00 00 00 00 00 00", "7E5: 13 00 02 00 00 00 00 00", "7E5: 15 32 00 00 00 00 00 00"]
    {
        world.send(master, text.parse().expect("a frame"));
    }
    let step = Duration::from_millis(75);
    world.run_until(after(world.now(), step));
    world.set_bit_rate(BitRate::Kbit500);
    world.run_until(after(world.now(), step));
    for text in ["7E5: 04 00 00 00 00 00 00 00", "000: 80 00"] {
        world.send(master, text.parse().expect("a frame"));
    }
}

/// Ten minutes of 20 valves that answer every SYNC; the rest of the load is foreign.
fn sync_driven() {
    let mut world = valves(20, BitRate::Kbit250);
    world.power_all(Duration::from_millis(5));
    let master = world.add_tap("master");
    world.run_until(Instant::from_millis(100));
    for node_id in 1..=20 {
        let write = [0x2F, 0x00, 0x18, 0x02, 1, 0, 0, 0];
        world.send(master, Frame::full(standard(0x600 | node_id).into(), write));
    }
    world.send(master, "000: 01 00".parse().expect("a frame"));
    world.run_until(Instant::from_millis(500));
    world.take_received(master).for_each(drop);
    let sync: Frame = "080:".parse().expect("a frame");
    let period = Duration::from_micros(8_800);
    let cycles = 600_000_000 / period.as_micros();
    let mut load = 0;
    for _ in 0..cycles {
        world.send(master, sync);
        world.run_until(after(world.now(), period));
        load = load.max(world.load());
    }
    let frames = u64::try_from(world.take_received(master).count()).expect("a number");
    assert_eq!(frames, cycles * 20, "one TPDO of every valve for every SYNC");
    assert!((75..=85).contains(&load), "{load} % load");
}
