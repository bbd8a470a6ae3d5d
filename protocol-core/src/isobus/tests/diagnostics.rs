use super::*;
use crate::isobus::diagnostics::{Dm1, answer_dm2};
use crate::isobus::transport::BamSender;
use crate::time::NEVER;
use crate::wire::dm::{Lamp, Trouble, payload_len};
use crate::wire::dtc::Dtc;

const SUPPLY_LOW: Trouble = Trouble { lamp: Lamp::AMBER, dtc: Dtc::from_printed(0x04_0273), count: 1 };
const SUPPLY_HIGH: Trouble = Trouble { lamp: Lamp::AMBER, dtc: Dtc::from_printed(0x03_0273), count: 2 };
const SPOOL: Trouble = Trouble { lamp: Lamp::RED, dtc: Dtc::from_printed(0x87_8FEC), count: 1 };
const INTERNAL: Trouble = Trouble { lamp: Lamp::RED, dtc: Dtc::from_printed(0x8B_8FFA), count: 127 };

const LOW: &str = "18FECA83: 04 FF 73 02 04 01 FF FF";
const AT_SPOOL: &str = "18FECA83: 10 FF EC 8F 87 01 FF FF";
const NOTHING: &str = "18FECA83: 00 FF 00 00 00 00 FF FF";

type Bam = BamSender<{ payload_len(8) }>;

/// The frame that is due now, which is on the bus at once.
fn next(bam: &mut Bam, now: Instant) -> Option<Frame> {
    let frame = bam.poll(OWN, now);
    bam.sent(now);
    frame
}

#[test]
fn nothing_is_sent_before_anything_was_active() {
    let mut dm1 = Dm1::new();
    dm1.set(None, ms(0));
    assert_eq!((dm1.deadline(), dm1.poll(OWN, ms(10_000))), (NEVER, None));
    assert_eq!(text(Some(dm1.frame(OWN))), NOTHING);
}

#[test]
fn at_once_then_every_1000_ms() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(40));
    assert_eq!(text(dm1.poll(OWN, ms(40))), LOW);
    for n in 0..5 {
        let due = 1_040 + 1_000 * n;
        assert_eq!(dm1.deadline(), ms(due));
        assert_eq!(dm1.poll(OWN, us(due * 1_000 - 1)), None);
        assert_eq!(text(dm1.poll(OWN, ms(due))), LOW);
    }
}

#[test]
fn the_same_fault_again_is_no_event() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(0));
    assert_eq!(text(dm1.poll(OWN, ms(0))), LOW);
    dm1.set(Some(SUPPLY_LOW), ms(500));
    assert_eq!(dm1.poll(OWN, ms(500)), None);
    assert_eq!(dm1.deadline(), ms(1_000));
}

#[test]
fn another_fault_is_told_at_once_and_restarts_the_period() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(0));
    assert_eq!(text(dm1.poll(OWN, ms(0))), LOW);
    dm1.set(Some(SPOOL), ms(700));
    assert_eq!(text(dm1.poll(OWN, ms(700))), AT_SPOOL);
    assert_eq!(dm1.poll(OWN, us(1_699_999)), None);
    assert_eq!(text(dm1.poll(OWN, ms(1_700))), AT_SPOOL);
    dm1.set(Some(SUPPLY_LOW), ms(1_800));
    assert_eq!(text(dm1.poll(OWN, ms(1_800))), LOW);
    assert_eq!(dm1.deadline(), ms(2_800));
}

#[test]
fn the_counter_alone_is_an_event() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(0));
    assert_eq!(text(dm1.poll(OWN, ms(0))), LOW);
    dm1.set(Some(Trouble { count: 2, ..SUPPLY_LOW }), ms(1));
    assert_eq!(text(dm1.poll(OWN, ms(1))), "18FECA83: 04 FF 73 02 04 02 FF FF");
}

#[test]
fn the_end_is_told_once() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(0));
    assert_eq!(text(dm1.poll(OWN, ms(0))), LOW);
    dm1.set(None, ms(100));
    assert_eq!(text(dm1.poll(OWN, ms(100))), NOTHING);
    assert_eq!((dm1.deadline(), dm1.poll(OWN, ms(100_000))), (NEVER, None));
}

#[test]
fn a_request_leaves_the_period_alone() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(0));
    assert_eq!(text(dm1.poll(OWN, ms(0))), LOW);
    assert_eq!(text(Some(dm1.frame(OWN))), LOW);
    assert_eq!(dm1.deadline(), ms(1_000));
}

#[test]
fn what_was_due_in_the_claim_s_wait_comes_after_it() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(10));
    assert_eq!(text(dm1.poll(OWN, ms(250))), LOW);
    assert_eq!(dm1.deadline(), ms(1_250));
}

#[test]
fn a_long_pause_is_followed_by_no_burst() {
    let mut dm1 = Dm1::new();
    dm1.set(Some(SUPPLY_LOW), ms(0));
    assert_eq!(text(dm1.poll(OWN, ms(0))), LOW);
    // A little late: the rhythm stays.
    assert_eq!(text(dm1.poll(OWN, ms(1_003))), LOW);
    assert_eq!(dm1.deadline(), ms(2_000));
    assert_eq!(text(dm1.poll(OWN, ms(5_500))), LOW);
    assert_eq!(dm1.deadline(), ms(6_500));
}

#[test]
fn dm2_with_none_and_with_one_is_a_frame() {
    let mut bam = Bam::new();
    assert_eq!(text(answer_dm2(&[], OWN, &mut bam, ms(0))), "18FECB83: 00 FF 00 00 00 00 FF FF");
    assert_eq!(text(answer_dm2(&[SPOOL], OWN, &mut bam, ms(0))), "18FECB83: 10 FF EC 8F 87 01 FF FF");
    assert!(!bam.is_busy());
}

#[test]
fn dm2_with_four_is_a_bam() {
    let mut bam = Bam::new();
    let list = [SPOOL, INTERNAL, SUPPLY_HIGH, SUPPLY_LOW];
    assert_eq!(answer_dm2(&list, OWN, &mut bam, ms(0)), None);
    let mut now = ms(0);
    for expected in [
        "1CECFF83: 20 12 00 03 FF CB FE 00",
        "1CEBFF83: 01 10 FF EC 8F 87 01 FA",
        "1CEBFF83: 02 8F 8B 7F 73 02 03 02",
        "1CEBFF83: 03 73 02 04 01 FF FF FF",
    ] {
        assert_eq!(text(next(&mut bam, now)), expected);
        now = bam.deadline();
    }
    assert_eq!(now, NEVER);
}

#[test]
fn dm2_with_two_has_the_lamp_of_the_more_severe() {
    let mut bam = Bam::new();
    assert_eq!(answer_dm2(&[INTERNAL, SUPPLY_LOW], OWN, &mut bam, ms(0)), None);
    assert_eq!(text(next(&mut bam, ms(0))), "1CECFF83: 20 0A 00 02 FF CB FE 00");
    assert_eq!(text(next(&mut bam, ms(100))), "1CEBFF83: 01 10 FF FA 8F 8B 7F 73");
    assert_eq!(text(next(&mut bam, ms(200))), "1CEBFF83: 02 02 04 01 FF FF FF FF");
}

#[test]
fn dm2_during_a_bam_is_dropped() {
    let mut bam = Bam::new();
    assert_eq!(answer_dm2(&[SPOOL, SUPPLY_LOW], OWN, &mut bam, ms(0)), None);
    assert!(next(&mut bam, ms(0)).is_some());
    let due = bam.deadline();
    assert_eq!(answer_dm2(&[SPOOL, SUPPLY_HIGH], OWN, &mut bam, ms(10)), None);
    assert_eq!(answer_dm2(&[SPOOL], OWN, &mut bam, ms(10)), None);
    assert_eq!(bam.deadline(), due);
    assert_eq!(text(next(&mut bam, due)), "1CEBFF83: 01 10 FF EC 8F 87 01 73");
    assert_eq!(text(next(&mut bam, ms(500))), "1CEBFF83: 02 02 04 01 FF FF FF FF");
    assert!(answer_dm2(&[SPOOL], OWN, &mut bam, ms(1_000)).is_some());
}
