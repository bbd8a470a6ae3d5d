//! What a master sees of the angle sensors (SPEC 9).

mod emcy;
mod lss;
mod nmt;
mod object_dictionary;
mod pdo;
mod pdo_timing;
mod position;
mod promises;
mod storage;

use protocol_core::device::hat::{Kind, Setup};
use tests::Rig;
use tests::sdo::{LOAD, SAVE};

/// A HAT 1000 at node 1, fresh from the factory, booted.
fn booted() -> Rig {
    booted_as(Setup::new(Kind::Hat1000))
}

/// A sensor, booted; its boot-up, and nothing else, is taken.
fn booted_as(setup: Setup) -> Rig {
    let mut rig = Rig::power_on(setup);
    let node_id = rig.node_id().expect("a node ID");
    assert_eq!(rig.take(), [format!("{:03X}: 00", 0x700 + u16::from(node_id))]);
    rig
}

/// A sensor without a node ID.
fn blank() -> Rig {
    let mut rig = Rig::power_on(Setup { node_id: None, ..Setup::new(Kind::Hat1000) });
    rig.expect_nothing();
    rig
}

/// The value that a number of so many bytes cannot have.
const INVALID: Result<(), u32> = Err(0x0609_0030);
/// The state of the device forbids it.
const STATE: Result<(), u32> = Err(0x0800_0022);
