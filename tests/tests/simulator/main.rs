//! What needs the whole simulator: physics of the bus, faults of the communication, power cuts at any write, determinism.

mod angle_sensor;
mod bit_rot;
mod bus_physics;
mod busy_bus;
mod clone;
mod determinism;
mod faults;
mod fork;
mod held_bus;
mod power_cuts;
mod records;
mod write_failures;
