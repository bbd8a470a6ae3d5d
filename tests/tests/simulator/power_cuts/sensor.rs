//! What makes an angle sensor store.

use hal_sim::memory::Flash;
use hal_sim::{Memory, NodeId};
use protocol_core::controller::BitRate;
use protocol_core::device::Inputs;
use protocol_core::device::hat::{Hat, Kind, Setup};
use protocol_core::encoder::Shaft;
use protocol_core::memory::Image;
use protocol_core::memory::RecordKey::{self, Application, LocalLayer, Parameters};
use tests::BusRig;

use super::{ACT, Operation, Product, store_by_lss, write_all};

pub(super) const PRODUCT: Product = Product {
    with_flash,
    boots: |node_id| vec![format!("{:03X}: 00", 0x700 + node_id)],
    objects: &[
        "01 10 00", "18 10 04", "29 10 01", "14 10 00", "00 18 05", "03 60 00", "09 65 00", "01 20 02", "02 20 02",
    ],
    operations: &OPERATIONS,
};

const BOTH: &[RecordKey] = &[Parameters, Application];

const OPERATIONS: [Operation; 10] = [
    Operation { name: "first save", act: save_all, writes: BOTH, ..ACT },
    stored("save", save_all, BOTH),
    stored("save of communication", |rig, sensor| save(rig, sensor, 2), &[Parameters]),
    stored("save of application", |rig, sensor| save(rig, sensor, 3), &[Application]),
    stored("save of LSS", |rig, sensor| save(rig, sensor, 4), &[LocalLayer]),
    stored("load", |rig, sensor| load(rig, sensor, 1), BOTH),
    stored("load of communication", |rig, sensor| load(rig, sensor, 2), &[Parameters]),
    stored("load of application", |rig, sensor| load(rig, sensor, 3), &[Application]),
    stored("load of LSS", |rig, sensor| load(rig, sensor, 4), &[LocalLayer]),
    stored("LSS store", store_by_lss, &[LocalLayer]),
];

/// An operation of a sensor that has stored other values of every group.
const fn stored(name: &'static str, act: fn(&mut BusRig, NodeId), writes: &'static [RecordKey]) -> Operation {
    Operation { name, before: save_others, act, writes, ..ACT }
}

fn with_flash(flash: Flash) -> (BusRig, NodeId) {
    let mut rig = BusRig::default();
    let setup = Setup { bit_rate: Some(BitRate::Kbit250), ..Setup::new(Kind::Hat1000) };
    let factory = move |image: &Image, cause, now| Box::new(Hat::power_on(setup, image, cause, now)) as _;
    let sensor = rig.world.add_device("sensor", factory, Memory::with_flash(flash));
    rig.world.set_inputs(sensor, Inputs::encoder(Shaft::at(9_000)));
    (rig, sensor)
}

/// Changes every group and stores one, or two.
fn save(rig: &mut BusRig, sensor: NodeId, sub: u8) {
    let save = (0x1010, sub, 4, u32::from_le_bytes(*b"save"));
    let values =
        [(0x1029, 1, 1, 2), (0x1800, 5, 2, 222), (0x6003, 0, 4, 2222), (0x2001, 2, 1, 0x22), (0x2002, 2, 1, 4)];
    write_all(rig, sensor, &[&values[..], &[save]].concat());
}

fn save_all(rig: &mut BusRig, sensor: NodeId) {
    save(rig, sensor, 1);
}

/// Stores other values of every group.
fn save_others(rig: &mut BusRig, sensor: NodeId) {
    let save = |sub| (0x1010, sub, 4, u32::from_le_bytes(*b"save"));
    let values = [(0x1029, 1, 1, 1), (0x1800, 5, 2, 111), (0x6003, 0, 4, 1111), (0x2001, 2, 1, 0x11), save(1), save(4)];
    write_all(rig, sensor, &values);
}

fn load(rig: &mut BusRig, sensor: NodeId, sub: u8) {
    write_all(rig, sensor, &[(0x1011, sub, 4, u32::from_le_bytes(*b"load"))]);
}
