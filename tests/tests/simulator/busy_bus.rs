//! A bus that takes nothing keeps nothing from being stored (SPEC 6).

use hal_sim::{Memory, World};
use protocol_core::controller::BitRate;
use protocol_core::device::pve::{Kind, PveCanopen, Setup};
use protocol_core::memory::RecordKey;
use protocol_core::time::{Duration, Instant};
use tests::Rig;

#[test]
fn save_is_stored_and_its_answer_waits_for_the_bus() {
    let mut valve = Rig::booted();
    assert_eq!(valve.write(0x1017, 0, 2, 100), Ok(()));
    valve.take();
    valve.writes.clear();
    valve.hold_bus(true);
    // A heartbeat that never wins the bus.
    valve.advance(150);
    valve.send("620: 23 10 10 01 73 61 76 65");
    valve.advance(20);
    assert_eq!(valve.writes, [RecordKey::Parameters]);
    valve.expect_nothing();
    valve.hold_bus(false);
    assert_eq!(valve.take(), ["5A0: 60 10 10 01 00 00 00 00", "720: 7F"]);
}

#[test]
fn a_restart_waits_for_the_answer_before_it() {
    let mut valve = Rig::booted();
    valve.hold_bus(true);
    valve.send("620: 40 18 10 01 00 00 00 00");
    valve.send("000: 81 20");
    valve.advance(500);
    valve.hold_bus(false);
    assert_eq!(valve.take(), ["5A0: 43 18 10 01 19 00 00 01", "720: 00", "0A0: 00 00 00 00 00 00 00 00"]);
}

#[test]
fn a_new_valve_alone_on_its_bus_keeps_what_it_was_made_as() {
    let mut world = World::new(BitRate::Kbit250, 0);
    let setup = Setup { node_id: Some(0x17), ..Setup::new(Kind::PveaCanopen) };
    let node = world.add_device(
        "valve",
        move |image, cause, now| Box::new(PveCanopen::power_on(setup, image, cause, now)),
        Memory::in_ram(),
    );
    world.power(node, true);
    world.run_until(Instant::from_ticks(0) + Duration::from_millis(500));
    let image = world.memory_mut(node).read_image();
    for key in [RecordKey::Factory, RecordKey::LocalLayer] {
        assert!(matches!(image.payload(key, 1), Ok(Some(_))), "{key:?}");
    }
}
