//! The flash fails at any one word write or erase of an operation that stores (SPEC 4.2, 4.4, 6, 7): the client is
//! told, the internal error is raised, the old values stay; or it went well in spite of it.

use hal_sim::memory::{Flash, TornErase};
use hal_sim::{Memory, NodeId};
use protocol_core::actuator::Color;
use protocol_core::memory::RecordKey::{self, Factory, FaultLog, LocalLayer, Parameters, RestoreFlag};
use protocol_core::memory::seal;
use tests::BusRig;

use super::records::{VERSION, records, store_again, wear};

/// A request, what it is answered with, and what when the memory fails; the record.
const REQUESTS: [(&str, &str, &str, RecordKey); 5] = [
    ("620: 23 10 10 01 73 61 76 65", "5A0: 60 10 10 01 00 00 00 00", "5A0: 80 10 10 01 00 00 06 06", Parameters),
    ("620: 23 11 10 01 6C 6F 61 64", "5A0: 60 11 10 01 00 00 00 00", "5A0: 80 11 10 01 00 00 06 06", RestoreFlag),
    ("620: 23 11 10 05 70 6B 64 73", "5A0: 60 11 10 05 00 00 00 00", "5A0: 80 11 10 05 00 00 06 06", FaultLog),
    ("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00", "7E4: 17 02 00 00 00 00 00 00", LocalLayer),
    ("1BC78820: 04 2E 10 01 22", "1BC408F1: 03 6E 10 01", "1BC408F1: 03 7F 2E 72", LocalLayer),
];

/// A valve that has something else to store than its memory holds: a parameter, a counter, an LSS node ID.
fn prepared(flash: &Flash) -> (BusRig, NodeId) {
    let (mut rig, valve) = BusRig::with_flash(flash.clone());
    rig.boot(valve);
    assert!(rig.write(0x20, (0x1800, 2, 1, 99)));
    rig.send("7E5: 04 01 00 00 00 00 00 00");
    rig.exchange("7E5: 11 21 00 00 00 00 00 00", "7E4: 11 00 00 00 00 00 00 00");
    (rig, valve)
}

/// A valve with "save" done and a fault logged.
fn stored() -> Flash {
    let (mut rig, valve) = BusRig::booted();
    assert!(rig.write(0x20, (0x1010, 1, 4, u32::from_le_bytes(*b"save"))));
    for internal_fault in [true, false] {
        rig.sense(valve, |inputs| inputs.internal_fault = internal_fault);
    }
    rig.run_for(1000);
    rig.world.memory(valve).flash().clone()
}

/// A flash so full that whatever is stored has to empty a sector.
fn full() -> Flash {
    let mut memory = Memory::with_flash(stored());
    wear(&mut memory);
    // Records of two lengths leave any rest.
    for longer in 0..5 {
        let mut memory = Memory::with_flash(memory.flash().clone());
        for _ in 0..longer {
            store_again(&mut memory, Factory);
        }
        loop {
            let before = memory.flash().clone();
            store_again(&mut memory, LocalLayer);
            if memory.flash().erases() > 0 {
                let mut shortest = Memory::with_flash(before.clone());
                shortest.store(RestoreFlag, &seal(VERSION, &[1]).unwrap()).unwrap();
                if shortest.flash().erases() > 0 {
                    return before;
                }
                break;
            }
        }
    }
    panic!("no such flash");
}

/// Every failure of one request; how many were told, and how many did no harm.
fn fail_everywhere(flash: &Flash, (request, done, failed, key): (&str, &str, &str, RecordKey)) -> (u32, u32) {
    let before = records(flash);
    let (mut told, mut harmless) = (0, 0);
    for failure in 0.. {
        let (mut rig, valve) = prepared(flash);
        let flash = rig.world.memory_mut(valve).flash_mut();
        flash.set_torn_erase(TornErase::ALL[failure as usize % 5]);
        flash.seed_noise(failure);
        flash.fail_once_after(failure);
        let operations = flash.word_writes() + flash.erases();
        rig.send(request);
        rig.run_for(100);
        let heard = rig.take();
        let found = records(rig.world.memory(valve).flash());
        let what = format!("{request}, failure {failure}: {heard:?}");
        if heard == [done] {
            let changed: Vec<_> =
                RecordKey::ALL.into_iter().filter(|key| found[key.position()] != before[key.position()]).collect();
            assert_eq!(changed, [key], "{what}");
            let flash = rig.world.memory(valve).flash();
            if flash.word_writes() + flash.erases() - operations < failure {
                return (told, harmless);
            }
            harmless += 1;
            continue;
        }
        assert!(heard.len() == 2 && heard.contains(&failed.to_owned()), "{what}");
        assert!(heard.iter().any(|frame| frame.starts_with("0A0: 00 10 01 02")), "{what}");
        assert!(found == before, "{what}");
        assert_eq!(rig.outputs(valve).led.color, Color::Red, "{what}");
        told += 1;
        // Asked again, all is well.
        rig.send(request);
        rig.run_for(100);
        let heard = rig.take();
        assert!(heard.contains(&done.to_owned()), "{what}, then {heard:?}");
        assert!(heard.contains(&"0A0: 00 00 00 00 00 00 00 00".to_owned()), "{what}, then {heard:?}");
        let found = records(rig.world.memory(valve).flash());
        assert!(found[key.position()] != before[key.position()], "{what}");
    }
    unreachable!("it ends when nothing fails")
}

#[test]
fn a_failure_at_any_write_of_a_request() {
    let flash = stored();
    for request in REQUESTS {
        let (told, harmless) = fail_everywhere(&flash, request);
        assert!(told >= 4, "{told} told, {harmless} harmless, {request:?}");
    }
}

#[test]
fn a_failure_at_any_write_or_erase_of_a_request_that_empties_a_sector() {
    let flash = full();
    for request in REQUESTS {
        let (told, harmless) = fail_everywhere(&flash, request);
        assert!(told >= 50, "{told} told, {harmless} harmless, {request:?}");
    }
}

#[test]
fn a_memory_that_takes_nothing() {
    for (request, done, failed, _) in REQUESTS {
        let (mut rig, valve) = prepared(&stored());
        let image = rig.world.memory(valve).flash().image();
        rig.world.memory_mut(valve).set_write_fails(true);
        rig.send(request);
        rig.run_for(100);
        assert!(rig.take().contains(&failed.to_owned()), "{request}");
        assert!(rig.world.memory(valve).flash().image() == image, "{request}");
        // The fault itself cannot be logged either, and is told once for all that.
        rig.run_for(30_000);
        assert_eq!(rig.take(), [""; 0], "{request}");
        // A start finds the old values, and no fault: nothing is damaged.
        rig.world.power(valve, false);
        assert_eq!(rig.boot(valve), ["720: 00", "0A0: 00 00 00 00 00 00 00 00"], "{request}");
        assert_eq!(rig.read(0x20, 0x1800, 2), Some(0xFF), "{request}");
        rig.world.memory_mut(valve).set_write_fails(false);
        rig.send("7E5: 04 01 00 00 00 00 00 00");
        rig.exchange(request, done);
    }
}
