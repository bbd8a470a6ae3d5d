//! Firmware in Rust, tested against a valve in virtual time: `cargo test --package hal-sim --test controller`.
use embedded_can::{Frame, Id, StandardId, nb::Can};
use hal_sim::{BitRate, Change, Duration, ValveKind, World};

/// The firmware: drives the valve at node 0x20 over any CAN controller.
struct Controller<C>(C);

impl<C: Can> Controller<C> {
    fn send(&mut self, id: u16, data: &[u8]) {
        let id = StandardId::new(id).unwrap();
        self.0.transmit(&Frame::new(id, data).unwrap()).unwrap();
    }
    /// Sends a set-point, ±16384, and returns the codes of the received EMCY frames.
    fn cycle(&mut self, set_point: i16) -> Vec<u16> {
        let [low, high] = set_point.to_le_bytes();
        self.send(0x220, &[0x0F, 0x00, low, high]); // RPDO: control word "active", set-point
        let received = std::iter::from_fn(|| self.0.receive().ok());
        let emergencies = received.filter(|frame| frame.id() == Id::Standard(StandardId::new(0x0A0).unwrap()));
        emergencies.map(|frame| u16::from_le_bytes([frame.data()[0], frame.data()[1]])).collect()
    }
}

#[test]
fn the_spool_follows_until_the_supply_fails() {
    let mut world = World::new(BitRate::Kbit250, 1); // the seed: each run is the same
    let valve = world.add("valve", ValveKind::PveaCanopen);
    let mut controller = Controller(world.client("controller"));
    world.power(valve, true);
    world.run_for(Duration::from_millis(100));
    controller.send(0x000, &[0x01, 0x20]); // NMT: start node 0x20
    let mut cycle = |world: &mut World| {
        world.run_for(Duration::from_millis(100));
        controller.cycle(8192)
    };
    (0..10).for_each(|_| drop(cycle(&mut world))); // DISABLED, HOLD, ACTIVE, and the spool moves
    assert_eq!(world.view(valve).unwrap().position, 8192);
    world.set_plant(valve, Change::SupplyMv(8_000)).unwrap();
    assert_eq!((0..25).flat_map(|_| cycle(&mut world)).collect::<Vec<_>>(), [0x3412]);
}
