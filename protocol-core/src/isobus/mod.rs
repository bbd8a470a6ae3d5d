//! Product-independent ISOBUS services (SAE J1939-21, -73, -81; ISO 11783), and the node that combines them.
//!
//! ```text
//! address      address claim, defence and loss
//! request      requests and their acknowledgement
//! transport    messages of more than eight bytes: broadcasts both ways, connections refused
//! diagnostics  DM1 and DM2; the product executes DM3
//! node/        dispatch, scheduling, and the pending messages
//! ```
//!
//! The product defines the contents of its groups. The services handle addresses, times and counts, never the meaning
//! of a fault or a command.

pub mod address;
pub mod diagnostics;
pub mod node;
pub mod request;
pub mod transport;

#[cfg(test)]
mod tests;

/// The outcome of a step of a service.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// No change.
    Nothing,
    /// The service has a frame to send; the node encodes it when the controller can take it.
    Pending,
    /// The wait after the claim is over: all messages may be sent.
    Claimed,
    /// The address was lost to another controller: no frame may be sent with it.
    Lost,
    /// The entire message was abandoned.
    GivenUp,
}
