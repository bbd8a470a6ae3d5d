//! What all kinds of valve have in common, whatever protocol they speak: faults, spool, power save (SPEC 2, 3).

mod faults;
mod power_save;
mod spool;
mod valve;
