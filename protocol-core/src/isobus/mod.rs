//! Product-independent ISOBUS services (SAE J1939-21, -73, -81; ISO 11783), and the node that combines them.
//!
//! ```text
//! address      address claim, defence and loss
//! request      requests for parameter groups
//! transport    messages of more than eight bytes
//! diagnostics  DM1 and DM2
//! node/        the node: received frames, pending messages, timers
//! ```
//!
//! The product defines the contents of its groups, and executes DM3. The services handle addresses, times and counts.
//! They do not interpret faults or commands.

pub mod address;
pub mod diagnostics;
pub mod node;
pub mod request;
pub mod transport;

#[cfg(test)]
mod tests;

/// The outcome of a service step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// No change.
    Nothing,
    /// The service has a frame to send. The node encodes it when the controller can take a frame.
    Pending,
    /// The wait after the claim is over, and all messages may be sent.
    Claimed,
    /// Another controller has taken the address. No frame may be sent with this address.
    Lost,
    /// The service has abandoned the message.
    GivenUp,
}
