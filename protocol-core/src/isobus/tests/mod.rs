//! Tests of the services, in virtual time, with frames as printed in the manual.

mod address;
mod diagnostics;
mod node;
mod request;
mod transport;

use std::string::String;

use crate::frame::Frame;
use crate::time::Instant;
use crate::wire::j1939_id::Address;
use crate::wire::name::Name;

extern crate std;

/// The NAME of the manual's example.
const NAME: Name = Name::from_bytes([0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20]);
/// A NAME that wins against [`NAME`].
const LOWER: Name = Name::from_bytes([0x00, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20]);
/// A NAME that loses against [`NAME`].
const HIGHER: Name = Name::from_bytes([0x02, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20]);

const OWN: Address = Address::new(0x83);
const TOOL: Address = Address::new(0x27);

fn ms(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn us(micros: u64) -> Instant {
    Instant::from_micros(micros)
}

fn frame(text: &str) -> Frame {
    text.parse().unwrap()
}

fn text(frame: Option<Frame>) -> String {
    frame.map_or_else(String::new, |frame| std::format!("{frame}"))
}
