//! Traces: what happened on the bus, laid out for people.
//!
//! ```text
//! layout     the columns of a trace         errors     the error frames and error modes that are told
//! ```

mod errors;
mod layout;

pub use errors::Errors;
pub use layout::Layout;
