//! What makes a valve store.

use hal_sim::NodeId;
use protocol_core::memory::RecordKey::{FaultLog, LocalLayer, Parameters, RestoreFlag};
use tests::BusRig;

use super::{ACT, Operation, Product, node_id, store_by_lss, write_all};

pub(super) const PRODUCT: Product = Product {
    with_flash: BusRig::with_flash,
    boots: |node_id| {
        vec![format!("{:03X}: 00", 0x700 + node_id), format!("{:03X}:{}", 0x080 + node_id, " 00".repeat(8))]
    },
    objects: &["01 10 00", "18 10 04", "28 10 01", "00 14 01", "00 18 01", "00 18 02", "53 60 00", "24 20 00"],
    operations: &OPERATIONS,
};

const OPERATIONS: [Operation; 9] = [
    Operation { name: "first save", act: save_two, writes: &[Parameters], ..ACT },
    Operation { name: "save", before: save_one, act: save_two, writes: &[Parameters], ..ACT },
    Operation { name: "load", before: save_one, act: load, writes: &[RestoreFlag], ..ACT },
    Operation {
        name: "load at the next start",
        before: save_and_load,
        at_start: true,
        writes: &[Parameters, RestoreFlag],
        ..ACT
    },
    Operation { name: "LSS store", before: save_one, act: store_by_lss, writes: &[LocalLayer], ..ACT },
    Operation { name: "UDS node ID", before: save_one, act: write_node_id, writes: &[LocalLayer], ..ACT },
    Operation { name: "fault log", before: save_one, act: fault, writes: &[FaultLog], ..ACT },
    Operation { name: "fault log before a restart", before: fault, act: fault_and_reset, writes: &[FaultLog], ..ACT },
    Operation { name: "clear counters", before: fault, act: clear_counters, writes: &[FaultLog], ..ACT },
];

/// Writes parameters and stores them, as far as the power lasts.
fn save(rig: &mut BusRig, valve: NodeId, parameters: &[(u16, u8, u8, u32)]) {
    let save = (0x1010, 1, 4, u32::from_le_bytes(*b"save"));
    write_all(rig, valve, &[parameters, &[save]].concat());
}

fn save_one(rig: &mut BusRig, valve: NodeId) {
    save(rig, valve, &[(0x1028, 1, 4, 0xA1), (0x1800, 2, 1, 11), (0x6053, 0, 4, u32::from_le_bytes(*b"one "))]);
}

fn save_two(rig: &mut BusRig, valve: NodeId) {
    save(rig, valve, &[(0x1028, 1, 4, 0xA2), (0x1800, 2, 1, 22), (0x6053, 0, 4, u32::from_le_bytes(*b"two "))]);
}

fn load(rig: &mut BusRig, valve: NodeId) {
    write_all(rig, valve, &[(0x1011, 1, 4, u32::from_le_bytes(*b"load"))]);
}

fn save_and_load(rig: &mut BusRig, valve: NodeId) {
    save_one(rig, valve);
    load(rig, valve);
}

fn write_node_id(rig: &mut BusRig, valve: NodeId) {
    let id = 0x1BC0_0000 | 0xF1 << 11 | u32::from(node_id(rig, valve));
    rig.ask(&format!("{id:08X}: 04 2E 10 01 22"));
}

fn blink(rig: &mut BusRig, valve: NodeId) {
    for internal_fault in [true, false] {
        rig.sense(valve, |inputs| inputs.internal_fault = internal_fault);
    }
}

/// A fault that comes and goes, and the time until it is logged.
fn fault(rig: &mut BusRig, valve: NodeId) {
    blink(rig, valve);
    rig.run_for(700);
}

fn fault_and_reset(rig: &mut BusRig, valve: NodeId) {
    blink(rig, valve);
    rig.send("000: 81 00");
    rig.run_for(100);
}

fn clear_counters(rig: &mut BusRig, valve: NodeId) {
    write_all(rig, valve, &[(0x1011, 5, 4, u32::from_le_bytes(*b"pkds"))]);
}
