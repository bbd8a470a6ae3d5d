//! When what an ISOBUS valve sends is on the bus (SPEC 5), on a bus that takes its time.

use hal_sim::bus::FrameBits;
use hal_sim::{ClientPortId, Memory, World};
use protocol_core::controller::BitRate;
use protocol_core::device::pve::{Kind, PveIsobus, Setup};
use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};
use tests::frame;

/// What arbitration prefers to AVEF, as long as a frame can be.
const URGENT: &str = "00FF0027: 55 AA 55 AA 55 AA 55 AA";
/// What AVEF is preferred to.
const UNHURRIED: &str = "1CFF0028: 55 AA 55 AA 55 AA 55 AA";
/// The cycle of AVEF.
const CYCLE: Duration = Duration::from_millis(100);
/// How late its first bit may be.
const LATE: Duration = Duration::from_millis(1);

/// A valve whose claim is through and whose first AVEF was on an empty bus; when that was due.
fn claimed() -> (World, ClientPortId, Instant) {
    let mut world = World::new(BitRate::Kbit250, 0);
    let tractor = world.add_client_port("tractor");
    let setup = Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) };
    let node = world.add_device(
        "valve",
        move |image, cause, now| Box::new(PveIsobus::power_on(setup, image, cause, now)),
        Memory::in_ram(),
    );
    world.power(node, true);
    world.run_until(Instant::from_millis(300));
    let avef = avefs(&mut world, tractor);
    assert_eq!(avef.len(), 1);
    (world, tractor, avef[0])
}

/// When the first bits of the AVEFs were on the bus.
fn avefs(world: &mut World, tractor: ClientPortId) -> Vec<Instant> {
    let began = |(end, frame): (Instant, Frame)| {
        let bits = u64::from(FrameBits::of(&frame).on_wire());
        Instant::from_micros(end.as_micros() - bits * 4)
    };
    let heard = world.take_received(tractor).filter(|(_, heard)| heard.id() == frame("0CFE1383: 00").id());
    heard.map(began).collect()
}

#[test]
fn avef_is_late_by_one_frame_at_the_most() {
    let (mut world, tractor, mut due) = claimed();
    for text in [URGENT, UNHURRIED] {
        // The other frame begins so long before AVEF is due, or at the same instant.
        for before in (0..700).step_by(23) {
            due = after(due, CYCLE);
            world.run_until(Instant::from_micros(due.as_micros() - before));
            world.send(tractor, frame(text));
            world.run_until(Instant::from_micros(due.as_micros() + 3000));
            let began = avefs(&mut world, tractor);
            assert_eq!(began.len(), 1, "{text}, {before} us before");
            assert!(
                began[0] >= due && since(began[0], due) <= LATE,
                "{text}, {before} us before: {began:?}, due {due}"
            );
        }
    }
}

#[test]
fn avef_goes_before_what_waits_with_less_priority() {
    let (mut world, tractor, due) = claimed();
    for cycle in 1..=50 {
        let due = after(due, CYCLE * cycle);
        world.run_until(Instant::from_micros(due.as_micros() - 1_000));
        for _ in 0..10 {
            world.send(tractor, frame(UNHURRIED));
        }
        world.run_until(Instant::from_micros(due.as_micros() + 10_000));
        let began = avefs(&mut world, tractor);
        assert_eq!(began.len(), 1, "cycle {cycle}");
        assert!(since(began[0], due) <= LATE, "cycle {cycle}: {began:?}, due {due}");
    }
}
