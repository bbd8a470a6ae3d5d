//! The outcome of a request to a service.

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome<R, D> {
    /// The request has no effect.
    Nothing,
    /// The service has executed the request, with this result.
    Done(R),
    /// The device must first carry out this demand, and then report the result.
    Demand(D),
}
