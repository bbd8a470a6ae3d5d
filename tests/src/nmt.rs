//! NMT commands to all nodes, boot-up and heartbeat.

/// Start.
pub const START: &str = "000: 01 00";
/// Stop.
pub const STOP: &str = "000: 02 00";
/// Enter pre-operational.
pub const ENTER_PRE_OPERATIONAL: &str = "000: 80 00";
/// Reset node, "reset application" in the manual of the valves.
pub const RESET_NODE: &str = "000: 81 00";
/// Reset communication.
pub const RESET_COMMUNICATION: &str = "000: 82 00";
/// Both resets.
pub const RESETS: [&str; 2] = [RESET_NODE, RESET_COMMUNICATION];

/// Returns the boot-up message of a node.
#[must_use]
pub fn boot_up(node_id: u8) -> String {
    heartbeat(node_id, 0)
}

/// Returns a heartbeat of a node in this state.
#[must_use]
pub fn heartbeat(node_id: u8, state: u8) -> String {
    format!("{:03X}: {state:02X}", 0x700 + u16::from(node_id))
}
