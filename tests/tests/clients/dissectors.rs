//! tshark beside the trace: what its dissectors for CANopen, J1939 and ISOBUS say of each frame of a run, and what
//! `pve-sim` says of it.
//!
//! Where tshark 4.0 says less, or something else, is named here:
//!
//! - A segment of an SDO block transfer it takes for an ordinary command, as it does not look at the frames before; of
//!   the initiation it names the service alone.
//! - Of UDS lite it knows nothing.
//! - It has no fields for the NAME in a claim, for acknowledgements and for DM1: of those the group, the addresses and
//!   the bytes are compared.
//! - The destination of a group that goes to all it reads off the group extension.

use std::fs;

use super::simulator::{FREE, Start, WOUND};
use super::tshark::{CANOPEN, Fields, ISOBUS, J1939, tshark};

/// The devices of the run, by the numbers with which tshark calls them.
const NAMES: [(u32, &str); 3] = [(0x20, "pvea-canopen"), (0x01, "hat1000"), (0x83, "pvea-isobus")];

/// What the explanation of a frame has to say, in this order, and what it may show as the value at the end.
#[derive(Debug, Default)]
struct Said {
    words: Vec<String>,
    value: Option<Vec<u8>>,
}

impl Said {
    fn agrees(&self, explanation: &str) -> bool {
        let mut rest = explanation;
        for word in &self.words {
            let Some(at) = rest.find(word.as_str()) else { return false };
            rest = &rest[at + word.len()..];
        }
        self.value.as_ref().is_none_or(|bytes| {
            let shown = rest.rsplit_once(" = ").map_or(rest, |(_, value)| value);
            renderings(bytes).iter().any(|value| {
                shown.strip_prefix(value.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', ',']))
            })
        })
    }
}

/// Bytes as texts may show them: a number of any sign, hex, text.
fn renderings(bytes: &[u8]) -> Vec<String> {
    let spaced = bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ");
    let mut all = vec![spaced, format!("\"{}\"", String::from_utf8_lossy(bytes))];
    if bytes.len() <= 4 {
        let number = bytes.iter().rev().fold(0_i64, |number, byte| number << 8 | i64::from(*byte));
        let signed = number - (number >> (8 * bytes.len() - 1) << (8 * bytes.len()));
        all.extend([format!("0x{number:0width$X}", width = 2 * bytes.len()), number.to_string(), signed.to_string()]);
    }
    all
}

fn said<const N: usize>(words: [String; N]) -> Said {
    Said { words: words.into(), value: None }
}

fn node(number: u32) -> String {
    let known = NAMES.iter().find(|(known, _)| *known == number);
    known.map_or_else(|| format!("node 0x{number:02X}"), |(_, name)| (*name).to_owned())
}

/// A frame of 11 bits.
fn canopen(frame: &Fields) -> Said {
    let id = frame.get("node_id");
    let from = format!("{}: ", node(id));
    let to = format!("master → {}: ", node(id));
    match frame.get("function_code") {
        0x0 => {
            let command = match frame.get("nmt_ctrl.cd") {
                0x01 => "start",
                0x02 => "stop",
                0x80 => "enter pre-operational",
                0x81 => "reset application",
                0x82 => "reset communication",
                other => panic!("NMT {other}"),
            };
            let target = frame.get("nmt_ctrl.node_id");
            let target = if target == 0 { "all nodes".to_owned() } else { node(target) };
            said([format!("master: NMT {command}, {target}")])
        }
        0x1 if id == 0 => match frame.number("sync.counter") {
            Some(counter) => said([format!("SYNC, counter {counter}")]),
            None => said(["SYNC".to_owned()]),
        },
        0x1 => emergency(frame, id, from),
        0x2 => {
            let (ms, days) = (frame.get("time_stamp_ms") & 0x0FFF_FFFF, frame.get("time_stamp_days"));
            let (hours, minutes, seconds) = (ms / 3_600_000, ms / 60_000 % 60, ms / 1000 % 60);
            said([format!("TIME {hours:02}:{minutes:02}:{seconds:02}.{:03}, day {days} ", ms % 1000)])
        }
        pdo @ 0x3..=0xA => {
            let bytes = frame.bytes("pdo.data.bytes");
            let (direction, number) = (if pdo % 2 == 1 { from + "TPDO" } else { to + "RPDO" }, (pdo - 1) / 2);
            let word = format!("0x{:02X}{:02X}", bytes.get(1).unwrap_or(&0), bytes[0]);
            match (id, pdo) {
                (0x20, 0x3) => said([direction + " status word", word, "position".to_owned()]),
                (0x20, 0x4) => said([direction + " control word", word, "set-point".to_owned()]),
                (0x01, 0x3) => Said { words: vec![direction + " position "], value: Some(bytes) },
                _ if number == 1 => Said { words: vec![direction + " "], value: Some(bytes) },
                _ => Said { words: vec![format!("{direction} {number}: ")], value: Some(bytes) },
            }
        }
        0xB => sdo(frame, &from, false),
        0xC => sdo(frame, &to, true),
        0xE => said([
            from,
            (match frame.get("nmt_guard.state") {
                0x00 => "boot-up",
                0x04 => "NMT state stopped",
                0x05 => "NMT state operational",
                0x7F => "NMT state pre-operational",
                other => panic!("state {other}"),
            })
            .to_owned(),
        ]),
        0xF => lss(frame, id == 0x65),
        other => panic!("function code {other}"),
    }
}

fn emergency(frame: &Fields, id: u32, from: String) -> Said {
    let (code, register) = (frame.get("em.err_code"), frame.get("em.err_reg"));
    let field = frame.bytes("em.err_field");
    // The stand-ins' codes have names, others their number.
    let words = match (id, code) {
        (_, 0x0000) => return said([from, "EMCY: no error".to_owned()]),
        (0x20, 0x8003) => "time guarding".to_owned(),
        (0x20, 0x8305) => "spool not at set-point or float not reached".to_owned(),
        _ => format!("(0x{code:04X})"),
    };
    let field = if id == 0x20 { format!("count {}", field[0]) } else { renderings(&field)[0].clone() };
    said([from + "EMCY: ", words, format!("register 0x{register:02X}, {field}")])
}

fn sdo(frame: &Fields, who: &str, of_client: bool) -> Said {
    let service = |words: &str| format!("{who}SDO {words}");
    // Of the initiation of a block transfer, and of its refusal, tshark has no more than the service.
    let Some(command) = frame.number(if of_client { "sdo.ccs" } else { "sdo.scs" }) else {
        let upload = frame.text("col.Info").is_some_and(|info| info.ends_with("Block upload"));
        return said([service(match (upload, of_client) {
            (true, true) => "block read",
            (true, false) => "block read response",
            (false, _) => "block write",
        })]);
    };
    let object = || format!("0x{:04X}:{}", frame.get("sdo.main_idx"), frame.get("sdo.sub_idx"));
    let data = || frame.bytes("sdo.data.bytes");
    let size = || u32::from_le_bytes(data().try_into().expect("four bytes"));
    let toggle = || format!("toggle {}", frame.get("sdo.toggle"));
    let in_segments = |words: &str| match frame.flag("sdo.s") {
        true => said([service(words), object(), format!(", {} bytes in segments", size())]),
        false => said([service(words), object(), ", in segments".to_owned()]),
    };
    let segment = |words: &str| {
        let last = if frame.flag("sdo.c") { "last segment " } else { "segment " };
        match &data()[..7 - frame.get("sdo.n") as usize] {
            [] => said([service(words) + ", " + last + "without data"]),
            bytes => Said { words: vec![service(words) + ", " + last], value: Some(bytes.to_vec()) },
        }
    };
    let expedited = |words: &str| {
        let unused = if frame.flag("sdo.s") { frame.get("sdo.n") as usize } else { 0 };
        let bytes = data()[..4 - unused].to_vec();
        Said { words: vec![service(words), object(), " = ".to_owned()], value: Some(bytes) }
    };
    match (command, of_client) {
        (1, true) if frame.flag("sdo.e") => expedited("write"),
        (2, false) if frame.flag("sdo.e") => expedited("read response"),
        (1, true) => in_segments("write"),
        (2, false) => in_segments("read response"),
        (0, true) => segment("write"),
        (0, false) => segment("read response"),
        (2, true) => said([service("read "), object()]),
        (3, true) => said([service("read, next segment, "), toggle()]),
        (3, false) => said([service("write response "), object()]),
        (1, false) => said([service("write response, segment, "), toggle()]),
        (4, _) => said([service("abort "), object(), format!("(0x{:08X})", frame.get("sdo.abort_code"))]),
        (5 | 6, _) => match frame.get(if of_client { "sdo.cs" } else { "sdo.ss" }) {
            2 => {
                let (received, next) = (frame.get("sdo.ackseq"), frame.get("sdo.blksize"));
                said([service("block"), format!("received up to segment {received}, next block of {next}")])
            }
            1 if (command, of_client) == (5, false) => said([service("block write response, end")]),
            1 => said([service("block"), ", end".to_owned()]),
            3 => said([service("block read, start")]),
            other => panic!("block subcommand {other}"),
        },
        _ => panic!("SDO command {command}"),
    }
}

fn lss(frame: &Fields, of_master: bool) -> Said {
    let address = |part: u32, suffix: &str| {
        let (field, name) = [
            ("vendor", "vendor ID"),
            ("product", "product code"),
            ("revision", "revision"),
            ("serial", "serial number"),
        ][part as usize];
        (name.to_owned(), format!("0x{:08X}", frame.get(&format!("lss.addr.{field}{suffix}"))))
    };
    let words = |words: &str| format!("LSS {words}");
    let outcome = |what: &str, code: &str| match frame.get(code) {
        0 => said([words(what), "done".to_owned()]),
        error => said([words(what), format!("error {error}")]),
    };
    match (frame.get("lss.cs"), of_master) {
        (0x04, true) => said([words(
            ["switch all devices to waiting", "switch all devices to configuration"]
                [frame.get("lss.switch.mode") as usize],
        )]),
        (cs @ 0x40..=0x43, true) => {
            let (name, number) = address(cs - 0x40, "");
            said([words("select by"), name, number])
        }
        (0x44, false) => said([words("selected")]),
        (cs @ 0x46..=0x4B, true) => {
            let (part, suffix, limit) = [
                (0, "", "="),
                (1, "", "="),
                (2, "_low", ">="),
                (2, "_high", "<="),
                (3, "_low", ">="),
                (3, "_high", "<="),
            ][cs as usize - 0x46];
            let (name, number) = address(part, suffix);
            said([words("identify devices with"), name, limit.to_owned(), number])
        }
        (0x4F, false) => said([words("identified")]),
        (0x4C, true) => said([words("identify unconfigured devices")]),
        (0x50, false) => said([words("unconfigured device")]),
        (0x51, true) => {
            let (number, bit) = (frame.get("lss.fastscan.id"), frame.get("lss.fastscan.check"));
            said([words("fast scan"), format!("0x{number:08X} from bit {bit}")])
        }
        (cs @ 0x5A..=0x5D, true) => {
            let names = ["vendor ID", "product code", "revision", "serial number"];
            said([words("inquire "), names[cs as usize - 0x5A].to_owned()])
        }
        (cs @ 0x5A..=0x5D, false) => {
            let (name, number) = address(cs - 0x5A, "");
            said([words(&name), number])
        }
        (0x5E, true) => said([words("inquire node ID")]),
        (0x5E, false) => said([words(&format!("node ID 0x{:02X}", frame.get("lss.nid")))]),
        (0x11, true) => said([words(&format!("configure node ID 0x{:02X}", frame.get("lss.nid")))]),
        (0x11, false) => outcome("node ID", "lss.conf_id.err_code"),
        (0x13, true) => {
            let (table, index) = (frame.get("lss.bt.tbl_selector"), frame.get("lss.bt.tbl_index"));
            said([words(&format!("configure bit timing, table {table}, index {index}"))])
        }
        (0x13, false) => outcome("bit timing", "lss.conf_bt.err_code"),
        (0x15, true) => said([words(&format!("activate bit timing, switch delay {} ms", frame.get("lss.abt_delay")))]),
        (0x17, true) => said([words("store")]),
        (0x17, false) => outcome("store", "lss.store_conf.err_code"),
        (other, _) => panic!("LSS command {other}"),
    }
}

fn party(address: u32) -> String {
    match address {
        0xFF => "all".to_owned(),
        0xFE => "no address".to_owned(),
        address => {
            let known = NAMES.iter().find(|(known, _)| *known == address);
            known.map_or_else(|| format!("0x{address:02X}"), |(_, name)| (*name).to_owned())
        }
    }
}

fn group(pgn: u32) -> String {
    match pgn {
        0xEE00 => "address claim".to_owned(),
        0xFECA => "DM1".to_owned(),
        0xFECB => "DM2".to_owned(),
        0xFECC => "DM3 (clear previously active faults)".to_owned(),
        0xFED8 => "commanded address".to_owned(),
        0xFE10..=0xFE1F => format!("AVEF {}", pgn & 0xF),
        0xFE30..=0xFE3F => format!("AVC {}", pgn & 0xF),
        pgn => format!("PGN 0x{pgn:04X}"),
    }
}

fn three(bytes: &[u8]) -> String {
    group(bytes.iter().rev().fold(0, |pgn, byte| pgn << 8 | u32::from(*byte)))
}

/// A frame of 29 bits, as the dissectors of J1939 and ISOBUS see it.
fn j1939(frame: &Fields, isobus: &Fields) -> Said {
    if frame.flag("ex_data_page") {
        return said(["UDS ".to_owned()]);
    }
    let source = frame.get("src_addr");
    let from = format!("{}: ", party(source));
    let to_one = || format!("{} → {}: ", party(source), party(frame.get("dst_addr")));
    let bytes = frame.bytes("data");
    match frame.get("pgn") {
        0xEE00 if source == 0xFE => said([from, "cannot claim an address, NAME ".to_owned()]),
        0xEE00 => {
            let name: String = bytes.iter().rev().map(|byte| format!("{byte:02X}")).collect();
            said([from, format!("claims address 0x{source:02X}, NAME 0x{name} ")])
        }
        0xEA00 => said([to_one() + "request ", three(&bytes)]),
        0xE800 => {
            let what = ["done", "not supported", "access denied", "cannot respond now"][usize::from(bytes[0])];
            said([format!("{} → {}: {what}, {}", party(source), party(bytes[4].into()), three(&bytes[5..]))])
        }
        0xEC00 => transport(isobus, &from, &to_one()),
        0xEB00 => Said { words: vec![format!("{}packet {}: ", to_one(), bytes[0])], value: Some(bytes[1..].to_vec()) },
        pgn @ (0xFECA | 0xFECB) => said([from + &group(pgn) + " "]),
        pgn @ 0xFE10..=0xFE1F => said([from + "AVEF ", state(&bytes, pgn)]),
        pgn @ 0xFE30..=0xFE3F => {
            said([format!("{} → {}: AVC ", party(source), party(0x80 | pgn & 0xF)), state(&bytes, pgn)])
        }
        pgn if pgn & 0xFF00 >= 0xF000 => said([format!("{} → all: {}", party(source), group(pgn))]),
        pgn => said([to_one() + &group(pgn)]),
    }
}

/// The state in an AVC or AVEF, of which tshark has the bytes.
fn state(bytes: &[u8], pgn: u32) -> String {
    match bytes[2] & 0xF {
        0 => "blocked",
        1 => "extend",
        2 => "retract",
        3 => "float",
        10 => "hand operation",
        14 => "emergency stop",
        _ => panic!("{} of {bytes:?}", group(pgn)),
    }
    .to_owned()
}

fn transport(frame: &Fields, from: &str, to_one: &str) -> Said {
    let field = |message: &str, name: &str| frame.get(&format!("transport_protocol.{message}.{name}"));
    let rest = |message: &str| {
        let (size, packets) = (field(message, "total_size"), field(message, "number_of_packets"));
        format!("{}, {size} bytes in {packets} packets", group(field(message, "pgn")))
    };
    match frame.get("transport_protocol.control_byte") {
        32 => {
            let message = "broadcast_announce_message";
            let (size, packets) = (field(message, "total_message_size"), field(message, "total_number_of_packets"));
            let group = group(field(message, "pgn"));
            said([format!("{from}BAM, {group} follows, {size} bytes in {packets} packets")])
        }
        16 => said([format!("{to_one}transport, request to send, {}", rest("request_to_send"))]),
        17 => {
            let (count, next) = ("number_of_packets_that_can_be_sent", "next_packet_number");
            let (count, next) = (field("request_to_send", count), field("request_to_send", next));
            let group = group(field("clear_to_send", "pgn"));
            said([format!("{to_one}transport, clear to send, {group}, {count} packets from {next}")])
        }
        19 => said([format!("{to_one}transport, end of message, {}", rest("end_of_message_acknowledgement"))]),
        255 => {
            let (reason, pgn) = (field("connection_abort", "abort_reason"), field("connection_abort", "pgn"));
            said([format!("{to_one}transport, abort, {}, reason {reason}", group(pgn))])
        }
        other => panic!("control byte {other}"),
    }
}

/// Whether the trace takes a frame for a segment of an SDO block transfer.
fn is_block_segment(explanation: &str) -> bool {
    explanation.contains("SDO block") && !explanation.contains("received up to") && explanation.contains("segment ")
}

/// A valve and a sensor on CANopen and a valve on ISOBUS, their masters, and nodes that are none of them.
#[test]
fn every_frame_is_to_tshark_what_the_trace_says_it_is() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = |name: &str| dir.path().join(name).to_str().expect("text").to_owned();
    let devices = ["pvea-canopen", "hat1000,bit-rate=250k", "pvea-isobus@0x83"].map(|device| ["--device", device]);
    let run = |start: Start, log: &str, scripts: &[(&str, &[&str])]| {
        let options = ["--link", "pvea-canopen=hat1000", "--log", log];
        let simulator = start(&[devices.as_flattened(), &options].concat());
        scripts.iter().for_each(|(script, arguments)| _ = simulator.serve(script, arguments));
        (simulator.finish(), fs::read_to_string(log).expect("the log"))
    };
    let at_leisure: [(&str, &[&str]); 4] = [
        ("isobus_join.py", &[]),
        ("objects.py", &[]),
        ("foreign.py", &[]),
        ("uds.py", &["0x20", "0x5B2E0100", "0x21"]),
    ];
    let wound: [(&str, &[&str]); 3] =
        [("isobus_diagnostics.py", &[]), ("fault.py", &[]), ("../../examples/boom.py", &["10"])];
    let runs = [run(FREE, &path("leisure.log"), &at_leisure), run(WOUND, &path("wound.log"), &wound)];
    let [trace, log] = [runs.each_ref().map(|run| &*run.0).concat(), runs.each_ref().map(|run| &*run.1).concat()];
    let path = path("both.log");
    fs::write(&path, &log).expect("room");

    let frames = trace.lines().filter(|line| line.starts_with('('));
    let lines: Vec<(&str, &str)> = frames.map(|line| line.split_once("  ").expect("an explanation")).collect();
    assert!(lines.iter().map(|(frame, _)| *frame).eq(log.lines()), "the trace has the frames of the log");
    let [by_canopen, by_j1939, by_isobus] = [("canopen", CANOPEN), ("j1939", J1939), ("isobus", ISOBUS)]
        .map(|(protocol, fields)| tshark(&path, protocol, fields));
    assert_eq!([by_canopen.len(), by_j1939.len(), by_isobus.len()], [lines.len(); 3]);

    let mut differences = Vec::new();
    let (mut standard, mut extended, mut segments) = (0, 0, 0);
    for (number, (frame, explanation)) in lines.iter().enumerate() {
        for fields in [&by_canopen[number], &by_j1939[number], &by_isobus[number]] {
            assert_eq!(fields.text("malformed"), None, "{frame}  {explanation}");
        }
        let is_standard = by_canopen[number].number("function_code").is_some();
        let said = if is_block_segment(explanation) {
            segments += 1;
            let id = by_canopen[number].get("node_id");
            match by_canopen[number].get("function_code") {
                0xB => said([node(id) + ": SDO block read response, "]),
                _ => said([format!("master → {}: SDO block write, ", node(id))]),
            }
        } else if is_standard {
            canopen(&by_canopen[number])
        } else {
            j1939(&by_j1939[number], &by_isobus[number])
        };
        if !said.agrees(explanation) {
            differences.push(format!("{frame}  {explanation}\n  tshark: {said:?}"));
        }
        *(if is_standard { &mut standard } else { &mut extended }) += 1;
    }
    println!("{standard} frames of 11 bits, {segments} segments of block transfers among them, {extended} of 29 bits");
    assert!(differences.is_empty(), "{} differ:\n{}", differences.len(), differences.join("\n"));
    assert!(standard > 5000 && extended > 100, "{standard} {extended}");
    assert_eq!(segments, 7, "those of foreign.py");
}
