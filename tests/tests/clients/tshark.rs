//! What tshark says of a log, by the names of its fields.

use std::collections::HashMap;
use std::process::Command;

use crate::programs::output;

/// The fields of CANopen.
pub(crate) const CANOPEN: &[&str] = &[
    "canopen.function_code",
    "canopen.node_id",
    "canopen.nmt_ctrl.cd",
    "canopen.nmt_ctrl.node_id",
    "canopen.nmt_guard.state",
    "canopen.sync.counter",
    "canopen.time_stamp_ms",
    "canopen.time_stamp_days",
    "canopen.em.err_code",
    "canopen.em.err_reg",
    "canopen.em.err_field",
    "canopen.pdo.data.bytes",
    "canopen.sdo.ccs",
    "canopen.sdo.scs",
    "canopen.sdo.cs",
    "canopen.sdo.ss",
    "canopen.sdo.s",
    "canopen.sdo.e",
    "canopen.sdo.n",
    "canopen.sdo.c",
    "canopen.sdo.toggle",
    "canopen.sdo.main_idx",
    "canopen.sdo.sub_idx",
    "canopen.sdo.data.bytes",
    "canopen.sdo.abort_code",
    "canopen.sdo.ackseq",
    "canopen.sdo.blksize",
    "canopen.lss.cs",
    "canopen.lss.switch.mode",
    "canopen.lss.addr.vendor",
    "canopen.lss.addr.product",
    "canopen.lss.addr.revision",
    "canopen.lss.addr.revision_low",
    "canopen.lss.addr.revision_high",
    "canopen.lss.addr.serial",
    "canopen.lss.addr.serial_low",
    "canopen.lss.addr.serial_high",
    "canopen.lss.fastscan.id",
    "canopen.lss.fastscan.check",
    "canopen.lss.nid",
    "canopen.lss.conf_id.err_code",
    "canopen.lss.conf_bt.err_code",
    "canopen.lss.store_conf.err_code",
    "canopen.lss.bt.tbl_selector",
    "canopen.lss.bt.tbl_index",
    "canopen.lss.abt_delay",
];

/// The fields of J1939.
pub(crate) const J1939: &[&str] =
    &["j1939.pgn", "j1939.ex_data_page", "j1939.src_addr", "j1939.dst_addr", "j1939.group_extension", "j1939.data"];

/// The fields of ISOBUS: J1939 has none for the transport protocol.
pub(crate) const ISOBUS: &[&str] = &[
    "isobus.transport_protocol.control_byte",
    "isobus.transport_protocol.request_to_send.total_size",
    "isobus.transport_protocol.request_to_send.number_of_packets",
    "isobus.transport_protocol.request_to_send.pgn",
    "isobus.transport_protocol.request_to_send.number_of_packets_that_can_be_sent",
    "isobus.transport_protocol.request_to_send.next_packet_number",
    "isobus.transport_protocol.clear_to_send.pgn",
    "isobus.transport_protocol.end_of_message_acknowledgement.total_size",
    "isobus.transport_protocol.end_of_message_acknowledgement.number_of_packets",
    "isobus.transport_protocol.end_of_message_acknowledgement.pgn",
    "isobus.transport_protocol.connection_abort.abort_reason",
    "isobus.transport_protocol.connection_abort.pgn",
    "isobus.transport_protocol.broadcast_announce_message.total_message_size",
    "isobus.transport_protocol.broadcast_announce_message.total_number_of_packets",
    "isobus.transport_protocol.broadcast_announce_message.pgn",
];

/// The fields of a frame that tshark has, by their names without the protocol's.
pub(crate) struct Fields(HashMap<String, String>);

impl Fields {
    /// A field; `None` if the frame does not have it.
    pub(crate) fn text(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// A number, decimal or 0x.
    pub(crate) fn number(&self, name: &str) -> Option<u32> {
        let text = self.text(name)?;
        let number = match text.strip_prefix("0x") {
            Some(digits) => u32::from_str_radix(digits, 16),
            None => text.parse(),
        };
        Some(number.unwrap_or_else(|error| panic!("{name} {text}: {error}")))
    }

    /// A number that this frame has to have.
    pub(crate) fn get(&self, name: &str) -> u32 {
        self.number(name).unwrap_or_else(|| panic!("no {name}: {:?}", self.0))
    }

    /// A bit that this frame has to have.
    pub(crate) fn flag(&self, name: &str) -> bool {
        self.get(name) == 1
    }

    /// Bytes; none if the frame does not have the field.
    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        let text = self.text(name).unwrap_or_default();
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("hex")).collect()
    }
}

/// Returns the fields that tshark names for each frame of a log.
pub(crate) fn tshark(log: &str, protocol: &str, fields: &[&str]) -> Vec<Fields> {
    let mut tshark = Command::new("tshark");
    tshark.args(["-r", log, "-d", &format!("can.subdissector,{protocol}"), "-T", "fields", "-E", "separator=/t"]);
    let wanted = ["_ws.malformed", "_ws.col.Info"];
    tshark.args(wanted.iter().chain(fields).flat_map(|field| ["-e", field]));
    let run = output(&mut tshark);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let name = |field: &str| field.split_once('.').expect("a protocol").1.to_owned();
    let frame = |line: &str| {
        let values = wanted.iter().chain(fields).zip(line.split('\t')).filter(|(_, value)| !value.is_empty());
        Fields(values.map(|(field, value)| (name(field), value.to_owned())).collect())
    };
    String::from_utf8(run.stdout).expect("text").lines().map(frame).collect()
}
