//! `pve-sim`: the stand-in devices on the host.
fn main() {}
