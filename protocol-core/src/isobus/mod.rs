//! ISOBUS services that know no product (SAE J1939-21, -73, -81; ISO 11783).
//!
//! ```text
//! address      the claim of an address, its defence, its loss
//! request      who asks for what, and who is answered, refused, or left without an answer
//! transport    messages of more than eight bytes, broadcast, both ways
//! diagnostics  DM1 and DM2; DM3 is a request that `request` acknowledges
//! ```
//!
//! A product decides what its groups hold and when it may send; the services here know addresses, times and counts,
//! never what a fault or a command means.

pub mod address;
pub mod diagnostics;
pub mod request;
pub mod transport;

#[cfg(test)]
mod tests;
