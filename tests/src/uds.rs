//! UDS requests and answers. The tester is at 0xF1 unless a source is given.

/// The address of the tester.
pub const TESTER: u32 = 0xF1;
/// The answer to a write of the node ID or address. Its identifier is the same for every node.
pub const WRITTEN: &str = "1BC408F1: 03 6E 10 01";

/// Returns a message from one address to another.
#[must_use]
pub fn message(source: u32, destination: u32, bytes: &str) -> String {
    format!("{:08X}: {bytes}", 0x1BC0_0000 | source << 11 | destination)
}

/// Returns a request to this address.
#[must_use]
pub fn request(address: u8, bytes: &str) -> String {
    message(TESTER, address.into(), bytes)
}

/// Returns an answer of this address.
#[must_use]
pub fn answer(address: u8, bytes: &str) -> String {
    message(address.into(), TESTER, bytes)
}
