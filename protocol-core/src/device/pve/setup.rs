//! What a valve is made as.

use super::kind::Kind;

/// What a valve is made as. Node ID and serial number fill a new memory; one that holds them decides by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// The product.
    pub kind: Kind,
    /// The node ID, on ISOBUS the address, of a new memory. One that the product cannot have counts as `None`: on CANopen
    /// a valve that leaves the factory blank, on ISOBUS the default.
    pub node_id: Option<u8>,
    /// The serial number of a new memory; `None` for the manual's.
    pub serial: Option<u32>,
}

impl Setup {
    /// A valve of this kind with the default node ID and serial number.
    #[must_use]
    pub const fn new(kind: Kind) -> Self {
        Self { kind, node_id: Some(kind.default_node_id()), serial: None }
    }
}
