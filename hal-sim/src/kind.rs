//! The kinds of devices that can be put on the bus, by the name that is used everywhere (SPEC 1).

pub use protocol_core::device::Kind;
