//! The host hardware.
