//! The node with a fictitious product: a pump that is commanded, reports a level, and has trouble codes.

use std::vec::Vec;

use super::*;
use crate::controller::Filter;
use crate::isobus::diagnostics::PERIOD;
use crate::isobus::node::{Indication, Product, Rules, Service};
use crate::time::{Duration, NEVER, after};
use crate::wire::dm::{Lamp, Trouble, payload_len};
use crate::wire::dtc::Dtc;
use crate::wire::j1939_id::Pgn;

const RULES: Rules = Rules {
    command: |_| Pgn::new(0xFF10),
    other_protocol: |own| Filter { key: 0x3BC0_0000 | u32::from(own.get()), mask: !0x003F_F800 },
    report: |_| Pgn::new(0xFF20),
    report_period: Duration::from_millis(500),
};

const CLAIM: &str = "18EEFF83: 01 00 20 07 08 FF 02 20";
const CANNOT_CLAIM: &str = "18EEFFFE: 01 00 20 07 08 FF 02 20";
const LOSE: &str = "18EEFF83: 00 00 20 07 08 FF 02 20";
const CLEAR: &str = "18FECA83: 00 FF 00 00 00 00 FF FF";
const EMPTY: &str = "0CFF2083: 00 00 00 00 00 00 00 00";
const LEAK: Trouble = Trouble { lamp: Lamp::RED, dtc: Dtc::new(520_192, 1), count: 1 };
const DRY: Trouble = Trouble { lamp: Lamp::AMBER, dtc: Dtc::new(520_193, 1), count: 3 };

#[derive(Default)]
struct Pump {
    level: u8,
    previously_active: Vec<Trouble>,
}

impl Product for Pump {
    fn report(&self, _: Instant) -> [u8; 8] {
        [self.level, 0, 0, 0, 0, 0, 0, 0]
    }

    fn previously_active(&self) -> impl Iterator<Item = Trouble> + Clone {
        self.previously_active.iter().copied()
    }
}

/// A node and a controller with `room` mailboxes, on a free or blocked bus.
struct Rig {
    node: super::super::node::Node<{ payload_len(4) }>,
    product: Pump,
    now: Instant,
    room: usize,
    /// The pending frames of the controller.
    mailboxes: Vec<Frame>,
    blocked: bool,
    sent: Vec<Frame>,
}

impl Rig {
    fn new() -> Self {
        let node = super::super::node::Node::new(&RULES, NAME, OWN);
        let product = Pump::default();
        Self { node, product, now: ms(1000), room: 3, mailboxes: Vec::new(), blocked: false, sent: Vec::new() }
    }

    /// Returns a node that has completed the wait and sent its frames.
    fn claimed() -> Self {
        let mut rig = Self::new();
        rig.pump();
        rig.advance(250);
        rig.expect(&[CLAIM, EMPTY]);
        rig
    }

    fn pump(&mut self) {
        while {
            while let Some(filter) = self.node.take_abort() {
                self.mailboxes.retain(|frame| !filter.passes(frame));
            }
            while let Some(frame) = self.node.next_frame(self.now, &self.product) {
                if self.mailboxes.len() == self.room {
                    self.node.give_back(frame);
                    break;
                }
                self.mailboxes.push(frame);
            }
            if !self.blocked {
                self.mailboxes.sort_by_key(Frame::arbitration);
                self.sent.append(&mut self.mailboxes);
            }
            if self.mailboxes.is_empty() {
                self.node.all_sent(self.now);
            }
            self.node.has_frame() && self.mailboxes.len() < self.room
        } {}
    }

    fn advance(&mut self, ms: u64) {
        let end = after(self.now, Duration::from_millis(ms));
        while self.node.deadline() <= end {
            self.now = self.node.deadline();
            self.node.run_timers(self.now);
            assert!(self.node.deadline() > self.now);
            self.pump();
        }
        self.now = end;
    }

    fn send(&mut self, text: &str) -> Indication {
        let frame = frame(text);
        let service = self.node.service(&frame).expect(text);
        let indication = self.node.handle(service, &frame, self.now);
        self.pump();
        indication
    }

    fn block(&mut self, blocked: bool) {
        self.blocked = blocked;
        self.pump();
    }

    fn set_active(&mut self, active: Option<Trouble>) {
        self.node.set_active(active, self.now);
        self.pump();
    }

    #[track_caller]
    fn expect(&mut self, frames: &[&str]) {
        let sent: Vec<_> = self.sent.drain(..).map(|frame| text(Some(frame))).collect();
        assert_eq!(sent, frames);
    }
}

#[test]
fn a_claim_then_reports() {
    let mut rig = Rig::new();
    rig.pump();
    rig.expect(&[CLAIM]);
    rig.advance(249);
    rig.expect(&[]);
    rig.advance(1);
    rig.expect(&[EMPTY]);
    rig.product.level = 7;
    rig.advance(500);
    rig.expect(&["0CFF2083: 07 00 00 00 00 00 00 00"]);
}

/// After a pause only one report is sent; after a whole period the cycle restarts.
#[test]
fn a_late_report() {
    for (late, until_next) in [(200, 300), (499, 1), (500, 500), (700, 500)] {
        let mut rig = Rig::claimed();
        rig.now += Duration::from_millis(500 + late);
        rig.node.run_timers(rig.now);
        assert_eq!(rig.node.deadline(), after(rig.now, Duration::from_millis(until_next)), "{late} ms late");
        rig.pump();
        rig.expect(&[EMPTY]);
    }
}

#[test]
fn what_the_product_learns() {
    let mut rig = Rig::claimed();
    assert_eq!(rig.send("0CFF1027: 01"), Indication::Command);
    let indication = rig.send("18EA8327: CC FE 00");
    let Indication::ClearPreviouslyActive(request) = indication else { panic!("{indication:?}") };
    rig.expect(&[]);
    rig.node.acknowledge(&request, false);
    rig.pump();
    rig.expect(&["18E8FF83: 01 FF FF FF 27 CC FE 00"]);
    assert_eq!(rig.send("1CECFF27: 20 09 00 02 FF D8 FE 00"), Indication::Nothing);
    assert_eq!(rig.send("1CEBFF27: 01 01 00 20 07 08 FF 02"), Indication::Nothing);
    assert_eq!(rig.send("1CEBFF27: R8"), Indication::Nothing, "spoils no broadcast");
    let commanded = rig.send("1CEBFF27: 02 20 81 FF FF FF FF FF");
    assert_eq!(commanded, Indication::CommandedAddress(Address::new(0x81)));
    assert_eq!(rig.send("1BC78883: 03 22 F0 10"), Indication::OtherProtocol);
    assert_eq!(rig.send(LOSE), Indication::AddressLost);
    assert_eq!(rig.node.service(&frame("0CFF1027: 01")), None, "ignores everybody");
}

/// The order is the same whether the controller or the node sorts the frames.
#[test]
fn answers_and_messages_in_the_order_of_arbitration() {
    for room in [9, 1] {
        let mut rig = Rig::claimed();
        rig.block(true);
        rig.room = 0;
        for request in ["CB FE 00", "CA FE 00", "00 EE 00", "00 12 00", "20 FF 00", "00 13 00"] {
            rig.send(&std::format!("18EA8327: {request}"));
        }
        rig.send("1CEC8327: 10 09 00 02 FF D8 FE 00");
        rig.room = room;
        rig.block(false);
        rig.expect(&[
            EMPTY,
            "18E8FF83: 01 FF FF FF 27 00 12 00",
            "18E8FF83: 01 FF FF FF 27 00 13 00",
            CLAIM,
            CLEAR,
            "18FECB83: 00 FF 00 00 00 00 FF FF",
            "1CEC2783: FF 02 FF FF FF D8 FE 00",
        ]);
    }
}

/// Frames waiting in the mailboxes are replaced: the present state is sent once.
#[test]
fn a_blocked_bus_is_followed_by_the_present_state() {
    let mut rig = Rig::claimed();
    rig.block(true);
    for toggle in 0..15 {
        rig.product.level = toggle;
        rig.set_active(Some(Trouble { count: toggle, ..LEAK }));
        rig.advance(1000);
    }
    rig.set_active(Some(DRY));
    rig.set_active(None);
    assert!(rig.mailboxes.len() <= 2, "{:?}", rig.mailboxes);
    rig.block(false);
    rig.expect(&["0CFF2083: 0E 00 00 00 00 00 00 00", CLEAR]);
}

#[test]
fn a_burst_of_requests_owes_one_claim() {
    for room in [0, 1, 3] {
        let mut rig = Rig::claimed();
        rig.room = room;
        rig.block(true);
        rig.set_active(Some(LEAK));
        for _ in 0..600 {
            rig.send("18EAFF27: 00 EE 00");
        }
        assert_eq!(rig.node.dropped(), 0);
        rig.room = 3;
        rig.block(false);
        rig.expect(&[CLAIM, "18FECA83: 10 FF 00 F0 E1 01 FF FF"]);
    }
}

#[test]
fn answers_without_room_are_counted() {
    let mut rig = Rig::claimed();
    rig.room = 0;
    rig.block(true);
    for group in 0..20 {
        rig.send(&std::format!("18EA8327: 00 {group:02X} 00"));
    }
    assert_eq!(rig.node.dropped(), 12);
    rig.room = 3;
    rig.block(false);
    assert_eq!(rig.sent.len(), 8);
}

/// After the loss of the address no frame is sent, neither from the controller nor returned by it.
#[test]
fn a_lost_address_empties_the_controller() {
    let mut rig = Rig::claimed();
    rig.block(true);
    rig.set_active(Some(LEAK));
    rig.send("18EA8327: 00 12 00");
    rig.send("18EA8327: CA FE 00");
    let mut taken = rig.mailboxes.clone();
    assert_eq!(taken.len(), 2);
    rig.node.handle(Service::Claim, &frame(LOSE), rig.now);
    assert_eq!(rig.node.take_abort(), Some(Filter::ALL));
    taken.push(frame(CLAIM));
    for frame in taken {
        rig.node.give_back(frame);
    }
    rig.mailboxes.clear();
    rig.block(false);
    rig.advance(153);
    rig.expect(&[CANNOT_CLAIM]);
    rig.advance(10_000);
    rig.set_active(None);
    rig.expect(&[]);
    assert_eq!(rig.node.deadline(), NEVER);
}

#[test]
fn a_broadcast_that_the_bus_keeps_waiting_is_given_up() {
    let mut rig = Rig::claimed();
    rig.product.previously_active = std::vec![LEAK, DRY];
    rig.send("18EA8327: CB FE 00");
    rig.expect(&["1CECFF83: 20 0A 00 02 FF CB FE 00"]);
    rig.block(true);
    rig.advance(199);
    assert!(rig.mailboxes.contains(&frame("1CEBFF83: 01 10 FF 00 F0 E1 01 01")));
    rig.advance(1);
    assert_eq!((rig.mailboxes.len(), rig.node.dropped()), (0, 1));
    rig.block(false);
    rig.advance(200);
    rig.expect(&[]);
    // The next request is answered completely.
    rig.send("18EA8327: CB FE 00");
    rig.advance(200);
    rig.sent.retain(|frame| frame.key() >> 24 & 0x1F == 0x1C);
    assert_eq!(rig.sent.len(), 3);
}

/// A packet in the controller is sent, and the next one follows, even if the controller returns another message
/// meanwhile.
#[test]
fn a_broadcast_goes_on_when_another_message_is_given_back() {
    let mut rig = Rig::claimed();
    rig.product.previously_active = std::vec![LEAK, DRY];
    rig.send("18EA8327: CB FE 00");
    rig.block(true);
    rig.room = 1;
    rig.advance(100);
    assert_eq!(rig.mailboxes, [frame("1CEBFF83: 01 10 FF 00 F0 E1 01 01")]);
    rig.send("18EA8327: CA FE 00");
    rig.block(false);
    rig.advance(100);
    rig.expect(&[
        "1CECFF83: 20 0A 00 02 FF CB FE 00",
        "1CEBFF83: 01 10 FF 00 F0 E1 01 01",
        CLEAR,
        "1CEBFF83: 02 F0 E1 03 FF FF FF FF",
    ]);
}

#[test]
fn a_restart_gives_a_broadcast_up() {
    let mut rig = Rig::claimed();
    rig.product.previously_active = std::vec![LEAK, DRY];
    rig.send("18EA8327: CB FE 00");
    rig.expect(&["1CECFF83: 20 0A 00 02 FF CB FE 00"]);
    rig.node.restart(NAME, Address::new(0x81));
    rig.pump();
    assert_eq!(rig.node.dropped(), 1);
    rig.advance(1000);
    rig.sent.retain(|frame| frame.key() >> 24 & 0x1F != 0x0C);
    rig.expect(&["18EEFF81: 01 00 20 07 08 FF 02 20"]);
}

/// A broadcast not yet begun is not abandoned: after the blocked bus it carries the list of that time.
#[test]
fn a_broadcast_that_has_not_begun_waits() {
    let mut rig = Rig::claimed();
    rig.product.previously_active = std::vec![LEAK, DRY];
    rig.block(true);
    rig.send("18EA8327: CB FE 00");
    assert_eq!(rig.mailboxes, [frame("1CECFF83: 20 0A 00 02 FF CB FE 00")]);
    rig.advance(450);
    rig.product.previously_active = std::vec![DRY];
    rig.advance(450);
    rig.mailboxes.retain(|frame| frame.key() & 0xFF_FFFF != 0xFF_2083);
    assert_eq!(rig.mailboxes, [frame("18FECB83: 04 FF 01 F0 E1 03 FF FF")]);
    assert_eq!(rig.node.dropped(), 0);
}

/// A code does not count as reported while its DM1 waits in the controller, nor after the controller returned the DM1
/// or lost it in bus-off.
#[test]
fn a_code_is_told_when_its_dm1_is_on_the_bus() {
    let mut rig = Rig::claimed();
    assert_eq!(rig.node.reported(), None);
    rig.block(true);
    rig.set_active(Some(LEAK));
    assert_eq!(rig.node.reported(), None);
    rig.node.give_back(rig.mailboxes.remove(0));
    assert_eq!(rig.node.reported(), None);
    rig.pump();
    rig.mailboxes.clear();
    rig.node.set_bus_off(true);
    rig.block(false);
    assert_eq!(rig.node.reported(), None);
    rig.node.set_bus_off(false);
    rig.pump();
    assert_eq!(rig.node.reported(), Some(LEAK));
}

/// The node does not object during the wait after the claim; it objects once after the wait, and again after five
/// seconds.
#[test]
fn another_controller_under_the_own_address() {
    let mut rig = Rig::new();
    rig.pump();
    rig.send("18FF3083: 01");
    rig.advance(250);
    rig.expect(&[CLAIM, EMPTY]);
    rig.send("18FF3083: R8");
    rig.expect(&[]);
    for text in ["18FF3083: 01", "0CFF1083: 01", "18EF2783: 01", "1AFF3083: 01"] {
        rig.send(text);
    }
    rig.expect(&[CLAIM]);
    rig.advance(4_999);
    rig.sent.clear();
    rig.send("18FF3083: 01");
    rig.expect(&[]);
    rig.advance(1);
    rig.sent.clear();
    rig.send("18FF3083: 01");
    rig.expect(&[CLAIM]);
    for (other, service) in [
        ("13FF3083: 01", None),
        ("283: 01", None),
        ("1BC78883: 03 22 F0 10", Some(Service::OtherProtocol)),
        ("1BC78884: 03 22 F0 10", None),
    ] {
        assert_eq!(rig.node.service(&frame(other)), service, "{other}");
    }
}

/// In bus-off only DM1 and claims stay pending.
#[test]
fn bus_off() {
    let mut rig = Rig::claimed();
    rig.block(true);
    rig.send("18EA8327: 00 12 00");
    rig.send("18EA8327: 00 EE 00");
    let lost = core::mem::take(&mut rig.mailboxes);
    assert_eq!(lost.len(), 2);
    rig.node.set_bus_off(true);
    for frame in lost {
        rig.node.give_back(frame);
    }
    rig.set_active(Some(LEAK));
    rig.send("18EA8327: 20 FF 00");
    rig.block(false);
    rig.advance(600);
    rig.expect(&[]);
    rig.node.set_bus_off(false);
    rig.pump();
    rig.expect(&[CLAIM, "18FECA83: 10 FF 00 F0 E1 01 FF FF"]);
    rig.advance(PERIOD.as_millis());
    assert_eq!(rig.sent.last().copied(), Some(frame("18FECA83: 10 FF 00 F0 E1 01 FF FF")));

    let mut rig = Rig::new();
    rig.block(true);
    rig.mailboxes.clear();
    rig.node.set_bus_off(true);
    rig.block(false);
    rig.advance(1000);
    rig.expect(&[]);
    rig.node.set_bus_off(false);
    rig.pump();
    rig.expect(&[CLAIM]);
}
