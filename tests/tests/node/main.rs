//! What a master sees of the services that all CANopen nodes have, of each kind (SPEC 4.2, 4.4, 4.5, 9).

mod bit_rate;
mod error_history;
mod fast_scan;
mod heartbeat;
mod kinds;
mod lss;
mod nmt;
mod object_dictionary;
mod pdo_configuration;
mod properties;
mod sdo;
mod storage;
