//! CANopen in the predefined connection set (CiA 301 7.3.3): NMT, SYNC, EMCY, TIME, PDOs, heartbeat. `sdo` and `lss`
//! explain the other services.

use protocol_core::device::hat;
use protocol_core::device::pve::FAULT_CODES;
use protocol_core::frame::{Frame, StandardId};
use protocol_core::wire::cob_id::{Function, classify};
use protocol_core::wire::emcy::{Emcy, NO_ERROR};
use protocol_core::wire::nmt::{self, Command, State, Target};

use super::block::Party;
use super::diagnostics::fault;
use super::object::angle;
use super::valve::{command, state, stroke};
use super::{Context, hex, lss, mapping, sdo};
use crate::Kind;

pub(super) fn explain(id: StandardId, frame: &Frame, context: &Context<'_>) -> Option<String> {
    if let Some((function, node)) = classify(id) {
        return of_node(function, node.get(), frame, context);
    }
    let id = id.as_raw();
    let node = (id & 0x7F) as u8;
    let data = frame.data();
    match id {
        0x000 => Some(format!("master: {}", network(data, context)?)),
        0x080 => sync(data),
        0x100 => time(data),
        0x7E4 => lss::answer(frame.eight()?).map(|text| match context.sender {
            Some(sender) => format!("{}: {text}", sender.name),
            None => text,
        }),
        0x7E5 => Some(format!("master: {}", lss::request(frame.eight()?))),
        // PDOs 2 to 4, which the simulated devices do not support.
        0x281..=0x2FF | 0x381..=0x3FF | 0x481..=0x4FF => {
            Some(format!("{}: TPDO {}: {}", context.sender(node), id >> 8, hex(data)))
        }
        0x301..=0x37F | 0x401..=0x47F | 0x501..=0x57F => {
            Some(format!("{} → {}: RPDO {}: {}", context.commander(), context.name(node), (id >> 8) - 1, hex(data)))
        }
        _ => None,
    }
}

fn of_node(function: Function, node: u8, frame: &Frame, context: &Context<'_>) -> Option<String> {
    let from_device = |text: String| format!("{}: {text}", context.sender(node));
    let to_device = |text: String| format!("{} → {}: {text}", context.commander(), context.name(node));
    let data = frame.data();
    match function {
        Function::Emcy => emergency(frame, context.kind(node)).map(from_device),
        Function::Tpdo1 => {
            let kind = context.kind(node);
            let default = if let Some(Kind::Hat(_)) = kind { &SENSOR_TPDO[..] } else { &VALVE_TPDO };
            let is_default = context.known.mappings.is_default(node, mapping::TPDO, default);
            Some(from_device(if is_default { tpdo(data, kind) } else { format!("TPDO {}", hex(data)) }))
        }
        Function::Rpdo1 => {
            let is_default = context.known.mappings.is_default(node, mapping::RPDO, &VALVE_RPDO);
            Some(to_device(if is_default { rpdo(data) } else { format!("RPDO {}", hex(data)) }))
        }
        Function::SdoAnswer => {
            let bytes = frame.eight()?;
            let segment = context.known.blocks.segment(node, Party::Server, bytes);
            segment.or_else(|| sdo::answer(bytes, context.kind(node))).map(from_device)
        }
        Function::SdoRequest => {
            let bytes = frame.eight()?;
            let kind = context.node(node).map(|node| node.kind);
            let segment = context.known.blocks.segment(node, Party::Client, bytes);
            Some(to_device(segment.unwrap_or_else(|| sdo::request(bytes, kind))))
        }
        Function::Heartbeat => heartbeat(data).map(from_device),
    }
}

fn network(data: &[u8], context: &Context<'_>) -> Option<String> {
    let (command, target) = nmt::parse(data)?;
    let command = match command {
        Command::Start => "start",
        Command::Stop => "stop",
        Command::EnterPreOperational => "enter pre-operational",
        Command::ResetApplication => "reset application",
        Command::ResetCommunication => "reset communication",
    };
    let target = match target {
        Target::All => "all nodes".to_owned(),
        Target::Node(node) => context.name(node.get()),
    };
    Some(format!("NMT {command}, {target}"))
}

fn heartbeat(data: &[u8]) -> Option<String> {
    let &[code] = data else { return None };
    let state = match State::from_code(code)? {
        State::Initialising => return Some("boot-up".to_owned()),
        State::PreOperational => "pre-operational",
        State::Operational => "operational",
        State::Stopped => "stopped",
    };
    Some(format!("NMT state {state}"))
}

/// Explains SYNC, with its counter if 0x1019 is set (CiA 301 7.2.5).
fn sync(data: &[u8]) -> Option<String> {
    match data {
        [] => Some("SYNC".to_owned()),
        [counter] => Some(format!("SYNC, counter {counter}")),
        _ => None,
    }
}

/// Explains TIME: milliseconds since midnight in 28 bits, and days since 1984-01-01 (CiA 301 7.1.6.5).
fn time(data: &[u8]) -> Option<String> {
    let &[a, b, c, d, low, high] = data else { return None };
    let ms = u32::from_le_bytes([a, b, c, d]) & 0x0FFF_FFFF;
    let (seconds, days) = (ms / 1000, u16::from_le_bytes([low, high]));
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    Some(format!("TIME {hours:02}:{minutes:02}:{:02}.{:03}, day {days} since 1984-01-01", seconds % 60, ms % 1000))
}

fn emergency(frame: &Frame, kind: Option<Kind>) -> Option<String> {
    let Emcy { code, register, manufacturer } = Emcy::parse(frame.eight()?);
    let [low, high, ..] = manufacturer;
    let (what, rest) = match kind {
        _ if code == NO_ERROR && register == 0 => return Some("EMCY: no error".to_owned()),
        _ if code == NO_ERROR => ("no error".to_owned(), String::new()),
        // The manufacturer defines the bytes after the register.
        None => (named(error_class(code), code), format!(", {}", hex(&manufacturer))),
        Some(Kind::Hat(_)) => {
            let field = u16::from_le_bytes([low, high]);
            let is_sent =
                |error: &hat::Error| matches!(error.codes(), (told, with, _) if (told, with) == (code, field));
            let error = hat::Error::ALL.into_iter().find(is_sent);
            let unknown = || format!("code 0x{code:04X}, field 0x{field:04X}");
            (error.map_or_else(unknown, |error| named(angle_sensor(error), code)), String::new())
        }
        Some(Kind::Pve(_)) => {
            let faults = FAULT_CODES.iter().filter(|codes| codes.emcy == code).map(|codes| fault(codes.fault));
            let faults = faults.collect::<Vec<_>>().join(" or ");
            let what = if faults.is_empty() { format!("code 0x{code:04X}") } else { named(&faults, code) };
            (what, format!(", count {low}"))
        }
    };
    Some(format!("EMCY: {what}, register 0x{register:02X}{rest}"))
}

fn named(what: &str, code: u16) -> String {
    format!("{what} (0x{code:04X})")
}

/// Returns the name of an angle sensor's error (SPEC 9).
const fn angle_sensor(error: hat::Error) -> &'static str {
    match error {
        hat::Error::SetUp => "setup not loaded",
        hat::Error::Controller => "controller error",
        hat::Error::Passive => "error-passive",
        hat::Error::BusOff => "recovered from bus-off",
    }
}

/// Returns the class of an error code (CiA 301 7.2.7.1).
const fn error_class(code: u16) -> &'static str {
    match code >> 8 {
        0x10 => "generic error",
        0x20..=0x2F => "current",
        0x30..=0x3F => "voltage",
        0x40..=0x4F => "temperature",
        0x50..=0x5F => "device hardware",
        0x60..=0x6F => "device software",
        0x70..=0x7F => "additional modules",
        0x81 => "communication",
        0x82 => "protocol error",
        0x80 | 0x83..=0x8F => "monitoring",
        0x90..=0x9F => "external error",
        0xF0 => "additional functions",
        0xFF => "device-specific error",
        _ => "error",
    }
}

/// The default mappings (SPEC 4.5, 9): the number of entries, and the entries.
const VALVE_RPDO: [u32; 3] = [2, 0x6040_0010, 0x6300_0110];
const VALVE_TPDO: [u32; 3] = [2, 0x6041_0010, 0x6301_0110];
const SENSOR_TPDO: [u32; 2] = [1, 0x6004_0020];

/// Explains an RPDO by the default mapping: control word and set-point.
fn rpdo(data: &[u8]) -> String {
    let &[a, b, c, d] = data else { return format!("RPDO {}", hex(data)) };
    let word = u16::from_le_bytes([a, b]);
    format!("RPDO control word 0x{word:04X} ({}), set-point {}", command(word), stroke(i16::from_le_bytes([c, d])))
}

/// Explains a TPDO by the default mapping: status word and position of a valve, position of an angle sensor.
fn tpdo(data: &[u8], kind: Option<Kind>) -> String {
    let &[a, b, c, d] = data else { return format!("TPDO {}", hex(data)) };
    if let Some(Kind::Hat(_)) = kind {
        return format!("TPDO position {}", angle(u32::from_le_bytes([a, b, c, d])));
    }
    let word = u16::from_le_bytes([a, b]);
    format!("TPDO status word 0x{word:04X} ({}), position {}", state(word), stroke(i16::from_le_bytes([c, d])))
}
