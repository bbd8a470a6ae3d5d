//! The rules of the valves on ISOBUS (SPEC 5).

use hal_sim::{Duration, Frame, Instant};
use protocol_core::frame::{Id, extended};

use super::super::ledger::Ledger;
use super::super::rig::Rig;
use super::{Ending, assert_period, cut};

/// The AVEF of a valve that is blocked and in neutral.
const BLOCKED: [u8; 8] = [0x7D, 0x7D, 0x30, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF];
/// DM1 without an active fault, DM2 without a previously active one.
const NO_FAULT: [u8; 8] = [0x00, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF];
/// The lamp and the DTC of the fault that can last without a disturbance.
const INTERNAL: [u8; 5] = [0x10, 0xFF, 0xFA, 0x8F, 0x8B];
const TIME_GUARDING: [u8; 5] = [0x04, 0xFF, 0xE9, 0x8F, 0x93];

const AVEF_PERIOD: Duration = Duration::from_millis(100);
const DM1_PERIOD: Duration = Duration::from_secs(1);
/// The address of the master.
const MASTER: u32 = 0x27;

type Sent = Vec<(Instant, Frame)>;

pub(super) fn last_word(rig: &mut Rig, unit: usize, ending: Ending) {
    match rig.id(unit) {
        Some(address) => {
            let fault = quiet(rig, unit, address);
            requests(rig, unit, address, fault);
        }
        None => lost(rig, unit),
    }
    cut(rig, unit, ending);
    rig.power_on(unit);
    let booted = rig.watch(unit, Duration::from_millis(240));
    let address = rig.id(unit).expect("an address");
    assert!(matches!(&booted[..], [(_, claim)] if is_claim(claim, address)), "{booted:?}");
    rig.watch(unit, Duration::from_millis(100));
    Ledger::check(rig, unit);
    let fault = quiet(rig, unit, address);
    if fault.is_some() {
        return;
    }
    serves(rig, unit, address);
}

fn is_claim(frame: &Frame, address: u8) -> bool {
    frame.id() == message(0x18EE_FF00, address) && frame.data()[1..] == [0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20]
}

fn message(id: u32, address: u8) -> Id {
    extended(id | u32::from(address)).into()
}

/// Splits the sent frames by an identifier.
fn split(sent: Sent, id: Id) -> (Sent, Sent) {
    sent.into_iter().partition(|(_, frame)| frame.id() == id)
}

fn avef(address: u8) -> Id {
    message(0x0CFE_1000 | u32::from(address & 0xF) << 8, address)
}

/// Asserts that a valve without commands sends AVEF each 100 ms, blocked, and DM1 each second while a fault is active.
fn quiet(rig: &mut Rig, unit: usize, address: u8) -> Option<Frame> {
    let sent = rig.watch(unit, Duration::from_millis(3_050));
    let (flows, sent) = split(sent, avef(address));
    assert!((30..=31).contains(&flows.len()), "{} times AVEF", flows.len());
    assert!(flows.iter().all(|(_, flow)| flow.data() == BLOCKED), "{flows:?}");
    assert_period(rig, &flows, AVEF_PERIOD);
    let (faults, others) = split(sent, message(0x18FE_CA00, address));
    assert_eq!(others, []);
    assert_period(rig, &faults, DM1_PERIOD);
    let fault = faults.first()?.1;
    assert!((3..=4).contains(&faults.len()) && faults.iter().all(|(_, frame)| *frame == fault), "{faults:?}");
    let is_hurt = rig.units[unit].memory_hurt || rig.units[unit].damaged;
    let cause: [u8; 5] = fault.data()[..5].try_into().expect("five bytes");
    assert!(cause == TIME_GUARDING || cause == INTERNAL && is_hurt, "{fault}");
    assert!((1..=127).contains(&fault.data()[5]), "{fault}");
    Some(fault)
}

/// Sends a request for a parameter group. Returns the answers, without AVEF and the cyclic DM1.
fn request(rig: &mut Rig, unit: usize, group: u32, destination: u8) -> Sent {
    let [a, b, c, _] = group.to_le_bytes();
    let id = extended(0x18EA_0000 | u32::from(destination) << 8 | MASTER);
    rig.forget_sent();
    rig.send(Frame::of(id.into(), &[a, b, c]).expect("three bytes"));
    rig.watch(unit, Duration::from_millis(80))
}

/// Asserts that each request is answered exactly once.
fn requests(rig: &mut Rig, unit: usize, address: u8, fault: Option<Frame>) {
    let others = |sent: Sent| split(sent, avef(address)).1;
    // The request falls between two cyclic messages.
    let without_cyclic = |sent: Sent| split(others(sent), message(0x18FE_CA00, address)).1;
    let claims = without_cyclic(request(rig, unit, 0xEE00, address));
    assert!(matches!(&claims[..], [(_, claim)] if is_claim(claim, address)), "{claims:?}");
    let faults = others(request(rig, unit, 0xFECA, 0xFF));
    let expected = fault.map_or(NO_FAULT, |fault| *fault.bytes());
    assert!(matches!(faults.len(), 1..=2) && faults.iter().all(|(_, frame)| *frame.bytes() == expected), "{faults:?}");
    let refused = without_cyclic(request(rig, unit, 0xFF00, address));
    let nack = [1, 0xFF, 0xFF, 0xFF, MASTER as u8, 0x00, 0xFF, 0x00];
    assert!(
        matches!(&refused[..], [(_, frame)] if *frame.bytes() == nack && frame.id() == message(0x18E8_FF00, address)),
        "{refused:?}"
    );
    assert_eq!(without_cyclic(request(rig, unit, 0xFF00, 0xFF)), []);
    let mut previously = without_cyclic(request(rig, unit, 0xFECB, address));
    let (_, first) = previously.first().expect("DM2");
    if first.id() == message(0x18FE_CB00, address) {
        assert_eq!(previously.len(), 1);
    } else {
        // DM2 is a broadcast in packets, 100 ms apart.
        assert_eq!(first.id(), message(0x1CEC_FF00, address), "{first}");
        let packets = first.data()[3];
        let more = rig.watch(unit, Duration::from_millis(100) * u32::from(packets));
        previously.extend(without_cyclic(more));
        assert_eq!(previously.len(), 1 + usize::from(packets), "{previously:?}");
    }
}

/// Asserts that a valve without an address sends cannot-claims only.
fn lost(rig: &mut Rig, unit: usize) {
    assert_eq!(rig.watch(unit, Duration::from_secs(2)), []);
    assert_eq!(request(rig, unit, 0xFECA, 0xFF), []);
    let mut sent = request(rig, unit, 0xEE00, 0xFF);
    sent.extend(rig.watch(unit, Duration::from_millis(100)));
    assert!(matches!(&sent[..], [(_, claim)] if is_claim(claim, 0xFE)), "{sent:?}");
}

/// Asserts the work of a valve after its power-up: it moves, stops without commands, and recovers.
fn serves(rig: &mut Rig, unit: usize, address: u8) {
    let command = |rig: &mut Rig, flow: u8, state: u8| {
        let id = extended(0x0CFE_3000 | u32::from(address & 0xF) << 8 | MASTER);
        rig.send(Frame::full(id.into(), [flow, 0xFF, state, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]));
        split(rig.watch(unit, AVEF_PERIOD), avef(address))
    };
    for _ in 0..4 {
        command(rig, 250, 0x31);
    }
    let (flows, others) = command(rig, 250, 0x31);
    let full = [0xE1, 0x7D, 0x31, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF];
    assert!(others.is_empty() && flows.iter().all(|(_, flow)| *flow.bytes() == full), "{flows:?} {others:?}");
    rig.watch(unit, Duration::from_millis(500));
    let (flows, _) = split(rig.watch(unit, AVEF_PERIOD), avef(address));
    assert!(flows.iter().all(|(_, flow)| *flow.bytes() == BLOCKED), "time guarding: {flows:?}");
    command(rig, 0, 0x30);
    command(rig, 0, 0x30);
    command(rig, 250, 0x32);
    let (flows, _) = command(rig, 250, 0x32);
    assert!(flows.iter().all(|(_, flow)| flow.data()[2] == 0x32 && flow.data()[1] > 125), "recovery: {flows:?}");
    // Cleared faults stay cleared.
    let cleared = request(rig, unit, 0xFECC, address);
    let acknowledgement = [0, 0xFF, 0xFF, 0xFF, MASTER as u8, 0xCC, 0xFE, 0x00];
    let (cleared, _) = split(cleared, message(0x18E8_FF00, address));
    assert!(matches!(&cleared[..], [(_, frame)] if *frame.bytes() == acknowledgement), "{cleared:?}");
    rig.power_off(unit);
    rig.watch(unit, Duration::from_millis(5));
    rig.power_on(unit);
    rig.watch(unit, Duration::from_millis(300));
    let (faults, _) = split(request(rig, unit, 0xFECB, 0xFF), message(0x18FE_CB00, address));
    assert!(matches!(&faults[..], [(_, none)] if *none.bytes() == NO_FAULT), "cleared: {faults:?}");
}
