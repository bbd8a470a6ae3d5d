//! Every store, every order of two, every failing write, with a power cut at the instant of each answer: what was
//! acknowledged by then is there at the next start, and at the one after it (SPEC 5, 6, 7).

use protocol_core::time::Duration;
use tests::Rig;
use tests::isobus::BLOCK;

/// What can be stored: the frames that ask for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Store {
    /// DM3 of the previously active faults.
    Clear,
    /// The address by UDS.
    Uds,
    /// A commanded address.
    Command,
}

use Store::{Clear, Command, Uds};

impl Store {
    const ALL: [Self; 3] = [Clear, Uds, Command];

    const fn requests(self) -> &'static [&'static str] {
        match self {
            Clear => &["18EA8327: CC FE 00"],
            Uds => &["1BC78883: 04 2E 10 01 85"],
            Command => &[
                "1CECFF27: 20 09 00 02 FF D8 FE 00",
                "1CEBFF27: 01 01 00 20 07 08 FF 02",
                "1CEBFF27: 02 20 84 FF FF FF FF FF",
            ],
        }
    }

    /// The answer; of a commanded address that is the claim of it.
    const fn acknowledgement(self) -> &'static str {
        match self {
            Clear => "18E8FF83: 00 FF FF FF 27 CC FE 00",
            Uds => "1BC408F1: 03 6E 10 01",
            Command => "18EEFF84: 01 00 20 07 08 FF 02 20",
        }
    }

    const fn address(self) -> Option<u8> {
        match self {
            Clear => None,
            Uds => Some(0x85),
            Command => Some(0x84),
        }
    }
}

/// A valve whose temperature fault is previously active, and stored.
fn prepared() -> Rig {
    let mut valve = Rig::claimed();
    valve.sense(|inputs| inputs.temperature_c = 130);
    valve.advance_cyclic(300, BLOCK);
    valve.sense(|inputs| inputs.temperature_c = 25);
    valve.recover_and_settle();
    valve.write_time = Duration::from_millis(10);
    valve
}

/// The payload of DM2, of one frame or in packets.
fn dm2(valve: &mut Rig, address: u8) -> String {
    valve.send(&format!("18EA{address:02X}27: CB FE 00"));
    valve.advance(1000);
    let payload = |frame: String| match frame.split_once(": ") {
        Some((id, data)) if id.starts_with("18FECB") => Some(data.to_owned()),
        Some((id, data)) if id.starts_with("1CEBFF") => Some(data[3..].to_owned()),
        _ => None,
    };
    valve.take().into_iter().filter_map(payload).collect::<Vec<_>>().join(" ")
}

/// Cuts the power of a valve with these records, and starts it twice.
#[track_caller]
fn check(valve: &Rig, asked: &[Store], acknowledged: &[Store], what: &str) {
    let mut cut = Rig::claimed();
    cut.records.clone_from(&valve.records);
    let mut addresses: Vec<u8> = asked.iter().filter_map(|store| store.address()).collect();
    match acknowledged.iter().rev().find_map(|store| store.address()) {
        None => addresses.push(0x83),
        // Another one that was asked for meanwhile may have come after it, and not yet have been answered.
        Some(last) => addresses
            .retain(|address| *address == last || !acknowledged.iter().any(|store| store.address() == Some(*address))),
    }
    for start in ["the next start", "the start after it"] {
        cut.power_cycle();
        let address = cut.node_id().expect("an address");
        assert!(addresses.contains(&address), "{what}, {start}: at {address:X}, not {addresses:X?}");
        cut.advance(1000);
        cut.take();
        let listed = dm2(&mut cut, address).contains("F1 8F 90");
        assert!(!listed || !acknowledged.contains(&Clear), "{what}, {start}: cleared, and yet listed");
        assert!(listed || asked.contains(&Clear), "{what}, {start}: nobody has cleared it");
    }
}

/// Asks for these, each so many milliseconds after the one before, and cuts the power at each answer and long after.
fn run(stores: &[Store], gap: usize, failing: Option<usize>) {
    let mut valve = prepared();
    valve.failing_writes = failing.into_iter().collect();
    let (mut asked, mut acknowledged) = (Vec::new(), Vec::new());
    let what = format!("{stores:?} {gap} ms apart, write {failing:?} fails");
    for ms in 0..=200 {
        for (due, store) in (0..).step_by(gap).zip(stores) {
            if due == ms {
                asked.push(*store);
                store.requests().iter().for_each(|request| valve.send(request));
            }
        }
        let before = acknowledged.len();
        for frame in valve.take() {
            acknowledged.extend(Store::ALL.into_iter().filter(|store| frame == store.acknowledgement()));
        }
        if acknowledged.len() > before || ms == 200 {
            check(&valve, &asked, &acknowledged, &format!("{what}: cut after {ms} ms"));
        }
        valve.advance(1);
    }
    if failing.is_none() && stores.len() == 1 {
        assert_eq!(acknowledged, stores, "{what}");
    }
}

fn failures() -> impl Iterator<Item = Option<usize>> {
    [None].into_iter().chain((0..4).map(Some))
}

#[test]
fn every_store() {
    for store in Store::ALL {
        for failing in failures() {
            run(&[store], 1, failing);
        }
    }
}

#[test]
fn every_order_of_two() {
    for first in Store::ALL {
        for second in Store::ALL {
            for gap in [1, 5, 9, 10, 11, 25, 60] {
                for failing in failures() {
                    run(&[first, second], gap, failing);
                }
            }
        }
    }
}
