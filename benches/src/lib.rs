//! The cost of a frame in instructions, see `benches/core.rs`.
