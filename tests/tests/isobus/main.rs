//! What a tractor sees of the ISOBUS valves: claim, commands, diagnostics and memory (SPEC 2, 3, 5–7).

mod acknowledged_orders;
mod actuator;
mod blocked_bus;
mod bus_time;
mod claim;
mod commanded_address;
mod commands;
mod diagnostics;
mod guard;
mod kept_counts;
mod lost_address;
mod memory;
mod nobody_to_answer;
mod own_address;
mod promises;
mod properties;
mod recovery;
mod requests;
mod told;
mod transport;
mod waiting;
mod writes;
