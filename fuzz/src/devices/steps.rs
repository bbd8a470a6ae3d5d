//! The steps of an attack, which its bytes select.

use hal_sim::bus::{BitErrors, Disturbance, Injector};
use hal_sim::memory::TornErase;
use hal_sim::{Change, Duration, Frame, Kind};
use protocol_core::actuator::SpoolFault;
use protocol_core::device::{Protocol, StartCause};
use protocol_core::frame::{Id, extended, standard};

use super::bytes::Bytes;
use super::rig::Rig;
use super::{frames, ledger};

/// The pause after a frame, unless frames pile up.
const PAUSE: Duration = Duration::from_millis(2);

/// The bits of the first byte of a step: frames pile up; the second device is meant. The other bits select the action.
const PILE_UP: u8 = 0x80;
const SECOND: u8 = 0x40;

/// A jammer, which destroys every frame on the bus, or those of one device.
#[derive(Clone)]
struct Jammer(Option<String>);

impl Injector for Jammer {
    fn disturb(&mut self, from: &str, _: &Frame, bits: u32) -> Option<u32> {
        self.0.as_ref().is_none_or(|jammed| jammed == from).then_some(bits / 2)
    }
}

/// Executes the next step.
pub(super) fn act(rig: &mut Rig, bytes: &mut Bytes<'_>) {
    let step = bytes.u8();
    let unit = usize::from(step & SECOND != 0) % rig.units.len();
    let id = rig.id(unit).unwrap_or(rig.units[unit].kind.default_node_id());
    let kind = rig.units[unit].kind;
    let frame = match step & 0x3F {
        0..=7 => frames::sdo(bytes, kind, id),
        8 => Frame::full(standard(0x600 + u16::from(id & 0x7F)).into(), bytes.array()),
        9 | 10 => frames::nmt(bytes, id),
        11..=13 => frames::lss(bytes, kind),
        14 | 15 => frames::rpdo(bytes, id),
        16 => frames::sync_or_emcy(bytes),
        17 | 18 => frames::uds(bytes, id),
        19..=21 => frames::command(bytes, id),
        22 | 23 => frames::request(bytes, id),
        24 => frames::claim(bytes, id),
        25 => frames::transport(bytes, id),
        26 => frames::any(bytes),
        other => return around(rig, unit, other, bytes),
    };
    send(rig, frame);
    if step & PILE_UP == 0 {
        rig.run(PAUSE);
    }
}

/// Sends a frame, of whose effect the clients know nothing.
fn send(rig: &mut Rig, frame: Frame) {
    for unit in &mut rig.units {
        unit.ledger.hear(unit.kind, &frame);
    }
    if frame.id() == standard(0x7E5).into() && frame.bytes()[0] == 0x15 {
        rig.silence_begins();
    }
    rig.send(frame);
}

/// Executes a step other than a frame.
fn around(rig: &mut Rig, unit: usize, step: u8, bytes: &mut Bytes<'_>) {
    let node = rig.units[unit].node;
    rig.forget_sent();
    match step {
        27..=31 => rig.run(time(bytes.u8())),
        32..=35 => {
            let plant = plant(bytes, rig.units[unit].kind);
            // Words of the other product, and impossible values, are refused.
            let _ = rig.world.set_plant(node, plant);
            rig.units[unit].memory_hurt |= rig.world.memory(node).write_fails();
        }
        36 => {
            rig.power_off(unit);
            rig.run(time(bytes.u8()));
            rig.units[unit].ledger.start();
            rig.power_on(unit);
        }
        37 => {
            rig.world.power_with(node, StartCause::Watchdog);
            rig.units[unit].ledger.start();
        }
        38 => {
            let operations = u64::from(bytes.u16() % 1024);
            rig.world.memory_mut(node).flash_mut().cut_power_after(operations);
        }
        39 => {
            let operations = u64::from(bytes.u16() % 1024);
            rig.units[unit].memory_hurt = true;
            rig.world.memory_mut(node).flash_mut().fail_once_after(operations);
        }
        40 => {
            let flash = rig.world.memory_mut(node).flash_mut();
            flash.set_torn_erase(TornErase::ALL[usize::from(bytes.u8()) % TornErase::ALL.len()]);
            flash.seed_noise(bytes.u8().into());
        }
        41 => rig.world.disturb(Disturbance { frames: bytes.u8().into(), id: None }),
        42 => match bytes.u8() % 4 {
            0 => rig.world.clear_injectors(),
            1 => rig.world.inject(Jammer(None)),
            2 => rig.world.inject(Jammer(Some(rig.world.name(node).to_owned()))),
            _ => {
                let noise = BitErrors::one_in(u64::from(bytes.u8()) * 16 + 16, 0);
                rig.world.inject(noise.expect("more than zero"));
            }
        },
        43 => rig.connect_master(bytes.flag()),
        44 => {
            let on = bytes.flag();
            rig.world.force_bus_off(node, on);
        }
        45 => rig.flood(u16::from(bytes.u8()) * 4),
        46 => rig.follow_bit_rate(unit),
        47..=51 => {
            if rig.settle() {
                store(rig, unit, step, bytes);
            }
        }
        52 => commanded_address(rig, unit, bytes),
        53 => activate(rig, unit),
        54 => cyclic(rig, unit, bytes.u8()),
        55 => {
            let count = bytes.u8();
            (0..count).for_each(|_| guard(rig, unit));
        }
        _ => rig.run(PAUSE),
    }
}

/// Stores something for a client, and records it.
fn store(rig: &mut Rig, unit: usize, step: u8, bytes: &mut Bytes<'_>) {
    match step {
        47 | 48 => _ = ledger::save(rig, unit),
        49 => ledger::load(rig, unit),
        50 => {
            let rates = rig.units[unit].kind.bit_rates();
            let [node_id, rate] = bytes.array();
            ledger::store_by_lss(rig, unit, node_id & 0x7F, rates.get(usize::from(rate)).copied());
        }
        _ => ledger::write_by_uds(rig, unit, bytes.u8()),
    }
}

/// Returns a time from a microsecond to hours. Most times are short.
fn time(byte: u8) -> Duration {
    Duration::from_micros(u64::from(1 + (byte & 0xF)) << (2 * (byte >> 4)))
}

fn plant(bytes: &mut Bytes<'_>, kind: Kind) -> Change {
    let spool = [SpoolFault::None, SpoolFault::Stuck, SpoolFault::Slow, SpoolFault::Drifting, SpoolFault::NoFloat];
    match (bytes.u8() % 8, kind) {
        (0, _) => Change::InternalFault(bytes.flag()),
        (1, _) => Change::MemoryFails(bytes.flag()),
        (2 | 3, Kind::Pve(_)) => Change::SupplyMv(
            bytes.known_or_any(&[24_000, 8_999, 9_000, 11_000, 11_001, 36_000, 36_001, 32_000, 31_999]),
        ),
        (4, Kind::Pve(_)) => Change::TemperatureC(bytes.one_of(&[25, 121, 120, 115, 114, -40, -41, -35, -34, -273])),
        (5, Kind::Pve(_)) => Change::Lever(bytes.flag().then(|| bytes.u16().cast_signed())),
        (_, Kind::Pve(_)) => Change::Spool(bytes.one_of(&spool)),
        (2 | 3, Kind::Hat(_)) => Change::AngleCdeg(u32::from(bytes.u16())),
        (4 | 5, Kind::Hat(_)) => Change::SpeedRpm(bytes.u32().cast_signed()),
        (_, Kind::Hat(_)) => Change::MeasuringError(bytes.flag()),
    }
}

/// Commands another address of a valve on ISOBUS, by three frames.
fn commanded_address(rig: &mut Rig, unit: usize, bytes: &mut Bytes<'_>) {
    let address = 0x80 | bytes.u8() & 0x1F;
    let serial = if unit == 0 { 1 } else { super::SECOND_SERIAL as u8 };
    let frame = |id, data| Frame::full(extended(id).into(), data);
    send(rig, frame(0x1CEC_FF27, [0x20, 9, 0, 2, 0xFF, 0xD8, 0xFE, 0]));
    send(rig, frame(0x1CEB_FF27, [1, serial, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02]));
    send(rig, frame(0x1CEB_FF27, [2, 0x20, address, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]));
    rig.run(PAUSE);
}

/// Activates a device as a machine controller does: use case 1, two commands on ISOBUS, NMT start of a sensor.
fn activate(rig: &mut Rig, unit: usize) {
    let Some(id) = rig.id(unit) else { return };
    if rig.units[unit].kind.protocol() == Protocol::Canopen {
        send(rig, Frame::of(standard(0).into(), &[1, id]).expect("two bytes"));
    }
    for _ in 0..3 {
        guard(rig, unit);
    }
}

/// Sends the cyclic command of a machine controller: a set-point, then 100 ms.
fn guard(rig: &mut Rig, unit: usize) {
    let Some(id) = rig.id(unit) else { return };
    let frame: (Id, [u8; 8], u8) = match rig.units[unit].kind.protocol() {
        Protocol::Canopen => (standard(0x200 + u16::from(id)).into(), [0x0F, 0, 0, 0x20, 0, 0, 0, 0], 4),
        Protocol::Isobus => {
            (extended(0x0CFE_3027 | u32::from(id & 0xF) << 8).into(), [0, 0xFF, 0x30, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], 8)
        }
    };
    let (id, data, len) = frame;
    rig.send(Frame::with_len(id, data, len));
    rig.run(Duration::from_millis(100));
}

/// Sets a heartbeat and, for a sensor, a TPDO by its event timer.
fn cyclic(rig: &mut Rig, unit: usize, ms: u8) {
    let Some(id) = rig.id(unit).filter(|id| *id < 0x80).map(u16::from) else { return };
    let [low, high] = (0x180 + id).to_le_bytes();
    for data in [
        [0x2B, 0x17, 0x10, 0, ms, 0, 0, 0],
        [0x2F, 0x00, 0x18, 2, 0xFE, 0, 0, 0],
        [0x2B, 0x00, 0x18, 5, ms, 0, 0, 0],
        [0x23, 0x00, 0x18, 1, low, high, 0, 0],
    ] {
        send(rig, Frame::full(standard(0x600 + id).into(), data));
    }
    rig.run(PAUSE);
}
