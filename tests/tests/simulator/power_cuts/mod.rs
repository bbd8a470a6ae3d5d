//! A power cut at every word write and every erase of every operation that stores (SPEC 4.5, 6, 9): the device boots,
//! each record is old or new and never mixed, nothing else is lost, and no error is told.

mod sensor;
mod valve;

use hal_sim::memory::{Flash, TornErase};
use hal_sim::{Memory, NodeId};
use protocol_core::memory::RecordKey::{self, Factory, LocalLayer};
use protocol_core::memory::seal;
use tests::BusRig;

use super::records::{Records, VERSION, records, store_again, wear};

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
    /// Whether doing it again stores the same again.
    repeatable: bool,
}

const ACT: Operation =
    Operation { name: "", before: nothing, act: nothing, at_start: false, writes: &[], repeatable: true };

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

    /// Does an operation, with the power cut after so many word writes and erases; from the start on, if `at_start`.
    /// What is in the flash then.
    fn run(&self, operation: Operation, flash: &Flash, cut: u64, at_start: bool) -> Flash {
        let (mut rig, device) = (self.with_flash)(flash.clone());
        let plan = |rig: &mut BusRig| rig.world.memory_mut(device).flash_mut().cut_power_after(cut);
        if at_start {
            plan(&mut rig);
        }
        rig.world.power(device, true);
        rig.world.set_bit_rate(rig.world.port(device).bit_rate());
        rig.boot(device);
        if !at_start {
            plan(&mut rig);
        }
        (operation.act)(&mut rig, device);
        rig.world.memory(device).flash().clone()
    }

    /// Does an operation to its end.
    fn run_through(&self, operation: Operation, flash: &Flash) -> Flash {
        self.run(operation, flash, u64::MAX, operation.at_start)
    }

    fn case(&'static self, operation: Operation, flash: Flash) -> Case {
        let done = self.run_through(operation, &flash);
        let last = records(&done);
        let mut stages = vec![records(&flash)];
        for key in operation.writes {
            let mut next = stages.last().unwrap().clone();
            next[key.position()].clone_from(&last[key.position()]);
            stages.push(next);
        }
        assert_eq!(stages.last(), Some(&last), "{} writes what it says", operation.name);
        assert!(stages.windows(2).all(|pair| pair[0] != pair[1]), "{} changes each record", operation.name);
        let unworn = stages.iter().map(flash_with);
        let seen = unworn.clone().map(|flash| self.observe(&flash, operation.name)).collect();
        let again = unworn.map(|flash| records(&self.run_through(operation, &flash))).collect();
        Case { product: self, operation, erases: done.erases() > flash.erases(), flash, stages, seen, again }
    }
}

/// An operation on a flash in some state, and what may be found after a power cut.
struct Case {
    product: &'static Product,
    operation: Operation,
    flash: Flash,
    /// The records before it, and after each of its writes.
    stages: Vec<Records>,
    /// What a master sees of each.
    seen: Vec<Vec<String>>,
    /// The records after it was done again on each.
    again: Vec<Records>,
    /// Whether a sector is erased on the way.
    erases: bool,
}

impl Case {
    /// Looks at what a cut has left: the device starts with it, and doing the operation again does what it does on a
    /// flash that was never cut.
    fn check(&self, left: &Flash, what: &str) {
        let what = format!("{}, {what}", self.operation.name);
        let found = records(left);
        let stage = self.stages.iter().position(|stage| *stage == found);
        let stage = stage.unwrap_or_else(|| panic!("{what}: {found:02X?} of {:02X?}", self.stages));
        assert_eq!(self.product.observe(left, &what), self.seen[stage], "{what}");
        let again = records(&self.product.run_through(self.operation, left));
        assert!(again == self.again[stage], "{what}, and done again: {again:02X?} for {:02X?}", self.again[stage]);
    }

    /// Does the operation with a cut, and looks at what is left; `None` when it was through before.
    fn cut(&self, flash: &Flash, cut: u64, at_start: bool, what: &str) -> Option<Flash> {
        let mut left = self.product.run(self.operation, flash, cut, at_start);
        if !left.is_dead() {
            return None;
        }
        left.restore_power();
        self.check(&left, &format!("{what} cut after {cut}"));
        Some(left)
    }

    /// Cuts the power at each word write and erase; what each has left, in order.
    fn cut_everywhere(&self) -> Vec<Flash> {
        let mut all_left = Vec::new();
        for cut in 0.. {
            let mut flash = self.flash.clone();
            flash.seed_noise(cut);
            let Some(left) = self.cut(&flash, cut, self.operation.at_start, "once") else { break };
            all_left.push(left);
        }
        // Uncut it is done.
        assert!(
            all_left.len() >= 4 * self.operation.writes.len(),
            "{} cuts of {}",
            all_left.len(),
            self.operation.name
        );
        all_left
    }

    /// Cuts the power at its erase, which is where so many cuts have been tried before it was done, with all that a
    /// torn erase can leave behind.
    fn cut_erase(&self, all_left: &[Flash]) -> Vec<Flash> {
        let undone = all_left.iter().filter(|left| left.erases() == self.flash.erases()).count();
        let erase = u64::try_from(undone).unwrap() - 1;
        let mut all_left = Vec::new();
        for torn_erase in TornErase::ALL {
            for seed in 0..3 {
                let mut flash = self.flash.clone();
                flash.set_torn_erase(torn_erase);
                flash.seed_noise(seed);
                let what = format!("{torn_erase:?} with seed {seed},");
                all_left.push(self.cut(&flash, erase, self.operation.at_start, &what).expect("cut"));
            }
        }
        all_left
    }

    /// Cuts the power again, at each word write and erase of the next start and of the operation done again, as far as
    /// `wanted`.
    fn cut_again(&self, left: &Flash, wanted: impl Fn(u64) -> bool) -> usize {
        (0..).filter(|cut| wanted(*cut)).map_while(|cut| self.cut(left, cut, true, "a second time")).count()
    }
}

impl Product {
    /// One as it leaves the factory, of which `before` was done.
    fn prepared(&self, operation: Operation, flash: &Flash) -> Flash {
        let (mut rig, device) = (self.with_flash)(flash.clone());
        rig.boot(device);
        (operation.before)(&mut rig, device);
        rig.world.memory(device).flash().clone()
    }

    /// The states of a nearly full sector, from the first in which the operation has to empty the other one to the
    /// last.
    fn nearly_full(&self, operation: Operation, worn: &Flash) -> Vec<Flash> {
        let mut memory = Memory::with_flash(self.prepared(operation, worn));
        let erases = memory.flash().erases();
        let mut states = Vec::new();
        loop {
            let flash = memory.flash().clone();
            store_again(&mut memory, LocalLayer);
            if self.run_through(operation, &flash).erases() > erases {
                states.push(flash);
            }
            if memory.flash().erases() > erases {
                return states;
            }
        }
    }

    /// A flash whose first sector has some 600 bytes left.
    fn worn(&self) -> Flash {
        let mut memory = Memory::with_flash(self.prepared(FIRST_START, &Flash::new()));
        wear(&mut memory);
        memory.flash().clone()
    }

    /// Cuts the power at each write of each operation. How many cuts and second cuts that were.
    fn cut_every_write(&'static self) -> [usize; 2] {
        let (mut cuts, mut second) = (0, 0);
        for operation in self.operations.iter().copied().chain([FIRST_START]) {
            let is_first = operation.writes.contains(&Factory);
            let case =
                self.case(operation, if is_first { Flash::new() } else { self.prepared(operation, &Flash::new()) });
            assert!(!case.erases);
            let all_left = case.cut_everywhere();
            cuts += all_left.len();
            if operation.repeatable {
                let some = all_left.iter().step_by(if operation.at_start { 3 } else { 7 });
                second += some.map(|left| case.cut_again(left, |cut| cut % 3 != 1)).sum::<usize>();
            }
        }
        [cuts, second]
    }

    /// Cuts the power at each write and erase of each operation that empties a sector. How many states of a sector,
    /// cuts and second cuts that were.
    fn cut_every_erase(&'static self) -> [usize; 3] {
        let worn = self.worn();
        let (mut states, mut cuts, mut second) = (0, 0, 0);
        for operation in self.operations.iter().copied() {
            let nearly_full = self.nearly_full(operation, &worn);
            let (first, last) = (nearly_full.first().expect("a state"), nearly_full.last().expect("a state"));
            // One write only: the first state says it all. Of several, each may be the one that erases.
            let flashes = if operation.writes.len() > 1 { vec![first, last] } else { vec![first] };
            for flash in flashes {
                let case = self.case(operation, flash.clone());
                assert!(case.erases);
                let all_left = case.cut_everywhere();
                let torn = case.cut_erase(&all_left);
                states += 1;
                cuts += all_left.len() + torn.len();
                if operation.repeatable {
                    let some = all_left.iter().step_by(37).chain(torn.iter().step_by(4));
                    second += some.map(|left| case.cut_again(left, |cut| cut < 3 || cut % 37 == 5)).sum::<usize>();
                }
            }
        }
        [states, cuts, second]
    }
}

#[test]
fn a_cut_at_any_write_of_any_operation() {
    let [cuts, second] = valve::PRODUCT.cut_every_write();
    assert!(cuts > 140 && second > 400, "{cuts} cuts, {second} second cuts");
}

#[test]
fn a_cut_at_any_write_of_any_operation_of_a_sensor() {
    let [cuts, second] = sensor::PRODUCT.cut_every_write();
    assert!(cuts > 120 && second > 250, "{cuts} cuts, {second} second cuts");
}

#[test]
fn a_cut_at_any_write_of_any_operation_that_empties_a_sector() {
    let [states, cuts, second] = valve::PRODUCT.cut_every_erase();
    assert!(states >= 10 && cuts > 700 && second > 80, "{states} states, {cuts} cuts, {second} second cuts");
}

#[test]
fn a_cut_at_any_write_of_any_operation_of_a_sensor_that_empties_a_sector() {
    let [states, cuts, second] = sensor::PRODUCT.cut_every_erase();
    assert!(states >= 10 && cuts > 700 && second > 80, "{states} states, {cuts} cuts, {second} second cuts");
}
