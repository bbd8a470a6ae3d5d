//! A power cut at every word write and every erase of every operation that stores (SPEC 4.5, 6): the valve boots, each
//! record is old or new and never mixed, nothing else is lost, and no error is told.

use hal_sim::memory::{Flash, SECTOR, TornErase, WORD};
use hal_sim::{Memory, NodeId};
use protocol_core::memory::RecordKey::{self, Factory, FaultLog, LocalLayer, Parameters, RestoreFlag};
use protocol_core::memory::seal;
use tests::Bench;

/// The version of all records.
const VERSION: u8 = 1;

/// The payload of each record.
type Records = [Option<Vec<u8>>; RecordKey::ALL.len()];

/// Something that makes a valve store.
#[derive(Clone, Copy)]
struct Operation {
    name: &'static str,
    /// What was done with the valve before.
    before: fn(&mut Bench, NodeId),
    /// What is done while the power is cut, after the start or, if `at_start`, with it.
    act: fn(&mut Bench, NodeId),
    at_start: bool,
    /// What it writes, in this order.
    writes: &'static [RecordKey],
    /// Whether doing it again stores the same again.
    repeatable: bool,
}

const ACT: Operation =
    Operation { name: "", before: nothing, act: nothing, at_start: false, writes: &[], repeatable: true };

const FIRST_START: Operation = Operation { name: "first start", at_start: true, writes: &[Factory, LocalLayer], ..ACT };

const OPERATIONS: [Operation; 9] = [
    Operation { name: "first save", act: save_two, writes: &[Parameters], ..ACT },
    Operation { name: "save", before: save_one, act: save_two, writes: &[Parameters], ..ACT },
    Operation { name: "load", before: save_one, act: load, writes: &[RestoreFlag], repeatable: false, ..ACT },
    Operation {
        name: "load at the next start",
        before: save_and_load,
        at_start: true,
        writes: &[Parameters, RestoreFlag],
        ..ACT
    },
    Operation { name: "LSS store", before: save_one, act: store_by_lss, writes: &[LocalLayer], ..ACT },
    Operation { name: "UDS node ID", before: save_one, act: write_node_id, writes: &[LocalLayer], ..ACT },
    Operation { name: "fault log", before: save_one, act: fault, writes: &[FaultLog], repeatable: false, ..ACT },
    Operation {
        name: "fault log before a restart",
        before: fault,
        act: fault_and_reset,
        writes: &[FaultLog],
        repeatable: false,
        ..ACT
    },
    Operation { name: "clear counters", before: fault, act: clear_counters, writes: &[FaultLog], ..ACT },
];

fn nothing(bench: &mut Bench, _: NodeId) {
    bench.run_for(50);
}

fn node_id(bench: &Bench, valve: NodeId) -> u8 {
    bench.world.device(valve).and_then(|device| device.node_id()).unwrap_or(0)
}

/// Writes parameters and stores them, as far as the power lasts.
fn save(bench: &mut Bench, valve: NodeId, parameters: &[(u16, u8, u8, u32)]) {
    let node_id = node_id(bench, valve);
    let save = (0x1010, 1, 4, u32::from_le_bytes(*b"save"));
    let _ = parameters.iter().chain([&save]).all(|write| bench.write(node_id, *write));
}

fn save_one(bench: &mut Bench, valve: NodeId) {
    save(bench, valve, &[(0x1028, 1, 4, 0xA1), (0x1800, 2, 1, 11), (0x6053, 0, 4, u32::from_le_bytes(*b"one "))]);
}

fn save_two(bench: &mut Bench, valve: NodeId) {
    save(bench, valve, &[(0x1028, 1, 4, 0xA2), (0x1800, 2, 1, 22), (0x6053, 0, 4, u32::from_le_bytes(*b"two "))]);
}

fn load(bench: &mut Bench, valve: NodeId) {
    let node_id = node_id(bench, valve);
    bench.write(node_id, (0x1011, 1, 4, u32::from_le_bytes(*b"load")));
}

fn save_and_load(bench: &mut Bench, valve: NodeId) {
    save_one(bench, valve);
    load(bench, valve);
}

fn store_by_lss(bench: &mut Bench, _: NodeId) {
    bench.send("7E5: 04 01 00 00 00 00 00 00");
    for request in ["11 21 00", "13 00 02", "17 00 00"] {
        bench.ask(&format!("7E5: {request} 00 00 00 00 00"));
    }
}

fn write_node_id(bench: &mut Bench, valve: NodeId) {
    let id = 0x1BC0_0000 | 0xF1 << 11 | u32::from(node_id(bench, valve));
    bench.ask(&format!("{id:08X}: 04 2E 10 01 22"));
}

fn blink(bench: &mut Bench, valve: NodeId) {
    for internal_fault in [true, false] {
        bench.sense(valve, |senses| senses.internal_fault = internal_fault);
    }
}

/// A fault that comes and goes, and the time until it is logged.
fn fault(bench: &mut Bench, valve: NodeId) {
    blink(bench, valve);
    bench.run_for(700);
}

fn fault_and_reset(bench: &mut Bench, valve: NodeId) {
    blink(bench, valve);
    bench.send("000: 81 00");
    bench.run_for(100);
}

fn clear_counters(bench: &mut Bench, valve: NodeId) {
    let node_id = node_id(bench, valve);
    bench.write(node_id, (0x1011, 5, 4, u32::from_le_bytes(*b"pkds")));
}

fn records(flash: &Flash) -> Records {
    let image = Memory::with_flash(flash.clone()).read_image();
    assert!(!image.is_damaged());
    RecordKey::ALL.map(|key| image.payload(key, VERSION).expect("intact").map(<[u8]>::to_vec))
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

/// Switches a valve with this flash on, its master at the bit rate that it has stored. What was on the bus.
fn boot(flash: &Flash) -> (Bench, NodeId, Vec<String>) {
    let (mut bench, valve) = Bench::with_flash(flash.clone());
    bench.world.power(valve, true);
    bench.world.set_bit_rate(bench.world.port(valve).bit_rate());
    let frames = bench.boot(valve);
    (bench, valve, frames)
}

/// What a master sees of what a valve has stored; it has booted without an error.
#[track_caller]
fn observe(flash: &Flash, what: &str) -> Vec<String> {
    let (mut bench, valve, frames) = boot(flash);
    let node_id = u16::from(node_id(&bench, valve));
    let expected = [format!("{:03X}: 00", 0x700 + node_id), format!("{:03X}:{}", 0x080 + node_id, " 00".repeat(8))];
    assert_eq!(frames, expected, "{what}");
    let mut seen = vec![format!("{} bit/s", bench.world.port(valve).bit_rate().bits_per_second())];
    // Error register, serial number, and of each record something.
    for object in ["01 10 00", "18 10 04", "28 10 01", "00 14 01", "00 18 01", "00 18 02", "53 60 00", "24 20 00"] {
        let answer = bench.ask(&format!("{:03X}: 40 {object} 00 00 00 00", 0x600 + node_id));
        seen.push(answer.unwrap_or_else(|| panic!("{what}: no answer about {object}")));
    }
    seen
}

/// An operation on a flash in some state, and what may be found after a power cut.
struct Case {
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

impl Operation {
    /// Does it, with the power cut after so many word writes and erases; from the start on, if `at_start`. What is in the
    /// flash then.
    fn run(&self, flash: &Flash, cut: u64, at_start: bool) -> Flash {
        let (mut bench, valve) = Bench::with_flash(flash.clone());
        let plan = |bench: &mut Bench| bench.world.memory_mut(valve).flash_mut().cut_power_after(cut);
        if at_start {
            plan(&mut bench);
        }
        bench.world.power(valve, true);
        bench.world.set_bit_rate(bench.world.port(valve).bit_rate());
        bench.boot(valve);
        if !at_start {
            plan(&mut bench);
        }
        (self.act)(&mut bench, valve);
        bench.world.memory(valve).flash().clone()
    }

    fn on(self, flash: Flash) -> Case {
        let done = self.run(&flash, u64::MAX, self.at_start);
        let last = records(&done);
        let mut stages = vec![records(&flash)];
        for key in self.writes {
            let mut next = stages.last().unwrap().clone();
            next[key.position()].clone_from(&last[key.position()]);
            stages.push(next);
        }
        assert_eq!(stages.last(), Some(&last), "{} writes what it says", self.name);
        assert!(stages.windows(2).all(|pair| pair[0] != pair[1]), "{} changes each record", self.name);
        let unworn = stages.iter().map(flash_with);
        let seen = unworn.clone().map(|flash| observe(&flash, self.name)).collect();
        let again = unworn.map(|flash| records(&self.run(&flash, u64::MAX, self.at_start))).collect();
        Case { operation: self, erases: done.erases() > flash.erases(), flash, stages, seen, again }
    }
}

impl Case {
    /// Looks at what a cut has left: the valve starts with it, and doing the operation again does what it does on a flash
    /// that was never cut.
    fn check(&self, left: &Flash, what: &str) {
        let what = format!("{}, {what}", self.operation.name);
        let found = records(left);
        let stage = self.stages.iter().position(|stage| *stage == found);
        let stage = stage.unwrap_or_else(|| panic!("{what}: {found:02X?} of {:02X?}", self.stages));
        assert_eq!(observe(left, &what), self.seen[stage], "{what}");
        let again = records(&self.operation.run(left, u64::MAX, self.operation.at_start));
        assert!(again == self.again[stage], "{what}, and done again: {again:02X?} for {:02X?}", self.again[stage]);
    }

    /// Does the operation with a cut, and looks at what is left; `None` when it was through before.
    fn cut(&self, flash: &Flash, cut: u64, at_start: bool, what: &str) -> Option<Flash> {
        let mut left = self.operation.run(flash, cut, at_start);
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
            all_left.len() >= 5 * self.operation.writes.len(),
            "{} cuts of {}",
            all_left.len(),
            self.operation.name
        );
        all_left
    }

    /// Cuts the power at its erase, which is where so many cuts have been tried before it was done, with all that a torn
    /// erase can leave behind.
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

/// A valve as it leaves the factory, of which `before` was done.
fn prepared(operation: Operation, flash: &Flash) -> Flash {
    let (mut bench, valve) = Bench::with_flash(flash.clone());
    bench.boot(valve);
    (operation.before)(&mut bench, valve);
    bench.world.memory(valve).flash().clone()
}

/// The states of a nearly full sector, from the first in which the operation has to empty the other one to the last.
fn nearly_full(operation: Operation, worn: &Flash) -> Vec<Flash> {
    let mut memory = Memory::with_flash(prepared(operation, worn));
    let erases = memory.flash().erases();
    let mut states = Vec::new();
    loop {
        let flash = memory.flash().clone();
        memory.store(LocalLayer, &seal(VERSION, records(&flash)[1].as_ref().unwrap()).unwrap()).unwrap();
        if operation.run(&flash, u64::MAX, operation.at_start).erases() > erases {
            states.push(flash);
        }
        if memory.flash().erases() > erases {
            return states;
        }
    }
}

/// A flash whose first sector has some 600 bytes left.
fn worn() -> Flash {
    let mut memory = Memory::with_flash(prepared(FIRST_START, &Flash::new()));
    let factory = seal(VERSION, records(memory.flash())[0].as_ref().unwrap()).unwrap();
    while memory.flash().words_in_use() < SECTOR / WORD - 150 {
        memory.store(Factory, &factory).unwrap();
    }
    assert_eq!(memory.flash().erases(), 0);
    memory.flash().clone()
}

#[test]
fn a_cut_at_any_write_of_any_operation() {
    let (mut cuts, mut second) = (0, 0);
    for operation in OPERATIONS.into_iter().chain([FIRST_START]) {
        let flash = if operation.writes.contains(&Factory) { Flash::new() } else { prepared(operation, &Flash::new()) };
        let case = operation.on(flash);
        assert!(!case.erases);
        let all_left = case.cut_everywhere();
        cuts += all_left.len();
        if operation.repeatable {
            let some = all_left.iter().step_by(if operation.at_start { 3 } else { 7 });
            second += some.map(|left| case.cut_again(left, |cut| cut % 3 != 1)).sum::<usize>();
        }
    }
    assert!(cuts > 140 && second > 400, "{cuts} cuts, {second} second cuts");
}

#[test]
fn a_cut_at_any_write_of_any_operation_that_empties_a_sector() {
    let worn = worn();
    let (mut states, mut cuts, mut second) = (0, 0, 0);
    for operation in OPERATIONS {
        let nearly_full = nearly_full(operation, &worn);
        let (first, last) = (nearly_full.first().expect("a state"), nearly_full.last().expect("a state"));
        // One write only: the first state says it all. Of several, each may be the one that erases.
        let flashes = if operation.writes.len() > 1 { vec![first, last] } else { vec![first] };
        for flash in flashes {
            let case = operation.on(flash.clone());
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
    assert!(states >= 10 && cuts > 750 && second > 80, "{states} states, {cuts} cuts, {second} second cuts");
}
