//! The outcome of a request: the result of a service, or an action that the device must take first.

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome<R, D> {
    /// Nothing: the request has no effect, or none in this state or on this device.
    Nothing,
    /// The service has acted, with this result.
    Done(R),
    /// The device must act first; the result follows.
    Demand(D),
}
