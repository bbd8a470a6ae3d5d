//! J1939 messages on ISOBUS (SPEC 5): address claim, requests, acknowledgement, transport protocol, AVC and AVEF.
//! `diagnostics` explains trouble codes.

use protocol_core::frame::Frame;
use protocol_core::wire::j1939_id::{Address, J1939Id, Pgn};
use protocol_core::wire::name::Name;
use protocol_core::wire::request::{self, Acknowledgement, Control};
use protocol_core::wire::tp::{Announcement, Packet};
use protocol_core::wire::valve::{Command, EstimatedFlow, Ignored, MAX_FLOW, State};

use super::{Context, diagnostics, hex};

/// The lowest address of a valve. The low four bits of the address select its AVC and AVEF parameter groups (SPEC 5).
const FIRST_VALVE: u8 = 0x80;

/// The lowest parameter group numbers of AVC and AVEF.
const AVC: u32 = Pgn::avc(0).raw();
const AVEF: u32 = Pgn::avef(0).raw();
/// The offset of the highest AVC or AVEF parameter group number from the lowest.
const LAST: u32 = 0xF;

/// The highest parameter group number of data page 0. Groups of other pages are not explained.
const PAGE_END: u32 = 0xFFFF;

pub(super) fn explain(id: u32, frame: &Frame, context: &Context<'_>) -> Option<String> {
    let id = J1939Id::from_raw(id);
    let (source, destination) = (id.source(), id.destination());
    let sender = context.sender_or(source.get(), || party(source, context));
    let to_one = format!("{sender} → {}", party(destination, context));
    let data = frame.data();
    let text = match id.pgn() {
        Pgn::ADDRESS_CLAIMED => format!("{sender}: {}", claim(source, frame)?),
        Pgn::REQUEST => format!("{to_one}: request {}", group(request::parse(frame)?)),
        Pgn::ACKNOWLEDGEMENT => acknowledgement(frame, &sender, context)?,
        Pgn::TP_CONNECTION => match Announcement::parse(frame.eight()?) {
            Some(announcement) => format!("{sender}: {}", broadcast(announcement)),
            None => format!("{to_one}: {}", connection(frame.eight()?)),
        },
        Pgn::TP_DATA => {
            let Packet { sequence, data } = Packet::parse(frame.eight()?);
            format!("{to_one}: packet {sequence}: {}", hex(&data))
        }
        Pgn::DM1 => format!("{sender}: DM1 {}", diagnostics::troubles(data, "no active fault")?),
        Pgn::DM2 => format!("{sender}: DM2 {}", diagnostics::troubles(data, "no previously active fault")?),
        pgn if is_one_of(pgn, AVC) => format!("{sender} → {}: {}", valve(pgn, context), command(data)),
        pgn if is_one_of(pgn, AVEF) => format!("{sender}: {}", estimated_flow(data)),
        pgn if pgn.raw() <= PAGE_END => format!("{to_one}: {}", group(pgn)),
        _ => return None,
    };
    Some(text)
}

fn is_one_of(pgn: Pgn, first: u32) -> bool {
    (first..=first + LAST).contains(&pgn.raw())
}

/// Returns the name of a node: a device name, "all", or an address.
fn party(address: Address, context: &Context<'_>) -> String {
    match address {
        Address::GLOBAL => "all".to_owned(),
        Address::NULL => "no address".to_owned(),
        address => context.node(address.get()).map_or_else(|| number(address), |node| node.name.clone()),
    }
}

fn number(address: Address) -> String {
    format!("0x{:02X}", address.get())
}

/// Returns the name of the valve addressed by an AVC.
fn valve(pgn: Pgn, context: &Context<'_>) -> String {
    party(Address::new(FIRST_VALVE | (pgn.raw() & LAST) as u8), context)
}

/// Returns the name of a parameter group, or its number.
fn group(pgn: Pgn) -> String {
    match pgn {
        Pgn::ADDRESS_CLAIMED => "address claim".to_owned(),
        Pgn::DM1 => "DM1".to_owned(),
        Pgn::DM2 => "DM2".to_owned(),
        Pgn::DM3 => "DM3 (clear previously active faults)".to_owned(),
        Pgn::COMMANDED_ADDRESS => "commanded address".to_owned(),
        pgn if is_one_of(pgn, AVC) => format!("AVC {}", pgn.raw() & LAST),
        pgn if is_one_of(pgn, AVEF) => format!("AVEF {}", pgn.raw() & LAST),
        pgn => format!("PGN 0x{:04X}", pgn.raw()),
    }
}

fn claim(source: Address, frame: &Frame) -> Option<String> {
    let name = Name::from_bytes(*frame.eight()?);
    let what = match source {
        Address::NULL => "cannot claim an address".to_owned(),
        address => format!("claims address {}", number(address)),
    };
    let fields = name.fields();
    Some(format!(
        "{what}, NAME 0x{:016X} (manufacturer {}, function {}, instance {}, identity {})",
        name.raw(),
        fields.manufacturer_code,
        fields.function,
        fields.function_instance,
        fields.identity_number
    ))
}

fn acknowledgement(frame: &Frame, sender: &str, context: &Context<'_>) -> Option<String> {
    let Acknowledgement { control, requester, pgn } = Acknowledgement::parse(frame.eight()?)?;
    Some(format!("{sender} → {}: {}, {}", party(requester, context), self::control(control), group(pgn)))
}

/// Returns the meaning of the control byte in an acknowledgement.
pub const fn control(control: Control) -> &'static str {
    match control {
        Control::Positive => "done",
        Control::Negative => "not supported",
        Control::AccessDenied => "access denied",
        Control::CannotRespond => "cannot respond now",
    }
}

fn broadcast(announcement: Announcement) -> String {
    let Announcement { size, packets, pgn } = announcement;
    let sound = if announcement.is_sound() { "" } else { ", inconsistent" };
    format!("BAM, {} follows, {size} bytes in {packets} packets{sound}", group(pgn))
}

/// Explains connection management of a transport session (SAE J1939-21 5.10.3). Valves never open such a session.
fn connection(bytes: &[u8; 8]) -> String {
    let &[control, a, b, packets, _, low, middle, high] = bytes;
    let size = format!("{} bytes in {packets} packets", u16::from_le_bytes([a, b]));
    let (what, rest) = match control {
        16 => ("request to send", size),
        17 => ("clear to send", format!("{a} packets from {b}")),
        19 => ("end of message", size),
        255 => ("abort", format!("reason {a}")),
        control => return format!("transport, unknown control byte {control}"),
    };
    format!("transport, {what}, {}, {rest}", group(Pgn::from_bytes([low, middle, high])))
}

fn command(data: &[u8]) -> String {
    let percent = |flow: u8| f64::from(flow) * 100.0 / f64::from(MAX_FLOW);
    match Command::parse(data) {
        Ok(command @ (Command::Extend(flow) | Command::Retract(flow))) => {
            format!("AVC {} {:.1} %", state(command.state()), percent(flow))
        }
        Ok(command) => format!("AVC {}", state(command.state())),
        Err(Ignored::Length) => format!("AVC ignored, {} bytes instead of 8", data.len()),
        Err(Ignored::FailSafeMode(mode)) => format!("AVC ignored, fail-safe mode {mode:02b}"),
        Err(Ignored::State(unknown)) => format!("AVC ignored, unknown state {unknown}"),
        Err(Ignored::Flow(flow)) => format!("AVC ignored, port flow command {flow} is above {MAX_FLOW}"),
    }
}

fn estimated_flow(data: &[u8]) -> String {
    let Some(told) = EstimatedFlow::parse(data) else { return format!("AVEF {}", hex(data)) };
    let flow = match (told.extend, told.retract) {
        (0, 0) => "no flow".to_owned(),
        (extend, 0) => format!("extend flow {extend} %"),
        (0, retract) => format!("retract flow {retract} %"),
        (extend, retract) => format!("extend flow {extend} %, retract flow {retract} %"),
    };
    format!("AVEF {}, {flow}", state(told.state))
}

/// Returns the name of the valve state in an AVC or AVEF.
pub const fn state(state: State) -> &'static str {
    match state {
        State::Blocked => "blocked",
        State::Extend => "extend",
        State::Retract => "retract",
        State::Float => "float",
        State::HandOperation => "hand operation",
        State::EmergencyStop => "emergency stop",
    }
}
