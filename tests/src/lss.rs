//! LSS requests and answers. Missing bytes are zeros.

use crate::Rig;

/// Switch state global: to waiting.
pub const TO_WAITING: &str = "7E5: 04 00 00 00 00 00 00 00";
/// Switch state global: to configuration.
pub const TO_CONFIGURATION: &str = "7E5: 04 01 00 00 00 00 00 00";
/// Store configuration.
pub const STORE: &str = "7E5: 17 00 00 00 00 00 00 00";
/// The answer to [`STORE`].
pub const STORED: &str = "7E4: 17 00 00 00 00 00 00 00";
/// The request activate bit timing with a delay of 0.
pub const ACTIVATE: &str = "7E5: 15 00 00 00 00 00 00 00";
/// Inquire node ID. Only a slave in configuration answers.
pub const INQUIRE_NODE_ID: &str = "7E5: 5E 00 00 00 00 00 00 00";
/// Identify non-configured remote slave.
pub const IDENTIFY_NON_CONFIGURED: &str = "7E5: 4C 00 00 00 00 00 00 00";
/// The answer to [`IDENTIFY_NON_CONFIGURED`].
pub const NON_CONFIGURED: &str = "7E4: 50 00 00 00 00 00 00 00";
/// The answer to fast scan and to identify remote slave.
pub const IDENTIFIED: &str = "7E4: 4F 00 00 00 00 00 00 00";

/// Returns the request with these bytes.
#[must_use]
pub fn request(bytes: &str) -> String {
    format!("7E5: {}", crate::eight(bytes))
}

/// Returns the answer with these bytes.
#[must_use]
pub fn answer(bytes: &str) -> String {
    format!("7E4: {}", crate::eight(bytes))
}

/// Returns activate bit timing with this switch delay.
#[must_use]
pub fn activate(delay_ms: u16) -> String {
    let [low, high] = delay_ms.to_le_bytes();
    request(&format!("15 {low:02X} {high:02X}"))
}

/// Returns a fast scan request: number, bit check, LSS sub, LSS next.
#[must_use]
pub fn fast_scan(number: u32, bit_check: u8, sub: u8, next: u8) -> String {
    let [a, b, c, d] = number.to_le_bytes();
    request(&format!("51 {a:02X} {b:02X} {c:02X} {d:02X} {bit_check:02X} {sub:02X} {next:02X}"))
}

impl Rig {
    /// Sends an LSS request, and asserts its answer.
    #[track_caller]
    pub fn lss(&mut self, bytes: &str, expected: Option<&str>) {
        let expected = expected.map(answer);
        let expected: Vec<&str> = expected.as_deref().into_iter().collect();
        self.exchange(&request(bytes), &expected);
    }

    /// Configures a node ID by LSS, and asserts the success.
    #[track_caller]
    pub fn configure_node_id(&mut self, node_id: u8) {
        self.lss(&format!("11 {node_id:02X}"), Some("11"));
    }

    /// Configures a bit rate by LSS, and asserts the success.
    #[track_caller]
    pub fn configure_bit_rate(&mut self, index: u8) {
        self.lss(&format!("13 00 {index:02X}"), Some("13"));
    }

    /// Returns whether the device is in LSS configuration.
    pub fn is_configuring(&mut self) -> bool {
        self.send(INQUIRE_NODE_ID);
        !self.take().is_empty()
    }
}
