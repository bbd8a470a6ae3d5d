//! The rules of the CANopen valves (SPEC 2, 4.1, 4.3).

use hal_sim::{Duration, Frame};
use protocol_core::actuator::Led;
use protocol_core::frame::{Id, extended, standard};

use super::super::client::{number, set};
use super::super::rig::Rig;
use super::canopen::nmt;

const INIT: u32 = 0x08;
const DISABLED: u32 = 0x09;
const HOLD: u32 = 0x0B;
const ACTIVE: u32 = 0x0F;
const FAULT_HOLD: u32 = 0x03;

const INTERNAL: u32 = 0x01;
const TIME_GUARDING: u32 = 0x91;

/// Asserts the state of a valve without disturbances that has had no set-point for a long time.
pub(super) fn state(rig: &mut Rig, unit: usize, register: u32) {
    assert!(matches!(register, 0 | INTERNAL | TIME_GUARDING), "error register {register:02X}");
    let is_hurt = rig.units[unit].memory_hurt || rig.units[unit].damaged;
    assert!(register != INTERNAL || is_hurt, "an internal error without a reason");
    let status = number(rig, unit, (0x6041, 0));
    let mode = number(rig, unit, (0x6042, 0));
    assert!(matches!(mode, 1 | 2), "mode {mode}");
    match status {
        INIT | DISABLED | HOLD => assert_eq!(register, 0),
        FAULT_HOLD => {}
        // Time guarding has shut down any other ACTIVE valve.
        ACTIVE => assert_eq!((register, mode), (0, 2), "ACTIVE without a set-point"),
        _ => panic!("status {status:02X}"),
    }
    let node = rig.units[unit].node;
    let outputs = rig.world.outputs(node).and_then(protocol_core::device::Outputs::valve).expect("a powered valve");
    assert!(!outputs.solenoids, "nobody commands the solenoids");
    // The LED shows an internal error rather than time guarding.
    let led = match (register, status) {
        (INTERNAL, _) => vec![Led::RED],
        (TIME_GUARDING, _) => vec![Led::RED, Led::RED_FLASHING],
        (_, FAULT_HOLD) => vec![Led::RED_FLASHING],
        _ => vec![Led::YELLOW],
    };
    assert!(led.contains(&outputs.led), "{:?} of {led:?}", outputs.led);
    assert_eq!(number(rig, unit, (0x6301, 1)), 0, "the spool is not in neutral");
    let id = u32::from(rig.id(unit).expect("a node ID"));
    assert_eq!(number(rig, unit, (0x1014, 0)), 0x80 + id);
    let identity: Vec<u32> = (0..=3).map(|sub| number(rig, unit, (0x1018, sub))).collect();
    assert_eq!(identity, [3, 0x0100_0019, 0x5336_0000, 0x0001_0020]);
    assert!(number(rig, unit, (0x1017, 0)) <= 0x7FFF);
    assert!(matches!(number(rig, unit, (0x1800, 2)), 1..=240 | 0xFF));
    assert_eq!(number(rig, unit, (0x1400, 2)), 0xFF);
}

/// Asserts that a TPDO at each SYNC carries the values of its objects.
pub(super) fn synchronous(rig: &mut Rig, unit: usize) {
    let (cob_id, sync, id) =
        (number(rig, unit, (0x1800, 1)), number(rig, unit, (0x1005, 0)) & 0x7FF, rig.id(unit).expect("a node ID"));
    let taken = [number(rig, unit, (0x1400, 1)), number(rig, unit, (0x1028, 1)), 0x80 + u32::from(id)];
    set(rig, unit, (0x1800, 2), &[1]);
    assert_eq!(nmt(rig, unit, 0x01, id), [], "entering operational sends nothing");
    let is_own = |id: u32| taken.iter().any(|cob_id| cob_id & 0x7FF == id && cob_id >> 31 == 0);
    if cob_id >> 31 == 0 && !is_own(sync) && cob_id & 0x7FF != sync {
        let content = content(rig, unit);
        rig.send(Frame::of(standard(sync as u16).into(), &[]).expect("no data"));
        let sent = rig.watch(unit, rig.frame_time() * 8 + Duration::from_millis(1));
        let under = |cob_id: u32| Id::from(standard((cob_id & 0x7FF) as u16));
        let heartbeat = under(0x700 + u32::from(id));
        let sent: Vec<Frame> =
            sent.into_iter().map(|(_, frame)| frame).filter(|frame| frame.id() != heartbeat).collect();
        assert_eq!(sent, [Frame::of(under(cob_id), &content).expect("eight bytes")]);
    }
    nmt(rig, unit, 0x80, id);
}

/// Returns the values of the objects that the TPDO maps, bit by bit.
fn content(rig: &mut Rig, unit: usize) -> Vec<u8> {
    let (mut bits, mut len) = (0, 0);
    for entry in 1..=number(rig, unit, (0x1A00, 0)) {
        let entry = number(rig, unit, (0x1A00, entry as u8));
        let (index, sub, size) = ((entry >> 16) as u16, (entry >> 8) as u8, entry & 0xFF);
        let value = if index < 8 { 0 } else { u64::from(number(rig, unit, (index, sub))) };
        bits |= value << len;
        len += size;
    }
    u64::to_le_bytes(bits)[..len.div_ceil(8) as usize].to_vec()
}

/// Asserts the work of a valve after its power-up: it enters ACTIVE, moves, and stops.
pub(super) fn serves(rig: &mut Rig, unit: usize, id: u8) {
    if number(rig, unit, (0x1001, 0)) == INTERNAL {
        // This start did not need to write a damaged record.
        assert_eq!(number(rig, unit, (0x6041, 0)), FAULT_HOLD);
        return;
    }
    assert_eq!(number(rig, unit, (0x6041, 0)), INIT);
    nmt(rig, unit, 0x80, id);
    for status in [DISABLED, HOLD, ACTIVE] {
        set(rig, unit, (0x6040, 0), &[0x0F, 0]);
        assert_eq!(number(rig, unit, (0x6041, 0)), status);
    }
    for _ in 0..4 {
        set(rig, unit, (0x6300, 1), &0x4000_u16.to_le_bytes());
        rig.watch(unit, Duration::from_millis(100));
    }
    assert_eq!(number(rig, unit, (0x6301, 1)), 0x4000, "the spool follows");
    let sent = rig.watch(unit, Duration::from_millis(600));
    let emcy: Vec<_> = sent.iter().filter(|(_, frame)| frame.id() == standard(0x80 + u16::from(id)).into()).collect();
    assert!(matches!(emcy[..], [(_, emcy)] if emcy.data()[..3] == [0x03, 0x80, 0x91]), "time guarding: {emcy:?}");
    assert_eq!(number(rig, unit, (0x6301, 1)), 0, "the springs bring it back");
    set(rig, unit, (0x6300, 1), &[0, 0]);
    for word in [0x03, 0x0B] {
        set(rig, unit, (0x6040, 0), &[word, 0]);
    }
    assert_eq!(number(rig, unit, (0x6041, 0)), HOLD);
    // UDS reads the node ID of the next start.
    let request = Frame::of(extended(0x1BC7_8800 | u32::from(id)).into(), &[3, 0x22, 0x10, 0x01]).expect("four bytes");
    let answer_id = extended(0x1BC0_00F1 | u32::from(id) << 11).into();
    let answer = rig.ask(unit, request, |frame| frame.id() == answer_id).expect("an answer to UDS");
    assert_eq!(answer.data(), [4, 0x62, 0x10, 0x01, id]);
}
