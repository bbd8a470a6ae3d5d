//! What a master sees of the CANopen valves: objects, services, faults and memory (SPEC 2–4, 6, 7).

mod acknowledged;
mod acknowledged_lives;
mod acknowledged_orders;
mod bit_rate_blocked;
mod blocked_bus;
mod cob_id;
mod device_state_machine;
mod emcy_stream;
mod emergency_stop;
mod fault_log;
mod faults;
mod filters;
mod led;
mod lss;
mod monitors;
mod nmt;
mod node_id;
mod object_dictionary;
mod pdo;
mod pdo_mapping;
mod pdo_switch;
mod promises;
mod restart_scope;
mod sdo;
mod set_point;
mod silence;
mod storage;
mod sync;

use protocol_core::device::pve::{Kind, Setup};
use tests::Rig;

/// What the boot of a valve at node 0x20 sends.
const BOOT: [&str; 2] = ["720: 00", "0A0: 00 00 00 00 00 00 00 00"];
/// The EMCY that says that no error is left.
const CLEARED: &str = "0A0: 00 00 00 00 00 00 00 00";
/// The EMCY of the first internal error.
const INTERNAL_ERROR: &str = "0A0: 00 10 01 01 00 00 00 00";
/// "save"
const SAVE: &str = "620: 23 10 10 01 73 61 76 65";
/// The answer to [`SAVE`].
const SAVED: &str = "5A0: 60 10 10 01 00 00 00 00";
/// "load"
const LOAD: &str = "620: 23 11 10 01 6C 6F 61 64";
/// The answer to [`LOAD`].
const LOADED: &str = "5A0: 60 11 10 01 00 00 00 00";
/// Clears the counters.
const CLEAR: &str = "620: 23 11 10 05 70 6B 64 73";
/// The answer to [`CLEAR`].
const COUNTERS_CLEARED: &str = "5A0: 60 11 10 05 00 00 00 00";

/// A valve without a node ID.
fn blank() -> Rig {
    let mut valve = Rig::power_on(Setup { node_id: None, ..Setup::new(Kind::PveaCanopen) });
    valve.expect_nothing();
    valve
}
