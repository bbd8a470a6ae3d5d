use protocol_core::frame::{extended, standard};
use serde_json::{Value, json};

use super::*;
use crate::state::schema::Schemas;

fn fault(request: &Value) -> Result<Fault, String> {
    Schemas::of::<FaultRequest>().check("CommunicationFault", request, "null").map_err(|mismatch| mismatch.reason)?;
    let request: FaultRequest = serde_json::from_value(request.clone()).map_err(|error| error.to_string())?;
    request.fault().map_err(|Invalid(reason)| reason)
}

fn text(request: &Value) -> String {
    fault(request).map_or_else(|reason| panic!("{request}: {reason}"), |fault| fault.to_string())
}

#[test]
fn each_kind_with_its_parameters() {
    for (request, expected) in [
        (json!({ "lose": "220", "count": 3 }), "lose 220, count 3"),
        (json!({ "lose": "all", "receivers": ["boom", "http"] }), "lose all for boom, http"),
        (json!({ "lose": 544, "mask": "7F0", "sender": "http" }), "lose 220 mask 7F0 of http"),
        (json!({ "delay": "0CFE3027", "ms": 20, "probability": 0.25 }), "delay 0CFE3027 by 20 ms, probability 0.25"),
        (
            json!({ "delay": "1A0", "ms": [5, 20], "overtake": true }),
            "delay 1A0 by 5 ms to 20 ms, overtaken by later ones",
        ),
        (json!({ "delay": "1A0", "burst_ms": 100 }), "delay 1A0 into bursts every 100 ms"),
        (json!({ "repeat": "1A0" }), "repeat 1A0 once"),
        (json!({ "repeat": "1A0", "times": 3, "after_ms": 7 }), "repeat 1A0 3 times every 7 ms"),
        (json!({ "swap": "1A0" }), "swap 1A0 within 1000 ms"),
        (json!({ "corrupt": "1A0", "data": { "toggle": "00 80" } }), "corrupt 1A0, data toggle 0080"),
        (
            json!({ "corrupt": "1A0", "identifier": { "set": "001" }, "dlc": { "clear": 8 } }),
            "corrupt 1A0, identifier set 1, dlc clear 8",
        ),
        (json!({ "insert": "220#0F00 0020" }), "insert 220: 0F 00 00 20"),
        (json!({ "masquerade": "1A0#", "every_ms": 20, "count": 5 }), "insert 1A0: every 20 ms, count 5"),
        (json!({ "destroy": "all", "from_ms": 100, "for_ms": 50 }), "destroy all, from 100 ms, for 50 ms"),
        (json!({ "omit": "1A0", "receivers": ["boom"] }), "omit 1A0 for boom"),
    ] {
        assert_eq!(text(&request), expected, "{request}");
    }
}

#[test]
fn the_values_of_a_fault() {
    let fault = fault(&json!({
        "corrupt": 0x0CFE_3027, "name": "flipped", "sender": "boom", "seed": 7, "count": 2,
        "data": { "set": "01", "clear": "0002", "toggle": "0000FF" },
    }))
    .expect("a fault");
    assert_eq!(&*fault.name, "flipped");
    assert_eq!(fault.frames.id, Some(extended(0x0CFE_3027).into()));
    assert_eq!((fault.seed, fault.count), (7, Some(2)));
    let FaultKind::Corrupt(Corruption { data, .. }) = fault.kind else { panic!("{fault:?}") };
    assert_eq!(data.set, [1, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(data.clear, [0, 2, 0, 0, 0, 0, 0, 0]);
    assert_eq!(data.toggle, [0, 0, 0xFF, 0, 0, 0, 0, 0]);
}

#[test]
fn a_name_is_made_of_kind_and_identifier() {
    let named = |request| fault(&request).map(|fault| (fault.name.to_string(), fault.default_name()));
    assert_eq!(named(json!({ "lose": "220" })), Ok((String::new(), "lose-220".to_owned())));
    assert_eq!(named(json!({ "insert": "0CFE3027#00" })), Ok((String::new(), "insert-0CFE3027".to_owned())));
    assert_eq!(named(json!({ "destroy": "all" })), Ok((String::new(), "destroy".to_owned())));
    let id = fault(&json!({ "lose": "220" })).expect("a fault").frames.id;
    assert_eq!(id, Some(standard(0x220).into()));
}

#[test]
fn another_fault_is_refused_in_one_line() {
    let long = "x".repeat(65);
    for (request, reason) in [
        (json!({}), "a fault needs one of lose, delay,"),
        (json!({ "count": 1 }), "a fault needs one of lose, delay,"),
        (json!({ "lose": "220", "swap": "220" }), "lose and swap: a fault has exactly one of "),
        (json!({ "lose": "220", "ms": 5 }), "ms is only valid with delay"),
        (json!({ "insert": "220#", "sender": "boom" }), "sender is only valid with lose, delay, repeat, swap,"),
        (json!({ "destroy": "all", "receivers": [] }), "receivers is only valid with lose, omit"),
        (json!({ "lose": "220", "probability": 2 }), "probability 2 is not valid; accepted: a number from 0 to 1"),
        (
            json!({ "lose": "220", "probability": -0.5 }),
            "probability -0.5 is not valid; accepted: a number from 0 to 1",
        ),
        (json!({ "lose": "220", "count": 0 }), "count 0 is not valid; "),
        (json!({ "lose": "220", "for_ms": 0 }), "for_ms 0 is not valid; "),
        (json!({ "lose": "220", "from_ms": 86_400_001 }), "from_ms 86400001 is not valid; "),
        (json!({ "lose": "" }), "lose: id \"\" is not valid; "),
        (json!({ "omit": "88888888" }), "omit: id \"88888888\" is not valid; "),
        (json!({ "lose": 16384, "extended": false }), "lose: id 16384 is not valid; "),
        (
            json!({ "lose": "zz" }),
            "lose: id \"zz\" is not valid; accepted: 0 to 2047, or a hex string as in \"220\"; \
             29-bit identifiers need eight digits, or extended set to true; all selects every identifier",
        ),
        (json!({ "lose": "220", "mask": "zz" }), "mask: id \"zz\" is not valid; accepted: "),
        (json!({ "lose": "all", "mask": "7F0" }), "mask and extended are only valid with an identifier"),
        (json!({ "lose": "220", "receivers": [] }), "receivers must not be empty"),
        (json!({ "lose": "220", "probability": 1e-9 }), "probability 0.000000001: must be 0 or at least 0.000001"),
        (json!({ "lose": "220", "mask": "FFF" }), "mask: id \"FFF\" is not valid; "),
        (json!({ "delay": "220" }), "delay needs ms or burst_ms, such as ms=20"),
        (json!({ "delay": "220", "ms": 5, "burst_ms": 5 }), "delay needs either ms or burst_ms, not both"),
        (json!({ "delay": "220", "ms": [20, 5] }), "the first bound of the delay"),
        (json!({ "delay": "220", "ms": [1, 2, 3] }), ""),
        (json!({ "repeat": "220", "times": 1001 }), "times 1001 is not valid; "),
        (json!({ "corrupt": "220" }), "corrupt needs at least one mask"),
        (json!({ "corrupt": "220", "data": { "toggle": "0" } }), "data: '0' is not up to 8 bytes"),
        (json!({ "corrupt": "220", "data": { "toggle": "é" } }), "data: 'é' is not up to 8 bytes"),
        (json!({ "corrupt": "220", "dlc": { "set": 16 } }), "dlc.set 16 is not valid; "),
        (json!({ "insert": "220#0?" }), "insert: '220#0?' is not a frame"),
        (json!({ "omit": "220" }), "omit needs receivers"),
        (json!({ "lose": "220", "name": "" }), "name '': "),
        (json!({ "lose": "220", "name": "all" }), "name 'all': must be 1 to 64 letters, digits and '-', but not all"),
        (json!({ "lose": "220", "name": long }), "name 'xxx"),
        (json!({ "loose": "220" }), "unknown key 'loose'; did you mean 'lose'?"),
        (json!({ "lose": "220", "count": null }), "count null is not valid; "),
    ] {
        let refused = fault(&request).expect_err(&request.to_string());
        assert!(refused.starts_with(reason) && !refused.contains('\n'), "{request}: {refused}");
    }
}
