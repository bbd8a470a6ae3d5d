//! The last word: the behaviour of a device without disturbances.

mod canopen;
mod isobus;
mod sensor;
mod valve;

use hal_sim::{Duration, Frame, Instant};
use protocol_core::device::Protocol;
use protocol_core::time::since;

use super::ledger;
use super::rig::Rig;

/// The time after which a device has finished everything. A failed write is tried again after 10 s (SPEC 4.5, 6).
const SETTLED: Duration = Duration::from_millis(11_500);

/// The store of a client before the power cut.
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

/// Ends all disturbances, and checks the behaviour of a device, also after a power cut.
pub(super) fn last_word(rig: &mut Rig, unit: usize, ending: Ending) {
    rig.calm(unit);
    rig.watch(unit, rig.silence().max(SETTLED));
    // The attack may have changed the bit rate.
    rig.follow_bit_rate(unit);
    rig.watch(unit, Duration::from_millis(100));
    match rig.units[unit].kind.protocol() {
        Protocol::Canopen => canopen::last_word(rig, unit, ending),
        Protocol::Isobus => isobus::last_word(rig, unit, ending),
    }
}

/// Stores as the attack says, and cuts the power at the moment of the confirmation.
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
            // A heartbeat is more urgent than LSS. One in each millisecond fills a slow bus.
            assert!(is_stored || is_isobus || fills_bus(rig, unit), "LSS stores");
        }
        Ending::Uds => ledger::write_by_uds(rig, unit, 0x85),
    }
    rig.power_off(unit);
    rig.watch(unit, Duration::from_millis(5));
    rig.units[unit].ledger.start();
}

/// Returns whether a device fills the bus with its frames.
fn fills_bus(rig: &mut Rig, unit: usize) -> bool {
    let sent = rig.watch(unit, Duration::from_millis(200));
    sent.len() > 10 && sent.windows(2).all(|pair| since(pair[1].0, pair[0].0) <= rig.frame_time())
}

/// Asserts the period of frames, with a tolerance for arbitration.
#[track_caller]
fn assert_period(rig: &Rig, sent: &[(Instant, Frame)], period: Duration) {
    let late = rig.frame_time() * 2;
    for pair in sent.windows(2) {
        let distance = since(pair[1].0, pair[0].0);
        let is_due = distance + late >= period && distance <= period + late;
        assert!(is_due, "{} us for {} us between {}", distance.as_micros(), period.as_micros(), pair[0].1);
    }
}
