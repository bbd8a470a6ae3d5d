//! UDS lite with 29-bit identifiers (SPEC 7).

use std::collections::BTreeSet;

use protocol_core::frame::{Frame, Id};
use protocol_core::uds::NODE_ID_ANSWER;
use protocol_core::wire::uds::{
    Address, Identifier, NEGATIVE, NegativeCode, POSITIVE, READ, WRITE, parse_id, single_frame,
};

use super::{Context, hex, text_or_hex};

const WRITTEN: u8 = WRITE | POSITIVE;

pub(super) fn explain(id: u32, data: &[u8], context: &Context<'_>) -> Option<String> {
    let (source, destination) = parse_id(id)?;
    let (message, complete) = single_frame(data)?;
    let &[service, ref rest @ ..] = message else { return None };
    let sender = match (context.sender, device(source)) {
        (Some(sender), _) => sender.name.clone(),
        (None, _) if !context.from_client && answers_write(id, message) => context.known.writes.asked(context),
        (None, Some(id)) => context.sender(id),
        (None, None) => party(source, context),
    };
    let parties = format!("{sender} → {}", party(destination, context));
    let (id, value) = rest.split_at_checked(2).unwrap_or((rest, &[]));
    let meaning = match service {
        READ => format!("read {}", identifier(rest)),
        WRITE => format!("write {} = {}", identifier(id), hex(value)),
        _ if service == READ | POSITIVE => format!("read response {} = {}", identifier(id), content(id, value)),
        WRITTEN => format!("write response {}", identifier(rest)),
        NEGATIVE => match rest {
            [READ, code, ..] => format!("read refused, {}", reason(*code)),
            [WRITE, code, ..] => format!("write refused, {}", reason(*code)),
            [service, code, ..] => format!("service 0x{service:02X} refused, {}", reason(*code)),
            _ => "refused".to_owned(),
        },
        service => format!("service 0x{service:02X}"),
    };
    let length = if complete { "" } else { ", wrong length" };
    Some(format!("{parties}: UDS {meaning}{length}"))
}

/// The devices with a pending node ID write. The response does not identify its sender, so the request must be
/// remembered.
#[derive(Clone, Debug, Default)]
pub(super) struct Writes(BTreeSet<u8>);

impl Writes {
    /// Updates the pending writes with a frame on the bus.
    pub(super) fn observe(&mut self, frame: &Frame) {
        let Id::Extended(id) = frame.id() else { return };
        let (Some((_, destination)), Some((message, _))) = (parse_id(id.as_raw()), single_frame(frame.data())) else {
            return;
        };
        if answers_write(id.as_raw(), message) {
            // With several pending writes, any of the devices may have responded.
            self.0.clear();
        } else if let [WRITE, 0x10, 0x01, ..] = message {
            self.0.extend(device(destination));
        }
    }

    /// Returns the name of the device with a pending write. Returns a general text unless exactly one device has a
    /// pending write.
    fn asked(&self, context: &Context<'_>) -> String {
        match self.0.iter().collect::<Vec<_>>()[..] {
            [id] => context.name(*id),
            _ => "one of the valves".to_owned(),
        }
    }
}

/// Returns whether a message is the response to a node ID write. All valves send this response with the same
/// identifier.
fn answers_write(id: u32, message: &[u8]) -> bool {
    id == NODE_ID_ANSWER && matches!(message, [WRITTEN, 0x10, 0x01] | [NEGATIVE, WRITE, ..])
}

/// The highest node number of a device, which is an address on ISOBUS.
const LAST_DEVICE: u8 = 0x8F;

/// Returns the name of a device, or the address of a diagnostic tool.
fn party(address: Address, context: &Context<'_>) -> String {
    device(address).map_or_else(|| format!("tool 0x{:02X}", address.raw()), |id| context.name(id))
}

/// Returns the node number of a device's UDS address; `None` for any other address.
fn device(address: Address) -> Option<u8> {
    u8::try_from(address.raw()).ok().filter(|id| (1..=LAST_DEVICE).contains(id))
}

fn identifier(bytes: &[u8]) -> String {
    let &[high, low, ..] = bytes else { return "without data identifier".to_owned() };
    let id: Identifier = u16::from_be_bytes([high, low]);
    let name = match id {
        0x1001 => " (node ID)",
        0xF010 => " (address format)",
        0xF18B => " (manufacturing date)",
        0xF18C => " (serial number)",
        0xF192 => " (hardware part number)",
        0xF193 => " (hardware version)",
        0xF194 => " (software number)",
        0xF195 => " (software version)",
        0xF1FA..=0xF1FD => " (diagnostic file)",
        _ => "",
    };
    format!("0x{id:04X}{name}")
}

/// Formats the value of a data identifier; versions are strings.
fn content(identifier: &[u8], value: &[u8]) -> String {
    if matches!(identifier, [0xF1, 0x93 | 0x95]) { text_or_hex(value) } else { hex(value) }
}

fn reason(code: u8) -> String {
    let known = NegativeCode::ALL.into_iter().find(|known| *known as u8 == code);
    let meaning = known.map_or("unknown code", NegativeCode::meaning);
    format!("{meaning} (0x{code:02X})")
}
