use super::*;
use crate::isobus::Outcome;
use crate::isobus::diagnostics::Dm1;
use crate::time::NEVER;
use crate::wire::dm::{Lamp, Trouble};
use crate::wire::dtc::Dtc;

const SUPPLY_LOW: Trouble = Trouble { lamp: Lamp::AMBER, dtc: Dtc::from_printed(0x04_0273), count: 1 };
const SPOOL: Trouble = Trouble { lamp: Lamp::RED, dtc: Dtc::from_printed(0x87_8FEC), count: 1 };

const LOW: &str = "18FECA83: 04 FF 73 02 04 01 FF FF";
const AT_SPOOL: &str = "18FECA83: 10 FF EC 8F 87 01 FF FF";
const NOTHING: &str = "18FECA83: 00 FF 00 00 00 00 FF FF";

/// Returns the message that is due now, by a change or by the period.
fn due(dm1: &mut Dm1, now: Instant) -> Option<Frame> {
    (dm1.poll(now) == Outcome::Pending).then(|| dm1.render(OWN, now))
}

/// Returns the message of a change.
fn event(dm1: &mut Dm1, active: Option<Trouble>, now: Instant) -> Option<Frame> {
    (dm1.set(active, now) == Outcome::Pending).then(|| dm1.render(OWN, now))
}

#[test]
fn nothing_is_sent_before_anything_was_active() {
    let mut dm1 = Dm1::new();
    assert_eq!(event(&mut dm1, None, ms(0)), None);
    assert_eq!((dm1.deadline(), due(&mut dm1, ms(10_000))), (NEVER, None));
    assert_eq!(text(Some(dm1.render(OWN, ms(10_000)))), NOTHING);
}

#[test]
fn at_once_then_every_1000_ms() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(40))), LOW);
    for n in 0..5 {
        let at = 1_040 + 1_000 * n;
        assert_eq!(dm1.deadline(), ms(at));
        assert_eq!(due(&mut dm1, us(at * 1_000 - 1)), None);
        assert_eq!(text(due(&mut dm1, ms(at))), LOW);
    }
}

#[test]
fn the_same_fault_again_is_no_event() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(0))), LOW);
    assert_eq!(event(&mut dm1, Some(SUPPLY_LOW), ms(500)), None);
    assert_eq!(due(&mut dm1, ms(500)), None);
    assert_eq!(dm1.deadline(), ms(1_000));
}

#[test]
fn another_fault_is_told_at_once_and_restarts_the_period() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(0))), LOW);
    assert_eq!(text(event(&mut dm1, Some(SPOOL), ms(700))), AT_SPOOL);
    assert_eq!(due(&mut dm1, us(1_699_999)), None);
    assert_eq!(text(due(&mut dm1, ms(1_700))), AT_SPOOL);
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(1_800))), LOW);
    assert_eq!(dm1.deadline(), ms(2_800));
}

#[test]
fn the_counter_alone_is_an_event() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(0))), LOW);
    assert_eq!(
        text(event(&mut dm1, Some(Trouble { count: 2, ..SUPPLY_LOW }), ms(1))),
        "18FECA83: 04 FF 73 02 04 02 FF FF"
    );
}

#[test]
fn the_end_is_told_once() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(0))), LOW);
    assert_eq!(text(event(&mut dm1, None, ms(100))), NOTHING);
    assert_eq!((dm1.deadline(), due(&mut dm1, ms(100_000))), (NEVER, None));
}

#[test]
fn a_request_leaves_the_period_alone() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(0))), LOW);
    assert_eq!(text(Some(dm1.render(OWN, ms(600)))), LOW);
    assert_eq!(dm1.deadline(), ms(1_000));
}

/// The period starts with the frame of the change, however long the frame waited for the bus.
#[test]
fn the_period_begins_when_a_change_goes_out() {
    let mut dm1 = Dm1::new();
    assert_eq!(dm1.set(Some(SUPPLY_LOW), ms(10)), Outcome::Pending);
    assert_eq!((dm1.deadline(), dm1.poll(ms(5_000))), (NEVER, Outcome::Nothing));
    assert_eq!(text(Some(dm1.render(OWN, ms(5_250)))), LOW);
    assert_eq!(dm1.deadline(), ms(6_250));
}

/// A code that cleared at once precedes the present state, but only at that time.
#[test]
fn a_passing_code() {
    let mut dm1 = Dm1::new();
    assert_eq!(dm1.set(Some(SPOOL), ms(40)), Outcome::Pending);
    assert_eq!(dm1.set(None, ms(40)), Outcome::Pending);
    assert_eq!(text(Some(dm1.render(OWN, ms(40)))), AT_SPOOL);
    assert_eq!((dm1.sent(), dm1.deadline()), (Outcome::Pending, ms(1_040)));
    assert_eq!(text(Some(dm1.render(OWN, ms(40)))), NOTHING);
    assert_eq!((dm1.sent(), dm1.deadline()), (Outcome::Nothing, NEVER));

    assert_eq!(dm1.set(Some(SPOOL), ms(100)), Outcome::Pending);
    assert_eq!(dm1.set(Some(SUPPLY_LOW), ms(100)), Outcome::Pending);
    assert_eq!(text(Some(dm1.render(OWN, us(100_001)))), LOW);
    assert_eq!(dm1.sent(), Outcome::Nothing);

    // A code not reported before it cleared is not reported later.
    assert_eq!(dm1.set(Some(SPOOL), ms(200)), Outcome::Pending);
    assert_eq!(dm1.set(None, ms(201)), Outcome::Pending);
    assert_eq!(text(Some(dm1.render(OWN, ms(201)))), NOTHING);
    assert_eq!(dm1.sent(), Outcome::Nothing);
}

#[test]
fn a_long_pause_is_followed_by_no_burst() {
    let mut dm1 = Dm1::new();
    assert_eq!(text(event(&mut dm1, Some(SUPPLY_LOW), ms(0))), LOW);
    // Slightly late: the cycle stays.
    assert_eq!(text(due(&mut dm1, ms(1_003))), LOW);
    assert_eq!(dm1.deadline(), ms(2_000));
    assert_eq!(text(due(&mut dm1, ms(5_500))), LOW);
    assert_eq!(dm1.deadline(), ms(6_500));
}
