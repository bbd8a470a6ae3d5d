//! CANopen services that know no product (CiA 301, CiA 305).
//!
//! A product brings its object dictionary as a table and answers for its own objects in it; the services here look up,
//! check, transfer, time and count, and the node puts them together. They know COB-IDs and states, never what an object
//! of a device profile means.

pub mod dictionary;
pub(crate) mod emcy;
mod fast_scan;
pub(crate) mod heartbeat;
pub(crate) mod lss;
pub(crate) mod nmt;
pub(crate) mod node;
pub(crate) mod parameters;
pub(crate) mod pdo;
pub(crate) mod sdo_server;
pub(crate) mod sync;
pub(crate) mod transmission;

mod sdo_download;
mod sdo_upload;

#[cfg(test)]
mod tests;
