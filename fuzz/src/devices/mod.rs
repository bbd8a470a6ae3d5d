//! Attacks on the devices, behind their ports on a bus and behind their memories.
//!
//! *The last word* follows the attack: all disturbances end, and the behaviour of the devices is compared with plain rules, which repeat docs/behaviour.md.
//!
//! ```text
//! flash        memories that hold anything
//! bytes        the bytes of an attack
//! rig        one or two devices and a master on a simulated bus
//! steps        what can happen around them: frames, plants, power, bus, memory, clients, time
//! frames       frames that are like those that the devices know
//! client       a client that reads and writes objects
//! objects      the objects that are stored, with their defaults
//! ledger       what clients were told is stored, and what a start has to find therefore
//! well_formed  what a device may send at any time
//! rules/       the last word
//! ```

mod bytes;
mod client;
mod flash;
mod frames;
mod ledger;
mod objects;
mod rig;
mod rules;
mod steps;
mod well_formed;

use hal_sim::{Kind, Memory, Setup};
use protocol_core::device::Protocol;

pub use flash::flash;

use bytes::Bytes;
use rig::Rig;
use rules::Ending;

/// The serial number of the second device, which is no twin of the first.
const SECOND_SERIAL: u32 = 2;

/// The maximum number of steps of an attack.
const STEPS_MAX: u32 = 300;

/// Attacks one or two devices on a bus by arbitrary disturbances.
pub fn devices(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let [first, second, how, ending] = bytes.array();
    let kind = kind(first);
    let rates = kind.bit_rates();
    let mut rig = Rig::new(rates[usize::from(how >> 1) % rates.len()]);
    let blank = how & 1 == 1 && kind.protocol() == Protocol::Canopen;
    let setup = Setup::new(kind);
    let node_id = setup.node_id.filter(|_| !blank);
    rig.add(Setup { node_id, bit_rate: Some(rig.world.bit_rate()), ..setup }, Memory::in_ram(), true);
    if let Some(second) = second.checked_sub(0x80) {
        let setup = Setup::new(self::kind(second));
        rig.add(Setup { serial: Some(SECOND_SERIAL), ..setup }, Memory::in_ram(), true);
    }
    (0..rig.units.len()).for_each(|unit| rig.power_on(unit));
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() {
            break;
        }
        steps::act(&mut rig, &mut bytes);
    }
    (0..rig.units.len()).for_each(|unit| rules::last_word(&mut rig, unit, Ending::from(ending)));
}

fn kind(byte: u8) -> Kind {
    Kind::ALL[usize::from(byte) % Kind::ALL.len()]
}
