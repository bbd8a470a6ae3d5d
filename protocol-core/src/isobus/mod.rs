//! ISOBUS services that know no product (SAE J1939-21, -73, -81; ISO 11783), and the node that puts them together.
//!
//! ```text
//! address      the claim of an address, its defence, its loss
//! request      requests, and who is acknowledged, refused, or left without an answer
//! transport    messages of more than eight bytes: broadcasts both ways, connections refused
//! diagnostics  DM1 and DM2; DM3 is a request that the product carries out
//! node/        dispatch, the schedule, and the pending messages
//! ```
//!
//! A product decides what its groups hold. The services know addresses, times and counts, never what a fault or a
//! command means.

pub mod address;
pub mod diagnostics;
pub mod node;
pub mod request;
pub mod transport;

#[cfg(test)]
mod tests;

/// The result of a service's step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing is different.
    Nothing,
    /// The service has a frame for the bus: the node renders it when the controller can take it.
    Pending,
    /// The wait after the claim is over: every frame may be sent.
    Claimed,
    /// The address belongs to another controller: no frame may leave under it any more.
    Lost,
    /// The message was given up as a whole.
    GivenUp,
}
