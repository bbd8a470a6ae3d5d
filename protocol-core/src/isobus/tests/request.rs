use super::*;
use crate::isobus::request::Request;
use crate::wire::j1939_id::{J1939Id, Pgn};
use crate::wire::request::Control;

fn request(text: &str) -> Option<Request> {
    let frame = frame(text);
    Request::of(J1939Id::of(&frame)?, &frame)
}

#[test]
fn one_to_this_controller_and_one_to_all() {
    let addressed = Request { pgn: Pgn::DM3, requester: TOOL, addressed: true };
    assert_eq!(request("18EA8327: CC FE 00"), Some(addressed));
    assert_eq!(request("18EAFF27: CC FE 00"), Some(Request { addressed: false, ..addressed }));
}

#[test]
fn the_priority_does_not_count() {
    assert!(request("00EA8327: CC FE 00").is_some());
    assert!(request("1CEA8327: CC FE 00").is_some());
}

#[test]
fn a_malformed_request_is_none() {
    for malformed in ["18EA8327: CC FE", "18EA8327:", "18EA8327: R3"] {
        assert_eq!(request(malformed), None, "{malformed}");
    }
}

#[test]
fn an_order_is_acknowledged_when_it_was_addressed() {
    let addressed = request("18EA8327: CC FE 00").unwrap();
    assert_eq!(text(addressed.acknowledgement(Control::Positive, OWN)), "18E8FF83: 00 FF FF FF 27 CC FE 00");
    let global = request("18EAFF27: CC FE 00").unwrap();
    assert_eq!(global.acknowledgement(Control::Positive, OWN), None);
}

#[test]
fn an_unsupported_group_is_refused_when_it_was_addressed() {
    let addressed = request("18EA8327: EB FE 00").unwrap();
    assert_eq!(text(addressed.acknowledgement(Control::Negative, OWN)), "18E8FF83: 01 FF FF FF 27 EB FE 00");
    let strange = request("18EA8327: CC FE FC").unwrap();
    assert_ne!(strange.pgn, Pgn::DM3);
    assert_eq!(text(strange.acknowledgement(Control::Negative, OWN)), "18E8FF83: 01 FF FF FF 27 CC FE FC");
    let global = request("18EAFF27: EB FE 00").unwrap();
    assert_eq!(global.acknowledgement(Control::Negative, OWN), None);
}

/// 0xFE is the source address of a controller without an address; no controller has 0xFF.
#[test]
fn an_asker_without_an_address_is_not_acknowledged() {
    for text in ["18EA83FE: CC FE 00", "18EA83FF: CC FE 00"] {
        let request = request(text).unwrap();
        for control in Control::ALL {
            assert_eq!(request.acknowledgement(control, OWN), None, "{text}");
        }
    }
}
