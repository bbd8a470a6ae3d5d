//! The rules of the angle sensors, whose shaft rests (SPEC 9).

use hal_sim::{Duration, Frame};
use protocol_core::frame::{Id, extended, standard};

use super::super::client::{number, set};
use super::super::rig::Rig;
use super::assert_period;
use super::canopen::nmt;

const CLOCK: u64 = 10_000;

pub(super) fn state(rig: &mut Rig, unit: usize, register: u32) {
    // A damaged record stays an error until it is written.
    let is_hurt = rig.units[unit].memory_hurt || rig.units[unit].damaged;
    assert!(register == 0 || is_hurt && register == 0x81, "error register {register:02X}");
    let position = number(rig, unit, (0x6004, 0));
    let raw = rig.world.angle_cdeg(rig.units[unit].node).expect("a shaft") * 16_384 / 36_000;
    let offset = number(rig, unit, (0x6509, 0)).cast_signed();
    assert_eq!(position, raw.wrapping_add_signed(offset) % 16_384);
    assert!((-8_192..=8_191).contains(&offset), "offset {offset}");
    assert!(number(rig, unit, (0x6003, 0)) <= 16_383);
    assert_eq!(number(rig, unit, (0x6503, 0)), 0);
    assert!(matches!(number(rig, unit, (0x1F80, 0)), 0x08 | 0x0C));
    assert!((1..=2).all(|sub| number(rig, unit, (0x1029, sub)) <= 2));
    assert!(matches!(number(rig, unit, (0x1800, 2)), 0..=240 | 254 | 255));
    let id = u32::from(rig.id(unit).expect("a node ID"));
    assert_eq!(number(rig, unit, (0x2001, 1)), id);
    assert!(matches!(number(rig, unit, (0x2001, 2)), 1..=127 | 255));
    let rate = u32::from(rig.world.bit_rate().table_index());
    assert_eq!(number(rig, unit, (0x2002, 1)), rate);
}

/// Asserts the TPDO at each SYNC, at a SYNC after a change, and by its event timer.
pub(super) fn pdos(rig: &mut Rig, unit: usize) {
    let (cob_id, sync) = (number(rig, unit, (0x1800, 1)), number(rig, unit, (0x1005, 0)));
    let id = rig.id(unit).expect("a node ID");
    let content = content(rig, unit);
    // EMCYs can have any identifier, too.
    let emcy = number(rig, unit, (0x1014, 0));
    let same = |a: u32, b: u32| a & 0x3FFF_FFFF == b & 0x3FFF_FFFF;
    if cob_id >> 31 == 1 || content.is_empty() || same(cob_id, sync) || same(cob_id, emcy) || same(emcy, sync) {
        return;
    }
    let tpdo = Frame::of(id_of(cob_id), &content).expect("eight bytes");
    let (timer, inhibit) = (number(rig, unit, (0x1800, 5)), number(rig, unit, (0x1800, 3)));
    for (type_, expected) in [(0, [1, 0, 0, 0]), (1, [1, 1, 1, 1]), (2, [0, 1, 0, 1]), (254, [0; 4])] {
        set(rig, unit, (0x1800, 2), &[type_]);
        nmt(rig, unit, 0x01, id);
        if type_ == 254 {
            break;
        }
        for count in expected {
            rig.send(Frame::of(id_of(sync), &[]).expect("no data"));
            let sent = under(rig, unit, cob_id, rig.frame_time() * 8 + Duration::from_millis(1));
            assert!(sent.len() == count && sent.iter().all(|(_, sent)| *sent == tpdo), "type {type_}: {sent:?}");
        }
        nmt(rig, unit, 0x80, id);
    }
    let period = Duration::from_millis(timer.into());
    let sent = under(rig, unit, cob_id, period * 5 / 2 + Duration::from_millis(100));
    assert!(sent.iter().all(|(_, sent)| *sent == tpdo), "{tpdo}: {sent:?}");
    if timer == 0 {
        assert_eq!(sent, []);
    } else if period > rig.frame_time() * 6 && period.as_ticks() > u64::from(inhibit) * CLOCK / 100 {
        assert!(sent.len() >= 2, "{} TPDOs of {timer} ms", sent.len());
        assert_period(rig, &sent, period);
    }
    nmt(rig, unit, 0x80, id);
}

fn id_of(cob_id: u32) -> Id {
    if cob_id >> 29 & 1 == 1 { extended(cob_id & 0x1FFF_FFFF).into() } else { standard((cob_id & 0x7FF) as u16).into() }
}

/// Runs for a time. Returns the frames that a device sends under a COB-ID.
fn under(rig: &mut Rig, unit: usize, cob_id: u32, time: Duration) -> Vec<(hal_sim::Instant, Frame)> {
    let sent = rig.watch(unit, time);
    sent.into_iter().filter(|(_, frame)| frame.id() == id_of(cob_id)).collect()
}

/// Returns the values of the objects that the TPDO maps, in whole bytes.
fn content(rig: &mut Rig, unit: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    for entry in 1..=number(rig, unit, (0x1A00, 0)) {
        let entry = number(rig, unit, (0x1A00, entry as u8));
        let value = number(rig, unit, ((entry >> 16) as u16, (entry >> 8) as u8));
        bytes.extend(&value.to_le_bytes()[..(entry & 0xFF) as usize / 8]);
    }
    bytes
}
