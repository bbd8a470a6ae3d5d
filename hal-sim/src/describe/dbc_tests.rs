use super::*;

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
        "262771 \"supply too low (SPN 627 FMI 4)\"",
    ] {
        assert!(database.contains(values), "{values}");
    }
}
