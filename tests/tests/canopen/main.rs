//! What a master sees of the CANopen valves: objects, services, faults and memory (SPEC 2–4, 6, 7).

mod actuator;
mod bit_rate;
mod cob_id;
mod device_state_machine;
mod emcy;
mod emcy_stream;
mod error_history;
mod fast_scan;
mod fault_log;
mod faults;
mod filters;
mod heartbeat;
mod led;
mod lss;
mod monitors;
mod nmt;
mod node_id;
mod object_dictionary;
mod pdo;
mod pdo_mapping;
mod properties;
mod sdo;
mod set_point;
mod storage;
mod sync;
mod uds;
