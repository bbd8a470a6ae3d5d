//! A power cut at every word write of every operation that stores (SPEC 4.5, 6, 9): the device boots, each record is old
//! or new and never mixed, nothing else is lost, and no error is told.
//!
//! The memory's own tests cut erases, and cut what recovers from a cut.

mod sensor;
mod valve;

use hal_sim::memory::Flash;
use hal_sim::{Memory, NodeId};
use protocol_core::memory::RecordKey::{self, Factory, LocalLayer};
use protocol_core::memory::seal;
use tests::BusRig;

/// The version of all records.
const VERSION: u8 = 1;

/// The payload of each record.
type Records = [Option<Vec<u8>>; RecordKey::ALL.len()];

fn records(flash: &Flash) -> Records {
    let image = Memory::with_flash(flash.clone()).read_image();
    assert!(!image.is_damaged());
    RecordKey::ALL.map(|key| image.payload(key, VERSION).expect("intact").map(<[u8]>::to_vec))
}

/// A product that stores.
struct Product {
    /// A bus with a master and one of them with this memory, switched off.
    with_flash: fn(Flash) -> (BusRig, NodeId),
    /// What it sends when it boots without an error, by its node ID.
    boots: fn(u16) -> Vec<String>,
    /// Error register, serial number, and of each record something, as an SDO request names them.
    objects: &'static [&'static str],
    /// What makes it store, besides the first start.
    operations: &'static [Operation],
}

/// Something that makes a device store.
#[derive(Clone, Copy)]
struct Operation {
    name: &'static str,
    /// What was done with the device before.
    before: fn(&mut BusRig, NodeId),
    /// What is done while the power is cut, after the start or, if `at_start`, with it.
    act: fn(&mut BusRig, NodeId),
    at_start: bool,
    /// What it writes, in this order.
    writes: &'static [RecordKey],
}

const ACT: Operation = Operation { name: "", before: nothing, act: nothing, at_start: false, writes: &[] };

const FIRST_START: Operation = Operation { name: "first start", at_start: true, writes: &[Factory, LocalLayer], ..ACT };

fn nothing(rig: &mut BusRig, _: NodeId) {
    rig.run_for(50);
}

fn node_id(rig: &BusRig, device: NodeId) -> u8 {
    rig.world.device(device).and_then(|device| device.node_id()).unwrap_or(0)
}

/// Writes objects, as far as the power lasts.
fn write_all(rig: &mut BusRig, device: NodeId, values: &[(u16, u8, u8, u32)]) {
    let node_id = node_id(rig, device);
    let _ = values.iter().all(|write| rig.write(node_id, *write));
}

/// Stores by LSS, as far as the power lasts.
fn store_by_lss(rig: &mut BusRig, _: NodeId) {
    rig.send("7E5: 04 01 00 00 00 00 00 00");
    for request in ["11 21 00", "13 00 02", "17 00 00"] {
        rig.ask(&format!("7E5: {request} 00 00 00 00 00"));
    }
}

/// A flash that was never anything but this.
fn flash_with(records: &Records) -> Flash {
    let mut memory = Memory::in_ram();
    for (key, payload) in RecordKey::ALL.into_iter().zip(records) {
        if let Some(payload) = payload {
            memory.store(key, &seal(VERSION, payload).unwrap()).unwrap();
        }
    }
    memory.flash().clone()
}

impl Product {
    /// Switches one with this flash on, its master at the bit rate that it has stored. What was on the bus.
    fn boot(&self, flash: &Flash) -> (BusRig, NodeId, Vec<String>) {
        let (mut rig, device) = (self.with_flash)(flash.clone());
        rig.world.power(device, true);
        rig.world.set_bit_rate(rig.world.port(device).bit_rate());
        let frames = rig.boot(device);
        (rig, device, frames)
    }

    /// What a master sees of what one has stored; it has booted without an error.
    #[track_caller]
    fn observe(&self, flash: &Flash, what: &str) -> Vec<String> {
        let (mut rig, device, frames) = self.boot(flash);
        let node_id = u16::from(node_id(&rig, device));
        assert_eq!(frames, (self.boots)(node_id), "{what}");
        let mut seen = vec![format!("{} bit/s", rig.world.port(device).bit_rate().bits_per_second())];
        for object in self.objects {
            let answer = rig.ask(&format!("{:03X}: 40 {object} 00 00 00 00", 0x600 + node_id));
            seen.push(answer.unwrap_or_else(|| panic!("{what}: no answer about {object}")));
        }
        seen
    }

    /// Does an operation, with the power cut after so many word writes; from the start on, if it acts at the start. What
    /// is in the flash then.
    fn run(&self, operation: Operation, flash: &Flash, cut: u64) -> Flash {
        let (mut rig, device) = (self.with_flash)(flash.clone());
        let plan = |rig: &mut BusRig| rig.world.memory_mut(device).flash_mut().cut_power_after(cut);
        if operation.at_start {
            plan(&mut rig);
        }
        rig.world.power(device, true);
        rig.world.set_bit_rate(rig.world.port(device).bit_rate());
        rig.boot(device);
        if !operation.at_start {
            plan(&mut rig);
        }
        (operation.act)(&mut rig, device);
        rig.world.memory(device).flash().clone()
    }

    /// Does an operation to its end.
    fn run_through(&self, operation: Operation, flash: &Flash) -> Flash {
        self.run(operation, flash, u64::MAX)
    }

    /// One as it leaves the factory, of which `before` was done.
    fn prepared(&self, operation: Operation) -> Flash {
        let (mut rig, device) = (self.with_flash)(Flash::new());
        rig.boot(device);
        (operation.before)(&mut rig, device);
        rig.world.memory(device).flash().clone()
    }

    /// Cuts the power at each word write of an operation: the device starts with what the cut has left, and doing the
    /// operation again does what it does on a flash that was never cut. How many cuts that were.
    fn cut_everywhere(&self, operation: Operation, flash: &Flash) -> u64 {
        let name = operation.name;
        let last = records(&self.run_through(operation, flash));
        // The records before it, and after each of its writes.
        let mut stages = vec![records(flash)];
        for key in operation.writes {
            let mut next = stages.last().unwrap().clone();
            next[key.position()].clone_from(&last[key.position()]);
            stages.push(next);
        }
        assert_eq!(stages.last(), Some(&last), "{name} writes what it says");
        assert!(stages.windows(2).all(|pair| pair[0] != pair[1]), "{name} changes each record");
        let uncut = |stage: &Records| {
            let flash = flash_with(stage);
            (self.observe(&flash, name), records(&self.run_through(operation, &flash)))
        };
        let uncut: Vec<_> = stages.iter().map(uncut).collect();
        for cut in 0.. {
            let mut flash = flash.clone();
            flash.seed_noise(cut);
            let mut left = self.run(operation, &flash, cut);
            if !left.is_dead() {
                assert!(cut >= 4 * operation.writes.len() as u64, "{cut} cuts of {name}");
                return cut;
            }
            left.restore_power();
            let what = format!("{name}, cut after {cut}");
            let found = records(&left);
            let stage = stages.iter().position(|stage| *stage == found);
            let (seen, again) = &uncut[stage.unwrap_or_else(|| panic!("{what}: {found:02X?} of {stages:02X?}"))];
            assert_eq!(self.observe(&left, &what), *seen, "{what}");
            assert!(records(&self.run_through(operation, &left)) == *again, "{what}, and done again");
        }
        unreachable!("uncut it is done")
    }

    /// Cuts the power at each write of each operation. How many cuts that were.
    fn cut_every_write(&self) -> u64 {
        let operations =
            self.operations.iter().map(|operation| self.cut_everywhere(*operation, &self.prepared(*operation)));
        operations.sum::<u64>() + self.cut_everywhere(FIRST_START, &Flash::new())
    }
}

#[test]
fn a_cut_at_any_write_of_any_operation() {
    let cuts = valve::PRODUCT.cut_every_write();
    assert!(cuts > 140, "{cuts} cuts");
}

#[test]
fn a_cut_at_any_write_of_any_operation_of_a_sensor() {
    let cuts = sensor::PRODUCT.cut_every_write();
    assert!(cuts > 120, "{cuts} cuts");
}
