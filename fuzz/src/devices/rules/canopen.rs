//! The rules of all CANopen devices (SPEC 4.2, 4.4, 4.5).

use hal_sim::{Duration, Frame, Kind};
use protocol_core::frame::{Id, standard};
use protocol_core::time::since;

use super::super::client::{number, read};
use super::super::ledger::Ledger;
use super::super::rig::Rig;
use super::{Ending, assert_period, cut, sensor, valve};

const STOPPED: u8 = 0x04;
const OPERATIONAL: u8 = 0x05;
const PRE_OPERATIONAL: u8 = 0x7F;

/// The number of frames after which an error-passive controller is active again.
const FRAMES_TO_ACTIVE: u32 = 300;

pub(super) fn last_word(rig: &mut Rig, unit: usize, ending: Ending) {
    let Some(id) = rig.id(unit) else { return blank(rig, unit) };
    if rig.is_error_active(unit) {
        quiet(rig, unit, id);
    }
    wake(rig, unit, id);
    state(rig, unit);
    heartbeat(rig, unit, id);
    match rig.units[unit].kind {
        Kind::Pve(_) => valve::synchronous(rig, unit),
        Kind::Hat(_) => sensor::pdos(rig, unit),
    }
    let counters = counters(rig, unit);
    cut(rig, unit, ending);
    rig.power_on(unit);
    rig.follow_bit_rate(unit);
    let booted = rig.watch(unit, Duration::from_millis(50));
    let Some(id) = rig.id(unit) else { return blank(rig, unit) };
    boot(rig, unit, id, &booted);
    Ledger::check(rig, unit);
    assert_eq!(self::counters(rig, unit), counters, "the fault log");
    state(rig, unit);
    if let Kind::Pve(_) = rig.units[unit].kind {
        valve::serves(rig, unit, id);
    }
}

/// Sends an NMT command and waits a little. Returns the sent frames.
pub(super) fn nmt(rig: &mut Rig, unit: usize, command: u8, id: u8) -> Vec<Frame> {
    rig.forget_sent();
    rig.send(Frame::of(standard(0).into(), &[command, id]).expect("two bytes"));
    let heartbeat = standard(0x700 + u16::from(id)).into();
    let sent = rig.watch(unit, rig.frame_time() * 8 + Duration::from_millis(1));
    sent.into_iter().map(|(_, frame)| frame).filter(|frame| frame.id() != heartbeat).collect()
}

/// Asserts that a device without requests sends periodic heartbeats of one state only. A sensor also sends its TPDO,
/// with one content.
fn quiet(rig: &mut Rig, unit: usize, id: u8) {
    let sent = rig.watch(unit, Duration::from_millis(1500));
    let is_heartbeat = |frame: &Frame| frame.id() == standard(0x700 + u16::from(id)).into();
    let (heartbeats, others): (Vec<_>, Vec<_>) = sent.into_iter().partition(|(_, frame)| is_heartbeat(frame));
    let same = |sent: &[(_, Frame)]| sent.windows(2).all(|pair| pair[0].1 == pair[1].1);
    assert!(same(&heartbeats) && same(&others), "{heartbeats:?} {others:?}");
    let Some((_, heartbeat)) = heartbeats.first() else { return };
    assert!(matches!(heartbeat.data(), [STOPPED | OPERATIONAL | PRE_OPERATIONAL]), "{heartbeat}");
    let is_sensor = matches!(rig.units[unit].kind, Kind::Hat(_));
    assert!(others.is_empty() || is_sensor && heartbeat.data() == [OPERATIONAL], "{heartbeat} and {others:?}");
}

/// Wakes a device that does not answer: it is stopped, or fills the bus with a PDO, which is more urgent than an SDO.
/// Then all devices are pre-operational and error-active.
fn wake(rig: &mut Rig, unit: usize, id: u8) {
    if read(rig, unit, (0x1000, 0)).is_none() {
        let sent = rig.watch(unit, Duration::from_millis(200));
        let is_stopped = sent.iter().all(|(_, frame)| frame.data() == [STOPPED]);
        let is_full = sent.windows(2).all(|pair| since(pair[1].0, pair[0].0) <= rig.frame_time());
        assert!(is_stopped || is_full && sent.len() > 10, "no answer, and {sent:?}");
        rig.withdraw();
    }
    nmt(rig, unit, 0x80, id);
    for _ in 0..FRAMES_TO_ACTIVE {
        number(rig, unit, (0x1000, 0));
        if rig.is_error_active(unit) {
            break;
        }
    }
    assert!(rig.is_error_active(unit), "it stays error-passive");
    rig.watch(unit, Duration::from_millis(100));
    // There is exactly one answer.
    let request = Frame::full(standard(0x600 + u16::from(id)).into(), [0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
    rig.send(request);
    let heartbeat = Id::from(standard(0x700 + u16::from(id)));
    let sent = rig.watch(unit, rig.frame_time() * 10 + Duration::from_millis(2)).into_iter();
    let sent: Vec<Frame> = sent.map(|(_, frame)| frame).filter(|frame| frame.id() != heartbeat).collect();
    let device_type = if matches!(rig.units[unit].kind, Kind::Pve(_)) { [0x98, 1, 0, 0] } else { [0x96, 1, 1, 0] };
    let [a, b, c, d] = device_type;
    let answer = Frame::full(standard(0x580 + u16::from(id)).into(), [0x43, 0x00, 0x10, 0, a, b, c, d]);
    assert_eq!(sent, [answer]);
}

/// Asserts that the heartbeat has the period of 0x1017; that of a valve is a multiple of 10 ms.
fn heartbeat(rig: &mut Rig, unit: usize, id: u8) {
    let time = u64::from(number(rig, unit, (0x1017, 0)));
    let is_valve = matches!(rig.units[unit].kind, Kind::Pve(_));
    let period = Duration::from_millis(if is_valve { time.next_multiple_of(10) } else { time });
    // The requests of a client are more urgent than a heartbeat.
    rig.watch(unit, rig.frame_time() * 4);
    let sent = rig.watch(unit, period * 5 / 2 + Duration::from_millis(300));
    for (_, frame) in &sent {
        assert_eq!(frame.id(), standard(0x700 + u16::from(id)).into(), "{frame}");
        assert_eq!(frame.data(), [PRE_OPERATIONAL], "{frame}");
    }
    if time == 0 {
        assert_eq!(sent, [], "no heartbeat");
    } else if period > rig.frame_time() * 4 {
        assert!(sent.len() >= 2, "{} heartbeats of {time} ms", sent.len());
        assert_period(rig, &sent, period);
    }
}

/// Asserts error register, history and state of the product.
fn state(rig: &mut Rig, unit: usize) {
    let register = number(rig, unit, (0x1001, 0));
    let count = number(rig, unit, (0x1003, 0));
    assert!(count <= 8);
    for sub in 1..=8 {
        let entry = read(rig, unit, (0x1003, sub)).expect("an answer");
        assert_eq!(entry.is_ok(), u32::from(sub) <= count, "entry {sub} of {count}: {entry:?}");
    }
    match rig.units[unit].kind {
        Kind::Pve(_) => valve::state(rig, unit, register),
        Kind::Hat(_) => sensor::state(rig, unit, register),
    }
}

/// Asserts the frames of a start: the boot-up, then the reset EMCY of a valve. A sensor sends the frames that its NMT
/// state permits.
fn boot(rig: &Rig, unit: usize, id: u8, sent: &[(hal_sim::Instant, Frame)]) {
    let frames: Vec<String> = sent.iter().map(|(_, frame)| frame.to_string()).collect();
    let id = u16::from(id);
    assert_eq!(frames.first(), Some(&format!("{:03X}: 00", 0x700 + id)), "{frames:?}");
    if let Kind::Pve(_) = rig.units[unit].kind {
        assert_eq!(frames.get(1), Some(&format!("{:03X}: 00 00 00 00 00 00 00 00", 0x080 + id)), "{frames:?}");
        let heartbeat = format!("{:03X}: 7F", 0x700 + id);
        // A damaged record is reported, and may be written again.
        let (internal_error, no_error) = (format!("{:03X}: 00 10 01", 0x080 + id), frames[1].clone());
        let of_damage = |frame: &String| frame.starts_with(&internal_error) || *frame == no_error;
        let damaged = rig.units[unit].damaged;
        let is_known = |frame: &String| *frame == heartbeat || damaged && of_damage(frame);
        assert!(frames[2..].iter().all(is_known), "{frames:?}");
    }
}

/// Asserts that a device without a node ID is silent, and that LSS finds it.
fn blank(rig: &mut Rig, unit: usize) {
    assert_eq!(rig.watch(unit, Duration::from_secs(2)), []);
    let lss = |rig: &mut Rig, bytes: [u8; 2]| {
        let [command, mode] = bytes;
        rig.send(Frame::full(standard(0x7E5).into(), [command, mode, 0, 0, 0, 0, 0, 0]));
        let sent = rig.watch(unit, rig.frame_time() * 10 + Duration::from_millis(2));
        sent.iter().map(|(_, frame)| frame.to_string()).collect::<Vec<_>>()
    };
    assert!(lss(rig, [0x04, 1]).is_empty());
    assert_eq!(lss(rig, [0x5E, 0]), ["7E4: 5E FF 00 00 00 00 00 00"]);
}

/// Returns the occurrence counters of a valve. A sensor has none.
fn counters(rig: &mut Rig, unit: usize) -> Vec<u32> {
    let objects: &[u16] = match rig.units[unit].kind {
        // Each start detects the damage again.
        Kind::Pve(_) if rig.units[unit].damaged => &[0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023],
        Kind::Pve(_) => &[0x2001, 0x2002, 0x200F, 0x2019, 0x201D, 0x2023, 0x2024],
        Kind::Hat(_) => &[],
    };
    let counters: Vec<u32> = objects.iter().map(|index| number(rig, unit, (*index, 0))).collect();
    assert!(counters.iter().all(|count| *count <= 0x7F));
    counters
}
