//! Human-readable traces of bus events.
//!
//! ```text
//! layout     the columns of a trace         errors     the reported error frames and error modes
//! ```

mod errors;
mod layout;

pub use errors::Errors;
pub use layout::Layout;
