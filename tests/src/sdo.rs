//! SDO requests and answers, and the signatures of 0x1010 and 0x1011.

/// The signature of 0x1010.
pub const SAVE: u32 = u32::from_le_bytes(*b"save");
/// The signature of 0x1011.
pub const LOAD: u32 = u32::from_le_bytes(*b"load");

/// Returns the request with these bytes. Missing bytes are zeros.
#[must_use]
pub fn request(node_id: u8, bytes: &str) -> String {
    format!("{:03X}: {}", 0x600 + u16::from(node_id), crate::eight(bytes))
}

/// Returns the answer with these bytes. Missing bytes are zeros.
#[must_use]
pub fn answer(node_id: u8, bytes: &str) -> String {
    format!("{:03X}: {}", 0x580 + u16::from(node_id), crate::eight(bytes))
}

/// Returns the request to read an object.
#[must_use]
pub fn read(node_id: u8, index: u16, sub: u8) -> String {
    frame(0x600, node_id, 0x40, (index, sub), 0)
}

/// Returns the request to write an object of this many bytes.
#[must_use]
pub fn write(node_id: u8, index: u16, sub: u8, data: &[u8]) -> String {
    let mut bytes = [0; 4];
    bytes[..data.len()].copy_from_slice(data);
    let size = u8::try_from(data.len()).expect("one to four bytes");
    frame(0x600, node_id, 0x23 | (4 - size) << 2, (index, sub), u32::from_le_bytes(bytes))
}

/// Returns the answer to a write.
#[must_use]
pub fn written(node_id: u8, index: u16, sub: u8) -> String {
    frame(0x580, node_id, 0x60, (index, sub), 0)
}

/// Returns the abort of a request.
#[must_use]
pub fn abort(node_id: u8, index: u16, sub: u8, code: u32) -> String {
    frame(0x580, node_id, 0x80, (index, sub), code)
}

fn frame(function: u16, node_id: u8, command: u8, (index, sub): (u16, u8), data: u32) -> String {
    let ([low, high], [a, b, c, d]) = (index.to_le_bytes(), data.to_le_bytes());
    let id = function + u16::from(node_id);
    format!("{id:03X}: {command:02X} {low:02X} {high:02X} {sub:02X} {a:02X} {b:02X} {c:02X} {d:02X}")
}
