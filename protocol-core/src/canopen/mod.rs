//! Product-independent CANopen services (CiA 301, CiA 305).
//!
//! A product supplies its object dictionary as a table, and serves its own objects. The services look objects up, check
//! and transfer them, and handle COB-IDs, states, times and counts. They do not interpret device-profile objects. The
//! node combines the services.

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
