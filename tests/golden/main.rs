//! What may not change by accident, seen from outside: the program is run as users run it, and all that it answers is
//! compared to the byte with files beside this one. Nothing here knows how the program is made.
//!
//! ```text
//! program    the executable, run to its end, or running with its time standing
//! rig        what is done to running devices, and what can be read from them
//! expected   the files, and the one way to renew them
//! texts      help, refusals, descriptions        frames     use cases, scenarios, logs
//! http       the control interface               memory     what becomes of state files
//! ```
//!
//! The state files of each layout that ever was are in `state/`: see `memory`. CONTRIBUTING.md says when the other files
//! may be renewed.
//!
//! Only on Linux: other systems serve other buses, and say so.
#![cfg(target_os = "linux")]

mod expected;
mod frames;
mod http;
mod memory;
mod program;
mod rig;
mod texts;
