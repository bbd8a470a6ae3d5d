//! The last word: what a device does when nothing is in its way any more.

mod canopen;
mod isobus;
mod sensor;
mod valve;

use hal_sim::{Duration, Frame, Instant};
use protocol_core::device::Protocol;
use protocol_core::time::since;

use super::ledger;
use super::rig::Rig;

/// After this a device has nothing left to do that was begun: what failed is tried again after 10 s (SPEC 4.5, 6).
const SETTLED: Duration = Duration::from_millis(11_500);

/// Store of a client before the power is cut.
#[derive(Clone, Copy, Debug)]
pub(super) enum Ending {
    Nothing,
    Save,
    Load,
    Lss,
    Uds,
}

impl From<u8> for Ending {
    fn from(byte: u8) -> Self {
        match byte % 5 {
            0 => Self::Nothing,
            1 => Self::Save,
            2 => Self::Load,
            3 => Self::Lss,
            _ => Self::Uds,
        }
    }
}

/// Takes all disturbances away and checks what a device does then, and after a power cut.
pub(super) fn last_word(rig: &mut Rig, unit: usize, ending: Ending) {
    rig.calm(unit);
    rig.watch(unit, rig.silence().max(SETTLED));
    // The rate may have been changed meanwhile.
    rig.follow_bit_rate(unit);
    rig.watch(unit, Duration::from_millis(100));
    match rig.units[unit].kind.protocol() {
        Protocol::Canopen => canopen::last_word(rig, unit, ending),
        Protocol::Isobus => isobus::last_word(rig, unit, ending),
    }
}

/// Stores what the attack says, and cuts the power the moment that a client was told so.
fn cut(rig: &mut Rig, unit: usize, ending: Ending) {
    let is_isobus = rig.units[unit].kind.protocol() == Protocol::Isobus;
    let is_mute = is_isobus || rig.id(unit).is_none();
    match ending {
        Ending::Nothing => {}
        Ending::Save => assert!(ledger::save(rig, unit) || is_mute, "a healthy memory takes everything"),
        Ending::Load => ledger::load(rig, unit),
        Ending::Lss => {
            let is_stored = ledger::store_by_lss(rig, unit, 0x55, None);
            rig.withdraw();
            // A heartbeat is more urgent than LSS, and one of each millisecond takes a slow bus for itself.
            assert!(is_stored || is_isobus || fills_bus(rig, unit), "LSS stores");
        }
        Ending::Uds => ledger::write_by_uds(rig, unit, 0x85),
    }
    rig.power_off(unit);
    rig.watch(unit, Duration::from_millis(5));
    rig.units[unit].ledger.start();
}

/// Returns whether a device sends one frame after the other.
fn fills_bus(rig: &mut Rig, unit: usize) -> bool {
    let sent = rig.watch(unit, Duration::from_millis(200));
    sent.len() > 10 && sent.windows(2).all(|pair| since(pair[1].0, pair[0].0) <= rig.frame_time())
}

/// Frames come at this distance, but for what arbitration takes.
#[track_caller]
fn assert_period(rig: &Rig, sent: &[(Instant, Frame)], period: Duration) {
    let late = rig.frame_time() * 2;
    for pair in sent.windows(2) {
        let distance = since(pair[1].0, pair[0].0);
        let is_due = distance + late >= period && distance <= period + late;
        assert!(is_due, "{} us for {} us between {}", distance.as_micros(), period.as_micros(), pair[0].1);
    }
}
