//! LSS requests and responses (CiA 305 6.4).

use protocol_core::controller::BitRate;
use protocol_core::wire::lss::{Bound, FastScan, NO_NODE_ID, Part, Request};

pub(super) fn request(bytes: &[u8; 8]) -> String {
    let text = match Request::parse(bytes) {
        Request::SwitchGlobal { mode: 0 } => "switch all devices to waiting".to_owned(),
        Request::SwitchGlobal { mode: 1 } => "switch all devices to configuration".to_owned(),
        Request::SwitchGlobal { mode } => format!("switch all devices to reserved mode {mode}"),
        Request::SwitchSelective(part, number) => format!("select by {} 0x{number:08X}", name(part)),
        Request::ConfigureNodeId(NO_NODE_ID) => "configure node ID 0xFF (unconfigured)".to_owned(),
        Request::ConfigureNodeId(id) => format!("configure node ID 0x{id:02X}"),
        Request::ConfigureBitTiming { table, index } => {
            let rate = BitRate::from_table_index(index).filter(|_| table == 0);
            let rate = rate.map_or(String::new(), |rate| format!(" ({} kbit/s)", rate.bits_per_second() / 1000));
            format!("configure bit timing, table {table}, index {index}{rate}")
        }
        Request::ActivateBitTiming { delay_ms } => format!("activate bit timing, switch delay {delay_ms} ms"),
        Request::Store => "store".to_owned(),
        Request::InquireIdentity(part) => format!("inquire {}", name(part)),
        Request::InquireNodeId => "inquire node ID".to_owned(),
        Request::IdentifyRemote(bound, number) => {
            let (part, word) = match bound {
                Bound::Exactly(part) => (part, "="),
                Bound::AtLeast(part) => (part, ">="),
                Bound::AtMost(part) => (part, "<="),
            };
            format!("identify devices with {} {word} 0x{number:08X}", name(part))
        }
        Request::IdentifyNonConfigured => "identify unconfigured devices".to_owned(),
        Request::FastScan(FastScan { bit_check: 0x80, .. }) => "fast scan, detect unconfigured devices".to_owned(),
        Request::FastScan(FastScan { number, bit_check, sub, next }) => {
            format!("fast scan, {} 0x{number:08X} from bit {bit_check}, then {}", name(sub), name(next))
        }
        Request::Unknown(command) => format!("unknown command 0x{command:02X}"),
    };
    format!("LSS {text}")
}

/// Explains a response. The command byte repeats the command of the request, except in responses to selection and
/// identification.
pub(super) fn answer(bytes: &[u8; 8]) -> Option<String> {
    let &[command, error, ..] = bytes;
    let [_, a, b, c, d, ..] = *bytes;
    let number = u32::from_le_bytes([a, b, c, d]);
    let done = |what: &str, why: &str| match error {
        0 => format!("{what}: done"),
        _ => format!("{what}: error {error}{why}"),
    };
    let range = if error == 1 { " (out of range)" } else { "" };
    let access = if error == 2 { " (memory access)" } else { "" };
    let text = match command {
        0x44 => "selected".to_owned(),
        0x11 => done("node ID", range),
        0x13 => done("bit timing", range),
        0x17 => done("store", access),
        0x5A..=0x5D => format!("{} 0x{number:08X}", name(command - 0x5A)),
        0x5E if error == NO_NODE_ID => "node ID 0xFF (unconfigured)".to_owned(),
        0x5E => format!("node ID 0x{error:02X}"),
        0x50 => "unconfigured device".to_owned(),
        0x4F => "identified".to_owned(),
        _ => return None,
    };
    Some(format!("LSS {text}"))
}

/// Returns the name of a part of the LSS address.
fn name(part: Part) -> String {
    match part {
        0 => "vendor ID".to_owned(),
        1 => "product code".to_owned(),
        2 => "revision".to_owned(),
        3 => "serial number".to_owned(),
        part => format!("number {part}"),
    }
}
