//! The SDO server, for each kind of node.

use tests::lss::{INQUIRE_NODE_ID, TO_CONFIGURATION, answer};
use tests::sdo;

use super::kinds::each_kind;

/// Answers that wait for the bus do not go stale: the first of them are sent, and each that is not counts as dropped.
#[test]
fn every_request_is_answered_or_counted() {
    each_kind(|kind| {
        let mut node = kind.booted();
        let sdo_answer = node.sdo(0x40, 0x1001, 0, 0).to_string();
        let answers = [answer(&format!("5E {:02X}", kind.node_id)), sdo_answer];
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
