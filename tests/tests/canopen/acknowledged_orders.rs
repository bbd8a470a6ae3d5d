//! Every store, every order of two, every failing write, with a power cut at the instant of each answer: what was
//! acknowledged by then is there at the next start, and at the one after it (SPEC 4.5, 6).

use std::collections::BTreeSet;

use protocol_core::controller::BitRate;
use protocol_core::time::Duration;
use tests::lss;
use tests::{Rig, frame};

use super::{CLEAR, COUNTERS_CLEARED, LOAD, LOADED, SAVE, SAVED};

/// What a client can have stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Store {
    Save,
    Load,
    ClearCounters,
    /// LSS store of 500 kbit/s.
    Lss,
    /// The node ID by UDS.
    Uds,
}

use Store::{ClearCounters, Load, Lss, Save, Uds};

impl Store {
    const ALL: [Self; 5] = [Save, Load, ClearCounters, Lss, Uds];

    const fn request(self) -> &'static str {
        match self {
            Save => SAVE,
            Load => LOAD,
            ClearCounters => CLEAR,
            Lss => lss::STORE,
            Uds => "1BC78820: 04 2E 10 01 30",
        }
    }

    const fn acknowledgement(self) -> &'static str {
        match self {
            Save => SAVED,
            Load => LOADED,
            ClearCounters => COUNTERS_CLEARED,
            Lss => lss::STORED,
            Uds => "1BC408F1: 03 6E 10 01",
        }
    }
}

/// A parameter as it was stored first, and as it is now.
const FIRST: u32 = 0xA5;
const OWN: u32 = 0xA7;
const DEFAULT: u32 = 0x8000_0000;
/// How often the internal error occurred.
const COUNT: u32 = 3;

const WRITE_TIME: Duration = Duration::from_millis(10);

/// A valve with something in each record, and other values at work; perhaps at the start that executes "load".
fn prepared(executing_load: bool) -> Rig {
    let mut valve = Rig::booted();
    valve.write(0x1028, 1, 4, FIRST).unwrap();
    valve.exchange(Save.request(), &[Save.acknowledgement()]);
    for active in [true, false].into_iter().cycle().take(2 * COUNT as usize) {
        valve.sense(|inputs| inputs.internal_fault = active);
    }
    valve.advance(20_000);
    valve.take();
    if executing_load {
        valve.exchange(Load.request(), &[Load.acknowledgement()]);
        valve.write_time = WRITE_TIME;
        valve.start_anew();
    }
    valve.write(0x1028, 1, 4, OWN).unwrap();
    valve.exchange(lss::TO_CONFIGURATION, &[]);
    valve.exchange("7E5: 13 00 02 00 00 00 00 00", &["7E4: 13 00 00 00 00 00 00 00"]);
    valve.write_time = WRITE_TIME;
    valve.take();
    valve
}

/// What a start has to find.
struct Expected {
    executing_load: bool,
    /// A write fails.
    failing: bool,
    asked: BTreeSet<Store>,
    acknowledged: BTreeSet<Store>,
}

impl Expected {
    fn parameters(&self) -> BTreeSet<u32> {
        if self.acknowledged.contains(&Load) {
            return [DEFAULT].into();
        }
        let before = if self.executing_load { DEFAULT } else { FIRST };
        let mut all: BTreeSet<u32> = if self.acknowledged.contains(&Save) { [OWN].into() } else { [before].into() };
        all.extend(self.asked.contains(&Save).then_some(OWN));
        all.extend(self.asked.contains(&Load).then_some(DEFAULT));
        all
    }

    /// What one of two values must be.
    fn either<T: Ord + Copy>(&self, store: Store, before: T, after: T) -> BTreeSet<T> {
        if self.acknowledged.contains(&store) {
            [after].into()
        } else if self.asked.contains(&store) {
            [before, after].into()
        } else {
            [before].into()
        }
    }

    /// Cuts the power of a valve with these records, and starts it twice.
    #[track_caller]
    fn check(&self, valve: &Rig, what: &str) {
        let mut cut = Rig::booted();
        cut.records.clone_from(&valve.records);
        for start in ["the next start", "the start after it"] {
            cut.power_cycle();
            cut.advance(1000);
            cut.take();
            let found = cut.read(0x1028, 1);
            assert!(self.parameters().contains(&found), "{what}, {start}: 0x1028:1 is {found:X}");
            let count = cut.read(0x2024, 0);
            let counts = self.either(ClearCounters, COUNT, 0);
            // A write that fails is one internal error more.
            let is_kept = counts.contains(&count) || (self.failing && counts.contains(&count.wrapping_sub(1)));
            assert!(is_kept, "{what}, {start}: {count} internal errors");
            let rate = cut.device().bit_rate();
            assert!(self.either(Lss, BitRate::Kbit250, BitRate::Kbit500).contains(&rate), "{what}, {start}: {rate:?}");
            let node_id = cut.node_id().unwrap();
            assert!(self.either(Uds, 0x20, 0x30).contains(&node_id), "{what}, {start}: node {node_id:X}");
        }
    }
}

/// Asks for these, each so many milliseconds after the one before, and cuts the power at each answer and long after.
fn run(stores: &[Store], gap: u64, failing: Option<usize>, executing_load: bool) {
    let mut valve = prepared(executing_load);
    valve.failing_writes = failing.into_iter().collect();
    let mut expected =
        Expected { executing_load, failing: failing.is_some(), asked: BTreeSet::new(), acknowledged: BTreeSet::new() };
    let what = format!("{stores:?} {gap} ms apart, write {failing:?} fails, executing load: {executing_load}");
    for ms in 0..=200 {
        for (due, store) in (0..).step_by(usize::try_from(gap).unwrap()).zip(stores) {
            if due == ms {
                expected.asked.insert(*store);
                valve.send_frame(frame(store.request()));
            }
        }
        let sent = valve.take();
        let answered = Store::ALL.into_iter().filter(|store| sent.iter().any(|frame| frame == store.acknowledgement()));
        let before = expected.acknowledged.len();
        expected.acknowledged.extend(answered);
        if expected.acknowledged.len() > before || ms == 200 {
            expected.check(&valve, &format!("{what}: cut after {ms} ms"));
        }
        valve.advance(1);
    }
    // Two SDO requests have one client, who gives the first one up with the second. Nobody else's is refused.
    let by_sdo = stores.iter().filter(|store| store.request().starts_with("620")).count();
    if failing.is_none() && (by_sdo < 2 || gap > 50) {
        assert_eq!(expected.acknowledged, stores.iter().copied().collect(), "{what}");
    }
}

/// Every order.
fn pairs() -> impl Iterator<Item = [Store; 2]> {
    Store::ALL.into_iter().flat_map(|first| Store::ALL.into_iter().map(move |second| [first, second]))
}

const GAPS: [u64; 7] = [1, 5, 9, 10, 11, 25, 60];

fn failures() -> impl Iterator<Item = Option<usize>> {
    [None].into_iter().chain((0..4).map(Some))
}

#[test]
fn every_store() {
    for store in Store::ALL {
        for failing in failures() {
            run(&[store], 1, failing, false);
        }
    }
}

#[test]
fn every_order_of_two() {
    for pair in pairs() {
        for gap in GAPS {
            for failing in failures() {
                run(&pair, gap, failing, false);
            }
        }
    }
}

#[test]
fn every_store_while_load_is_executed() {
    for store in Store::ALL {
        for failing in failures() {
            run(&[store], 1, failing, true);
        }
    }
}

#[test]
fn every_order_of_two_while_load_is_executed() {
    for pair in pairs() {
        for gap in GAPS {
            for failing in failures() {
                run(&pair, gap, failing, true);
            }
        }
    }
}
