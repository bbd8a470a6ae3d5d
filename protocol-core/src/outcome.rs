//! The one answer to every request: what a service did, or what its device has to do first.

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome<R, D> {
    /// Nothing: the request asks for nothing, or not now, or not of this device.
    Nothing,
    /// The service has acted, with this result.
    Done(R),
    /// The device has to act; the result follows when it has.
    Demand(D),
}
