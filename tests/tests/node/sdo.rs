//! The SDO server (SPEC 4.2; CiA 301 7.2.4): who is answered when, and every way in which a segmented transfer ends
//! early.

use tests::lss::{INQUIRE_NODE_ID, TO_CONFIGURATION};
use tests::nmt::{ENTER_PRE_OPERATIONAL, RESETS, START, STOP};
use tests::{Rig, lss, sdo};

use super::kinds::{Kind, each_kind};

/// A segmented transfer is aborted after so long without a segment.
const TIMEOUT_MS: u64 = 5000;

const TOGGLE: &str = "00 00 03 05";
const TIMEOUT: &str = "00 00 04 05";
const UNKNOWN_COMMAND: &str = "01 00 04 05";

#[derive(Clone, Copy, Debug, PartialEq)]
enum Way {
    /// Of the first of the node's texts.
    Upload,
    /// Of the COB-ID of SYNC.
    Download,
}

use Way::{Download, Upload};

/// Each way, whether a segment has passed, the next segment with the wrong toggle bit, and one of the other way.
const UNDER_WAY: [(Way, bool, &str, &str); 4] = [
    (Upload, false, "70", "1D"),
    (Upload, true, "60", "1D"),
    (Download, false, "18 81", "70"),
    (Download, true, "0D", "70"),
];

/// The object of a transfer, as frames name it.
fn object(kind: &Kind, way: Way) -> String {
    let (index, ..) = kind.texts()[0];
    let [low, high] = if way == Upload { index } else { 0x1005 }.to_le_bytes();
    format!("{low:02X} {high:02X} 00")
}

/// Begins a transfer, and perhaps lets one segment pass.
fn begin(kind: &Kind, node: &mut Rig, way: Way, segment: bool) {
    let object = object(kind, way);
    let (_, _, text) = kind.texts()[0];
    let first: Vec<String> = text.bytes().take(7).map(|byte| format!("{byte:02X}")).collect();
    match way {
        Upload => {
            node.exchange_sdo(&format!("40 {object}"), Some(&format!("41 {object} {:02X}", text.len())));
            if segment {
                node.exchange_sdo("60", Some(&format!("00 {}", first.join(" "))));
            }
        }
        Download => {
            node.exchange_sdo(&format!("21 {object} 04"), Some(&format!("60 {object}")));
            if segment {
                node.exchange_sdo("08 81", Some("20"));
            }
        }
    }
}

/// The next segment of either transfer finds none in progress, and no download has come to its end.
#[track_caller]
fn assert_nothing_in_progress_or_written(node: &mut Rig) {
    for segment in ["70", "1D"] {
        node.exchange_sdo(segment, Some(&format!("80 00 00 00 {UNKNOWN_COMMAND}")));
    }
    assert_eq!(node.read(0x1005, 0), 0x80);
}

#[test]
fn what_ends_a_transfer() {
    each_kind(|kind| {
        for (way, segment, wrong_toggle, other_way) in UNDER_WAY {
            let abort = |code: &str| format!("80 {} {code}", object(kind, way));
            let vendor = sdo::answer(kind.node_id, &format!("43 18 10 01 {}", kind.identity_bytes()[0]));
            let request = |bytes: &str| sdo::request(kind.node_id, bytes);
            let answer = |bytes: &str| vec![sdo::answer(kind.node_id, bytes)];
            for (frame, answers) in [
                (request(wrong_toggle), answer(&abort(TOGGLE))),
                (request(other_way), answer(&abort(UNKNOWN_COMMAND))),
                (request("A0 0A 10 00 7F"), answer("80 0A 10 00 01 00 04 05")),
                // The client's own abort.
                (request(&abort("00 00 00 08")), vec![]),
                (STOP.to_owned(), vec![]),
                (RESETS[0].to_owned(), kind.boot(kind.node_id)),
                (RESETS[1].to_owned(), kind.boot(kind.node_id)),
                (request("40 18 10 01"), vec![vendor]),
                (request("2B 17 10 00 00"), answer("60 17 10 00")),
                // One that fails, too.
                (request("40 00 00 00"), answer("80 00 00 00 00 00 02 06")),
            ] {
                let mut node = kind.booted();
                begin(kind, &mut node, way, segment);
                node.send(&frame);
                node.expect_all(&answers);
                node.silent_for(2 * TIMEOUT_MS);
                node.send(ENTER_PRE_OPERATIONAL);
                assert_nothing_in_progress_or_written(&mut node);
            }
        }
        // Without one, an abort is nothing to answer.
        kind.booted().exchange_sdo("80 00 00 00 00 00 00 08", None);
    });
}

#[test]
fn a_client_that_falls_silent_is_told_after_five_seconds() {
    each_kind(|kind| {
        for (way, segment, ..) in UNDER_WAY {
            let mut node = kind.booted();
            begin(kind, &mut node, way, segment);
            let abort = format!("80 {} {TIMEOUT}", object(kind, way));
            node.silent_until(TIMEOUT_MS, &[sdo::answer(kind.node_id, &abort)]);
            node.silent_for(2 * TIMEOUT_MS);
            assert_nothing_in_progress_or_written(&mut node);
        }
    });
}

#[test]
fn every_segment_gives_another_five_seconds() {
    each_kind(|kind| {
        let mut node = kind.booted();
        begin(kind, &mut node, Download, false);
        for (segment, answer) in [("0C 81", "20"), ("1C 00", "30")] {
            node.silent_for(TIMEOUT_MS - 1);
            node.exchange_sdo(segment, Some(answer));
        }
        node.silent_for(TIMEOUT_MS - 1);
        // What is no SDO request does not count.
        node.silent_to(&[&sdo::request(kind.node_id, "0C 00")[..26], "080:"]);
        node.advance_sends(1, &[sdo::answer(kind.node_id, &format!("80 05 10 00 {TIMEOUT}"))]);
        // The last segment ends it: nothing is left to time out.
        assert_eq!(node.write_segmented(0x1005, 0, &[0x81, 0, 0, 0]), Ok(()));
        assert!(node.read_segmented(kind.texts()[0].0, 0).is_ok());
        node.silent_for(2 * TIMEOUT_MS);
    });
}

#[test]
fn a_new_initiate_starts_anew() {
    each_kind(|kind| {
        for way in [Upload, Download] {
            let mut node = kind.booted();
            for way in [way, Download, way, Upload, Download] {
                begin(kind, &mut node, way, true);
            }
            assert_eq!(node.read(0x1005, 0), 0x80);
        }
    });
}

#[test]
fn start_and_pre_operational_do_not_end_a_transfer() {
    each_kind(|kind| {
        let mut node = kind.booted();
        begin(kind, &mut node, Download, true);
        node.silent_to(&[START, ENTER_PRE_OPERATIONAL]);
        node.exchange_sdo("1D", Some("30"));
        assert_eq!(node.read(0x1005, 0), 0x81);
    });
}

/// Block transfer (A0 upload, C0 download) and what CiA 301 reserves (E0).
#[test]
fn unknown_commands_and_block_transfer_are_refused() {
    each_kind(|kind| {
        let mut node = kind.booted();
        for command in 0xA0..=0xFF {
            node.exchange_sdo(&format!("{command:02X} 05 10 00 0A"), Some(&format!("80 05 10 00 {UNKNOWN_COMMAND}")));
        }
        assert_eq!(node.read(0x1005, 0), 0x80);
    });
}

#[test]
fn other_frames_are_ignored() {
    each_kind(|kind| {
        let own = 0x600 + u16::from(kind.node_id);
        let request = "40 18 10 01 00 00 00 00";
        let mut node = kind.booted();
        for other in ["", " 40", " 40 18 10 01", " 40 18 10 01 00 00 00", " R8", " R0"] {
            node.exchange(&format!("{own:03X}:{other}"), &[]);
        }
        for id in [own - 1, own + 1, 0x600, own - 0x80].iter().filter(|id| **id != own) {
            node.exchange(&format!("{id:03X}: {request}"), &[]);
        }
        // Extended identifiers.
        let own = u32::from(own);
        node.silent_to(&[&format!("{own:08X}: {request}"), &format!("{:08X}: {request}", own << 18)]);
        // In mid-transfer, too.
        begin(kind, &mut node, Download, true);
        node.silent_to(&[&format!("{own:03X}: 1D 00 00 00 00 00 00"), &format!("{own:03X}: 40 18 10 01")]);
        node.exchange_sdo("1D", Some("30"));
    });
}

#[test]
fn answered_in_pre_operational_and_operational_alone() {
    each_kind(|kind| {
        let mut node = kind.booted();
        let vendor = format!("43 18 10 01 {}", kind.identity_bytes()[0]);
        for (order, answered) in [(START, true), (STOP, false), (ENTER_PRE_OPERATIONAL, true)] {
            for to in [0, kind.node_id] {
                node.silent_to(&[&format!("{} {to:02X}", &order[..7])]);
                node.exchange_sdo("40 18 10 01", answered.then_some(&vendor));
                node.silent_for(2 * TIMEOUT_MS);
            }
        }
    });
}

/// Answers that wait for the bus do not go stale: the first of them are sent, and each that is not counts as dropped.
#[test]
fn every_request_is_answered_or_counted() {
    each_kind(|kind| {
        let mut node = kind.booted();
        let sdo_answer = node.sdo(0x40, 0x1001, 0, 0).to_string();
        let answers = [lss::answer(&format!("5E {:02X}", kind.node_id)), sdo_answer];
        node.hold_bus(true);
        node.send(TO_CONFIGURATION);
        for _ in 0..20 {
            node.send_all(&[INQUIRE_NODE_ID, &sdo::read(kind.node_id, 0x1001, 0)]);
        }
        node.hold_bus(false);
        let sent = node.take();
        let dropped = usize::try_from(node.device().frames_dropped()).unwrap();
        assert!(dropped > 1 && sent.len() + dropped == 40, "{dropped} dropped of {sent:?}");
        for answer in answers {
            assert!(sent.iter().filter(|frame| **frame == answer).count() >= 3, "{answer} in {sent:?}");
        }
    });
}
