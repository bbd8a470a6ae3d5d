//! A bus that takes nothing for a while: no request is lost without a word (SPEC 9).

use super::booted;

/// Answers do not go stale, and each request is answered or counted.
#[test]
fn every_request_is_answered_or_counted() {
    const REQUESTS: usize = 20;
    let mut rig = booted();
    rig.hold_bus(true);
    for _ in 0..REQUESTS {
        rig.send("601: 40 01 10 00 00 00 00 00");
    }
    rig.hold_bus(false);
    let sent = rig.take();
    assert!(sent.iter().all(|frame| frame == "581: 4F 01 10 00 00 00 00 00"), "{sent:#?}");
    let dropped = usize::try_from(rig.device().frames_dropped()).unwrap();
    assert!(dropped > 1);
    assert_eq!(sent.len() + dropped, REQUESTS);
}
