use protocol_core::device::pve::FAULT_CODES;
use protocol_core::wire::dm::{Trouble, single};

use super::*;
use crate::explain;

fn database() -> String {
    dbc(Kind::from_name("pvea-isobus").expect("a kind")).expect("a DBC")
}

#[test]
fn kinds_on_isobus_have_one() {
    let names: Vec<&str> = Kind::ALL.into_iter().filter(|kind| dbc(*kind).is_some()).map(Kind::name).collect();
    assert_eq!(names, ["pvea-isobus", "pveo-isobus"]);
}

#[test]
fn identifiers_of_an_address_as_the_page_has_them() {
    let database = database();
    for (name, id) in [
        ("AVC3", 0x0CFE_3327_u32),
        ("AVEF3", 0x0CFE_1383),
        ("DM1_83", 0x18FE_CA83),
        ("DM2_8F", 0x18FE_CB8F),
        ("AddressClaim_80", 0x18EE_FF80),
        ("Acknowledgement_83", 0x18E8_FF83),
        ("TP_CM_83_to_all", 0x1CEC_FF83),
        ("TP_CM_83", 0x1CEC_2783),
        ("TP_DT_83", 0x1CEB_FF83),
        ("Request_83", 0x18EA_8327),
        ("CommandedAddress", 0x18FE_D827),
    ] {
        let line = format!("BO_ {} {name}: ", EXTENDED | id);
        assert_eq!(database.matches(&line).count(), 1, "{line}");
    }
}

#[test]
fn tools_can_read_every_character() {
    assert!(database().is_ascii());
}

#[test]
fn values_have_names() {
    let database = database();
    for values in [
        "State 0 \"blocked\" 1 \"extend\" 2 \"retract\" 3 \"float\" 10 \"hand operation\" 14 \"emergency stop\" ;",
        "SPN 0 \"none\" 627 \"supply too low, supply too high (SPN 627)\" 36823 \"CAN bus",
        "(SPN 298985)\"",
        "FMI 0 \"none\" 3 \"voltage above normal\" 4 \"voltage below normal\" 7 ",
    ] {
        assert!(database.contains(values), "{values}");
    }
}

/// The signals of a trouble code decode to its SPN, FMI and name.
#[test]
fn trouble_codes_are_told_by_their_spn_and_fmi() {
    let messages = messages(Address::new(0x83));
    let message = messages.iter().find(|message| message.name == "DM1_83").expect("DM1");
    for codes in FAULT_CODES {
        let trouble = Trouble { lamp: codes.lamp, dtc: codes.dtc, count: 5 };
        let frame = u64::from_le_bytes(single(Some(trouble)));
        let signal = |name: &str| message.signals.iter().find(|signal| signal.name == name).expect("a signal");
        let raw = |name: &str| {
            let (first, len) = signal(name).bits;
            u32::try_from(frame >> first & ((1 << len) - 1)).expect("32 bits")
        };
        let named =
            |name: &str| signal(name).values.iter().find(|(value, _)| *value == raw(name)).map(|(_, text)| text);
        assert_eq!(raw("SPN_High") << 16 | raw("SPN"), codes.dtc.spn());
        assert_eq!((raw("FMI"), raw("OccurrenceCount"), raw("ConversionMethod")), (codes.dtc.fmi().into(), 5, 0));
        assert!(named("SPN").is_some_and(|text| text.contains(explain::fault(codes.fault))), "{:?}", codes.fault);
        assert!(named("FMI").is_some(), "{:?}", codes.fault);
    }
}
