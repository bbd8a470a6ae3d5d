//! What a frame costs, in instructions: see `benches/core.rs`.
