//! Recordings without named devices: identifies the devices by their frames, and explains error frames in Linux format.

use protocol_core::device::pve::DeviceState;
use protocol_core::device::{hat, pve};
use protocol_core::frame::{Frame, Id};
use protocol_core::wire::cob_id::{Function, classify};
use protocol_core::wire::j1939_id::{Address, J1939Id, Pgn};
use protocol_core::wire::name::Name;
use protocol_core::wire::sdo::{Answer, Multiplexer};

use super::{Explainer, Node};
use crate::Kind;
use crate::log::ErrorFrame;

/// The kinds that represent all CANopen valves, all angle sensors and all ISOBUS valves. Frames have the same meaning
/// for all kinds of a family.
const VALVE: Kind = Kind::Pve(pve::Kind::PveaCanopen);
const SENSOR: Kind = Kind::Hat(hat::Kind::Hat1000);
const ISOBUS_VALVE: Kind = Kind::Pve(pve::Kind::PveaIsobus);

/// The device profile numbers in the low half of object 0x1000: CiA 408 for fluid power, CiA 406 for encoders.
const FLUID_POWER: u16 = 408;
const ENCODER: u16 = 406;

/// The strength of the evidence for a sender's kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Evidence {
    /// A PDO of the sender resembles the default TPDO of a valve.
    Likeness,
    /// An object in an SDO response, or a NAME, identifies the kind of the sender.
    Proof,
}

impl Explainer {
    /// Learns the kind of a frame's sender, to explain this frame and later frames. Must be called before the frame is
    /// explained. Devices given by the caller are unchanged.
    pub fn learn(&mut self, frame: &Frame) {
        let Some((id, kind, evidence)) = told(frame) else { return };
        let is_known = self.nodes.iter().any(|node| node.node_id == Some(id))
            || self.learned.get(&id).is_some_and(|(_, known)| *known > evidence);
        if !is_known {
            let name = match kind.protocol() {
                pve::Protocol::Canopen => format!("node 0x{id:02X}"),
                pve::Protocol::Isobus => format!("0x{id:02X}"),
            };
            self.learned.insert(id, (Node { name, kind, node_id: Some(id) }, evidence));
        }
    }
}

/// Derives the sender of a frame: the node ID or address, the kind, and the strength of the evidence.
fn told(frame: &Frame) -> Option<(u8, Kind, Evidence)> {
    match frame.id() {
        Id::Standard(id) => {
            let (function, node) = classify(id)?;
            let (kind, evidence) = match function {
                Function::SdoAnswer => (by_object(Answer::parse(frame.eight()?)?)?, Evidence::Proof),
                Function::Tpdo1 => (by_pdo(frame.data())?, Evidence::Likeness),
                _ => return None,
            };
            Some((node.get(), kind, evidence))
        }
        Id::Extended(id) => {
            let id = J1939Id::from_raw(id.as_raw());
            let is_claim = id.pgn() == Pgn::ADDRESS_CLAIMED && id.source() != Address::NULL;
            let is_valve = is_claim && is_valve(Name::from_bytes(*frame.eight()?));
            is_valve.then_some((id.source().get(), ISOBUS_VALVE, Evidence::Proof))
        }
    }
}

/// Returns the kind of device that is identified by the object in an SDO response.
fn by_object(answer: Answer) -> Option<Kind> {
    match answer {
        Answer::UploadExpedited { object: Multiplexer { index: 0x1000, .. }, data, .. } => match data as u16 {
            FLUID_POWER => Some(VALVE),
            ENCODER => Some(SENSOR),
            _ => None,
        },
        Answer::UploadExpedited { object, .. } | Answer::DownloadDone(object) => match object.index {
            0x6300 | 0x6301 => Some(VALVE),
            0x6004 | 0x6501 => Some(SENSOR),
            _ => None,
        },
        _ => None,
    }
}

/// Returns the kind that is identified by the content of a TPDO: a valve if the first word is a valid status word.
fn by_pdo(data: &[u8]) -> Option<Kind> {
    let &[a, b, _, _] = data else { return None };
    let word = u16::from_le_bytes([a, b]);
    DeviceState::ALL.into_iter().any(|state| state.status_word() == word).then_some(VALVE)
}

/// Returns whether a NAME contains the manufacturer code and the function of the valves.
fn is_valve(name: Name) -> bool {
    const MANUFACTURER: u16 = 57;
    const FUNCTION: u8 = 255;
    let fields = name.fields();
    (fields.manufacturer_code, fields.function) == (MANUFACTURER, FUNCTION)
}

/// Explains an error frame in a recording (`linux/can/error.h`).
#[must_use]
pub fn explain_error_frame(error: &ErrorFrame) -> String {
    const CONTROLLER_CLASS: u32 = 0x004;
    const CLASSES: [(u32, &str); 8] = [
        (0x001, "transmission timed out"),
        (0x002, "arbitration lost"),
        (0x008, "protocol violation"),
        (0x010, "transceiver"),
        (0x020, "no acknowledgement"),
        (0x040, "bus-off"),
        (0x080, "bus error"),
        (0x100, "restarted after bus-off"),
    ];
    const CONTROLLER: [(u8, &str); 6] = [
        (0x01, "receive overflow"),
        (0x02, "transmit overflow"),
        (0x04, "receive warning"),
        (0x08, "transmit warning"),
        (0x30, "error-passive"),
        (0x40, "error-active"),
    ];
    let mut words: Vec<&str> =
        CLASSES.iter().filter(|(bit, _)| error.class & bit != 0).map(|(_, word)| *word).collect();
    if error.class & CONTROLLER_CLASS != 0 {
        let [_, state, ..] = error.data;
        let before = words.len();
        words.extend(CONTROLLER.iter().filter(|(bits, _)| state & bits != 0).map(|(_, word)| *word));
        if words.len() == before {
            words.push("controller");
        }
    }
    if words.is_empty() { "error frame".to_owned() } else { format!("error frame: {}", words.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::ErrorClass;

    /// Explains a frame after some earlier frames.
    fn said(before: &[&str], text: &str) -> String {
        let mut explainer = Explainer::default();
        for text in before.iter().chain([&text]) {
            explainer.learn(&text.parse().unwrap());
        }
        explainer.explain(&text.parse().unwrap(), None)
    }

    /// Valves and angle sensors share identifiers.
    #[test]
    fn frames_tell_what_a_device_is() {
        const PDO: &str = "1A0: 0A 10 00 00";
        const EMCY: &str = "0A0: 03 80 91 01 00 00 00 00";
        const VALVE: &str = "node 0x20: TPDO status word 0x100A (unknown state), position neutral";
        const SENSOR: &str = "node 0x20: TPDO position 4106 (90.22°)";
        assert_eq!(said(&[], PDO), VALVE);
        assert_eq!(said(&["5A0: 43 00 10 00 96 01 01 00"], PDO), SENSOR, "CiA 406");
        assert_eq!(said(&["5A0: 43 04 60 00 0A 10 00 00"], PDO), SENSOR);
        assert_eq!(
            said(&["1A0: 09 00 00 00", "5A0: 43 04 60 00 0A 10 00 00"], PDO),
            SENSOR,
            "what is sure counts more"
        );
        assert_eq!(said(&["5A0: 43 04 60 00 0A 10 00 00", "1A0: 09 00 00 00"], PDO), SENSOR, "in either order");
        for frame in ["5A0: 43 00 10 00 98 01 00 00", "5A0: 4B 01 63 01 00 00 00 00", "1A0: 0F 00 00 20"] {
            assert_eq!(
                said(&[frame], EMCY),
                "node 0x20: EMCY: time guarding (0x8003), register 0x91, count 1",
                "{frame}"
            );
        }
        // A device with another profile, another node ID, and an abort.
        for frame in ["5A0: 43 00 10 00 92 01 00 00", "5A1: 43 00 10 00 98 01 00 00", "5A0: 80 01 63 01 00 00 02 06"] {
            assert_eq!(said(&[frame], EMCY), said(&[], EMCY), "{frame}");
        }
    }

    #[test]
    fn a_claim_tells_of_a_valve() {
        const READ: &str = "1BC788F1: 03 22 F1 8C 55 55 55 55";
        let claimed = said(&["18EEFF83: 01 00 20 07 08 FF 02 20"], "0CFE1383: 7D 7D 30 FF FF FF FF FF");
        assert_eq!(claimed, "0x83: AVEF blocked, no flow");
        assert_eq!(said(&["18EEFF83: 01 00 20 07 08 FF 02 20"], READ), said(&[], READ), "another one");
    }

    /// Learning does not change given devices.
    #[test]
    fn devices_that_are_given_stay() {
        let node = Node { name: "boom".to_owned(), kind: VALVE, node_id: Some(0x20) };
        let mut explainer = Explainer::new(vec![node]);
        explainer.learn(&"5A0: 43 00 10 00 96 01 01 00".parse().unwrap());
        assert_eq!(explainer.explain(&"720: 00".parse().unwrap(), None), "boom: boot-up");
        assert!(explainer.explain(&"1A0: 0A 10 00 00".parse().unwrap(), None).contains("status word"));
    }

    #[test]
    fn error_frames_of_linux() {
        let said = |class: ErrorClass| explain_error_frame(&class.into());
        assert_eq!(said(ErrorClass::NoAcknowledge), "error frame: no acknowledgement");
        assert_eq!(said(ErrorClass::BusError), "error frame: bus error");
        assert_eq!(said(ErrorClass::ErrorPassive), "error frame: error-passive");
        assert_eq!(said(ErrorClass::ErrorActive), "error frame: error-active");
        assert_eq!(said(ErrorClass::BusOff), "error frame: bus-off");
        assert_eq!(said(ErrorClass::Restarted), "error frame: restarted after bus-off");
        assert_eq!(said(ErrorClass::TransmitOverflow), "error frame: transmit overflow");
        assert_eq!(explain_error_frame(&ErrorFrame::UNTOLD), "error frame");
        let both = ErrorFrame { class: 0x8C, data: [0, 0x08, 0, 0, 0, 0, 0, 0] };
        assert_eq!(explain_error_frame(&both), "error frame: protocol violation, bus error, transmit warning");
        assert_eq!(explain_error_frame(&ErrorFrame { class: 0x4, data: [0; 8] }), "error frame: controller");
    }
}
