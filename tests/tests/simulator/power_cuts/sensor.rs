//! What makes an angle sensor store.

use hal_sim::memory::Flash;
use hal_sim::{Memory, NodeId};
use protocol_core::controller::BitRate;
use protocol_core::device::Inputs;
use protocol_core::device::hat::{Hat, Kind, Setup};
use protocol_core::encoder::Shaft;
use protocol_core::memory::Image;
use protocol_core::memory::RecordKey::{self, Application, LocalLayer, Parameters};
use tests::Bench;

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
    stored("save of communication", |bench, sensor| save(bench, sensor, 2), &[Parameters]),
    stored("save of application", |bench, sensor| save(bench, sensor, 3), &[Application]),
    stored("save of LSS", |bench, sensor| save(bench, sensor, 4), &[LocalLayer]),
    stored("load", |bench, sensor| load(bench, sensor, 1), BOTH),
    stored("load of communication", |bench, sensor| load(bench, sensor, 2), &[Parameters]),
    stored("load of application", |bench, sensor| load(bench, sensor, 3), &[Application]),
    stored("load of LSS", |bench, sensor| load(bench, sensor, 4), &[LocalLayer]),
    stored("LSS store", store_by_lss, &[LocalLayer]),
];

/// An operation of a sensor that has stored other values of every group.
const fn stored(name: &'static str, act: fn(&mut Bench, NodeId), writes: &'static [RecordKey]) -> Operation {
    Operation { name, before: save_others, act, writes, ..ACT }
}

fn with_flash(flash: Flash) -> (Bench, NodeId) {
    let mut bench = Bench::default();
    let setup = Setup { bit_rate: Some(BitRate::Kbit250), ..Setup::new(Kind::Hat1000) };
    let factory = move |image: &Image, cause, now| Box::new(Hat::power_on(setup, image, cause, now)) as _;
    let sensor = bench.world.add_device("sensor", factory, Memory::with_flash(flash));
    bench.world.set_inputs(sensor, Inputs::encoder(Shaft::at(9_000)));
    (bench, sensor)
}

/// Changes every group and stores one, or two.
fn save(bench: &mut Bench, sensor: NodeId, sub: u8) {
    let save = (0x1010, sub, 4, u32::from_le_bytes(*b"save"));
    let values =
        [(0x1029, 1, 1, 2), (0x1800, 5, 2, 222), (0x6003, 0, 4, 2222), (0x2001, 2, 1, 0x22), (0x2002, 2, 1, 4)];
    write_all(bench, sensor, &[&values[..], &[save]].concat());
}

fn save_all(bench: &mut Bench, sensor: NodeId) {
    save(bench, sensor, 1);
}

/// Stores other values of every group.
fn save_others(bench: &mut Bench, sensor: NodeId) {
    let save = |sub| (0x1010, sub, 4, u32::from_le_bytes(*b"save"));
    let values = [(0x1029, 1, 1, 1), (0x1800, 5, 2, 111), (0x6003, 0, 4, 1111), (0x2001, 2, 1, 0x11), save(1), save(4)];
    write_all(bench, sensor, &values);
}

fn load(bench: &mut Bench, sensor: NodeId, sub: u8) {
    write_all(bench, sensor, &[(0x1011, sub, 4, u32::from_le_bytes(*b"load"))]);
}
