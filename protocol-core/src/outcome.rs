//! The outcome of a request: the result of a service, or a demand on the device.

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome<R, D> {
    /// No effect, at least in this state or on this device.
    Nothing,
    /// The service has executed the request, with this result.
    Done(R),
    /// The device must act first, and then report the result.
    Demand(D),
}
