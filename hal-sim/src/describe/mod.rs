//! Product descriptions for other tools: an EDS for CANopen masters, a DBC for ISOBUS analysers.
//!
//! ```text
//! eds     an electronic data sheet (CiA 306)         product   the product data in its header
//! dbc     a CAN database                             layout    the messages and signals in it
//! ```

mod dbc;
mod eds;
mod layout;
mod product;

pub use dbc::dbc;
pub use eds::eds;
