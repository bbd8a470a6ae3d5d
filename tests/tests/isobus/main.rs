//! What a tractor sees of the ISOBUS valves: claim, commands, diagnostics and memory (SPEC 2, 3, 5–7).

mod actuator;
mod bus_time;
mod claim;
mod commanded_address;
mod commands;
mod diagnostics;
mod guard;
mod memory;
mod properties;
mod recovery;
mod requests;
mod uds;
