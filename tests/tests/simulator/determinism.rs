//! A run depends on nothing but what is done and the seed: the traces of two runs are equal to the last byte.

use hal_sim::Memory;
use hal_sim::bus::BitErrors;
use hal_sim::log::{ErrorClass, Timestamp, write_error, write_frame};
use hal_sim::world::{EventKind, SUPPLY_JITTER};
use protocol_core::device::pve::{Kind, Setup};
use protocol_core::time::Duration;
use tests::BusRig;

const VALVES: u8 = 20;

/// A busy second of 20 valves on one supply, driven by SYNC, with bit errors, faults, stores and power cuts. As
/// `candump -L`.
fn trace(seed: u64, jitter: Duration) -> String {
    let mut rig = BusRig::with_seed(seed);
    let valves: Vec<_> = (1..=VALVES)
        .map(|number| {
            let kind = if number % 2 == 0 { Kind::PveaCanopen } else { Kind::PveoCanopen };
            let setup = Setup { node_id: Some(number), serial: Some(u32::from(number)), ..Setup::new(kind) };
            rig.add(setup, Memory::in_ram())
        })
        .collect();
    rig.world.record_events(true);
    rig.world.power_all(jitter);
    rig.run_for(100);
    rig.world.inject(BitErrors::one_in(20_000, 1).expect("not zero"));
    for number in 1..=u16::from(VALVES) {
        rig.send(&format!("{:03X}: 2F 00 18 02 01 00 00 00", 0x600 + number));
    }
    rig.send("000: 01 00");
    for cycle in 0..50_u16 {
        rig.send("080:");
        for number in 1..=u16::from(VALVES) {
            let [low, high] = (cycle * 300 + number).to_le_bytes();
            rig.send(&format!("{:03X}: 0F 00 {low:02X} {high:02X}", 0x200 + number));
        }
        let valve = valves[usize::from(cycle % 7)];
        match cycle % 10 {
            3 => rig.send(&format!("{:03X}: 23 10 10 01 73 61 76 65", 0x600 + cycle % 20 + 1)),
            5 => rig.sense(valve, |inputs| inputs.internal_fault = !inputs.internal_fault),
            7 => rig.world.power(valve, cycle % 20 == 7),
            _ => {}
        }
        rig.run_for(20);
    }
    let start = Timestamp::from_micros(1_700_000_000_000_000);
    let mut trace = String::new();
    for event in rig.world.take_events() {
        match &event.what {
            EventKind::Frame { frame, .. } => write_frame(&mut trace, start.at(event.at), "pve0", frame),
            EventKind::ErrorFrame { .. } => write_error(&mut trace, start.at(event.at), "pve0", ErrorClass::BusError),
            _ => continue,
        }
        trace.push('\n');
    }
    trace
}

#[test]
fn the_same_seed_gives_the_same_trace() {
    let (one, other) = (trace(7, SUPPLY_JITTER), trace(7, SUPPLY_JITTER));
    let count = one.lines().count();
    assert!(count > 1500, "{count} frames");
    assert!(one.contains("20000080#"), "some are destroyed");
    assert!(one == other);
}

#[test]
fn the_seed_decides_when_each_valve_starts() {
    let boot_ups = |seed, jitter| -> Vec<String> {
        let trace = trace(seed, jitter);
        let boot_ups: Vec<_> = trace.lines().filter(|line| line.contains(" 7") && line.ends_with("#00")).collect();
        boot_ups[..usize::from(VALVES)].iter().filter_map(|line| line.split(' ').nth(2)).map(str::to_owned).collect()
    };
    let (one, other) = (boot_ups(1, SUPPLY_JITTER), boot_ups(2, SUPPLY_JITTER));
    assert_ne!(one, other);
    // All at once they come in the order of their identifiers, whatever the seed.
    let at_once = boot_ups(1, Duration::from_ticks(0));
    assert!(at_once.is_sorted());
    assert_ne!(one, at_once);
    assert_eq!(at_once, boot_ups(2, Duration::from_ticks(0)));
}
