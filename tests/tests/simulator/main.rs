//! What needs the whole simulator: physics of the bus, faults of the communication, power cuts at any write, clones.

mod angle_sensor;
mod bit_rot;
mod bus_physics;
mod canopen_faults;
mod clone;
mod faults;
mod fork;
mod invariants;
mod isobus_faults;
mod power_cuts;
mod sent_frames;
