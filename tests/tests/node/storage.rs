//! 0x1010 and 0x1011: what a new memory holds, and who is answered when (SPEC 4.5, 6, 9).

use protocol_core::controller::BitRate;
use protocol_core::device::Setup;
use protocol_core::memory::RecordKey;
use protocol_core::time::Duration;
use tests::nmt::RESETS;
use tests::{Rig, sdo};

use super::kinds::{Kind, each_kind};

const FAILED: u32 = 0x0606_0000;

/// What stores something: index, sub-index, signature, and how many records it writes.
fn tasks(kind: &Kind) -> Vec<(u16, u8, &'static [u8; 4], u64)> {
    if kind.rules.reset_emcy {
        vec![(0x1010, 1, b"save", 1), (0x1011, 1, b"load", 1), (0x1011, 5, b"pkds", 1)]
    } else {
        let groups = [(1, 2), (2, 1), (3, 1), (4, 1)];
        let save = groups.map(|(sub, records)| (0x1010, sub, b"save", records));
        save.into_iter().chain(groups.map(|(sub, records)| (0x1011, sub, b"load", records))).collect()
    }
}

/// A node whose writes take 10 ms.
fn slow(kind: &Kind) -> Rig {
    let mut node = kind.booted();
    node.write_time = Duration::from_millis(10);
    node
}

/// The SDO answers among what was sent.
fn answers(kind: &Kind, node: &mut Rig) -> Vec<String> {
    node.take_under(&format!("{:03X}", 0x580 + u16::from(kind.node_id)))
}

/// A request to store in one frame, and in segments with and without a size; each kind of download has its own answer.
fn downloads(kind: &Kind, index: u16, sub: u8, signature: &[u8; 4]) -> [(Vec<String>, String); 3] {
    let ([low, high], [s, a, v, e]) = (index.to_le_bytes(), signature);
    let object = format!("{low:02X} {high:02X} {sub:02X}");
    let expedited = vec![format!("23 {object} {s:02X} {a:02X} {v:02X} {e:02X}")];
    let with_size = vec![format!("21 {object} 04"), format!("07 {s:02X} {a:02X} {v:02X} {e:02X}")];
    let without_size = vec![format!("20 {object}"), format!("08 {s:02X} {a:02X} {v:02X}"), format!("1D {e:02X}")];
    let downloads =
        [(expedited, format!("60 {object}")), (with_size, "20".to_owned()), (without_size, "30".to_owned())];
    downloads.map(|(requests, done)| {
        let requests = requests.iter().map(|bytes| sdo::request(kind.node_id, bytes));
        (requests.collect(), sdo::answer(kind.node_id, &done))
    })
}

/// However long the writes take: a memory that writes is no client that is silent.
#[test]
fn the_answer_comes_after_the_last_write() {
    each_kind(|kind| {
        for (index, sub, signature, records) in tasks(kind) {
            for (requests, done) in downloads(kind, index, sub, signature) {
                for (fails, write_ms) in [(false, 10), (true, 10), (false, 10_000)] {
                    let mut node = kind.booted();
                    node.write_time = Duration::from_millis(write_ms);
                    node.writes_fail = fails;
                    requests.iter().for_each(|request| node.send(request));
                    assert_eq!(node.take().len(), requests.len() - 1, "{requests:?}");
                    node.silent_for(write_ms * records - 1);
                    node.advance(1);
                    let answer = if fails { sdo::abort(kind.node_id, index, sub, FAILED) } else { done.clone() };
                    assert_eq!(answers(kind, &mut node), [answer], "{requests:?}, fails: {fails}");
                }
            }
        }
    });
}

/// Segments and unknown commands are another client's: they are refused, and the one that waits is answered.
#[test]
fn a_stray_segment_while_a_client_waits() {
    each_kind(|kind| {
        for (stray, refused) in [
            ("60", "80 00 00 00 01 00 04 05"),
            ("01", "80 00 00 00 01 00 04 05"),
            ("C6 17 10 00 02", "80 17 10 00 01 00 04 05"),
        ] {
            for (index, sub, signature, _) in tasks(kind) {
                for fails in [false, true] {
                    let mut node = slow(kind);
                    node.writes_fail = fails;
                    node.exchange(&sdo::write(kind.node_id, index, sub, signature), &[]);
                    node.exchange_sdo(stray, Some(refused));
                    node.advance(100);
                    let written = sdo::written(kind.node_id, index, sub);
                    let answer = if fails { sdo::abort(kind.node_id, index, sub, FAILED) } else { written };
                    assert_eq!(answers(kind, &mut node), [answer], "{index:04X}:{sub}, {stray}");
                }
            }
        }
    });
}

/// The client's own abort ends its wait.
#[test]
fn a_client_that_aborts_while_it_waits() {
    each_kind(|kind| {
        let mut node = slow(kind);
        node.exchange(&sdo::write(kind.node_id, 0x1010, 1, b"save"), &[]);
        node.exchange_sdo("80 10 10 01 00 00 00 08", None);
        node.silent_for(100);
    });
}

/// A client that asks again gives up its first request: one answer, when everything was stored anew.
#[test]
fn a_save_that_is_asked_for_again() {
    each_kind(|kind| {
        for (times, gap) in [(2, 5), (2, 10), (18, 1)] {
            let mut node = kind.booted();
            node.write_time = Duration::from_millis(50);
            node.writes.clear();
            // A write of the first request that fails is made good by the second.
            node.failing_writes.insert(0);
            for _ in 0..times {
                node.send(&sdo::write(kind.node_id, 0x1010, 1, b"save"));
                node.advance(gap);
            }
            node.advance(500);
            let written = sdo::written(kind.node_id, 0x1010, 1);
            assert_eq!(answers(kind, &mut node), [written], "{times} times, {gap} ms apart");
            assert!(node.writes.len() <= 4, "{:?}", node.writes);
        }
    });
}

/// A reset waits for the writes, and an SDO client is not answered any more.
#[test]
fn a_reset_waits_for_the_writes() {
    each_kind(|kind| {
        for (index, sub, signature, records) in tasks(kind) {
            for reset in RESETS {
                let mut node = slow(kind);
                node.exchange(&sdo::write(kind.node_id, index, sub, signature), &[]);
                node.silent_to(&[reset, &sdo::read(kind.node_id, 0x1000, 0)]);
                node.silent_for(10 * records - 1);
                node.advance_sends(1, &kind.boot(kind.node_id));
            }
        }
    });
}

/// A memory that was never written: factory record and local layer, once.
#[test]
fn a_new_memory_is_filled_once() {
    each_kind(|kind| {
        for mut node in [kind.booted(), kind.blank()] {
            assert_eq!(node.writes, [RecordKey::Factory, RecordKey::LocalLayer]);
            node.writes.clear();
            let node_id = node.node_id();
            node.start_anew();
            assert_eq!((node.node_id(), node.writes.len()), (node_id, 0));
        }
    });
}

/// A memory decides; what the device is made as only fills a new one.
#[test]
fn the_memory_decides() {
    each_kind(|kind| {
        let setup = Setup { node_id: Some(5), serial: Some(7), bit_rate: Some(BitRate::Kbit125), ..kind.setup };
        let made = Rig::power_on(setup);
        let mut other = kind.booted();
        other.records = made.records;
        kind.starts(&mut other, 5);
        assert_eq!((other.read(0x1018, 4), other.device().bit_rate()), (7, BitRate::Kbit125));
    });
}
