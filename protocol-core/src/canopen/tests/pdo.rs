//! PDO parameters of a product that requires the mapping order of CiA 301 and permits 29-bit identifiers but no
//! dummies.

use super::Rig;

fn done(answer: &str) -> bool {
    answer.as_bytes().get(5..7) == Some(b"60")
}

#[track_caller]
fn write(rig: &mut Rig, text: &str, abort: Option<&str>) {
    let answers = rig.exchange(text);
    match abort {
        None => assert!(done(&answers[0]), "{text}: {answers:?}"),
        Some(code) => assert!(answers[0].ends_with(code), "{text}: {answers:?}"),
    }
}

const OFF: &str = "605: 23 00 18 01 00 00 00 80";
const ON: &str = "605: 23 00 18 01 85 01 00 00";

#[test]
fn entries_change_while_nothing_is_counted() {
    let mut rig = Rig::booted();
    write(&mut rig, OFF, None);
    write(&mut rig, "605: 23 00 1A 01 08 00 01 10", Some("22 00 00 08"));
    write(&mut rig, "605: 2F 00 1A 00 00 00 00 00", None);
    write(&mut rig, "605: 23 00 1A 01 08 00 01 10", None);
    write(&mut rig, "605: 23 00 1A 02 08 00 05 00", Some("41 00 04 06"));
    write(&mut rig, "605: 23 00 1A 02 08 00 00 62", Some("41 00 04 06"));
    write(&mut rig, "605: 2F 00 1A 00 01 00 00 00", None);
    write(&mut rig, ON, None);
    rig.lamp.register = 0x21;
    rig.exchange("000: 01 00");
    assert_eq!(rig.exchange("205: 07"), ["185: 21"]);
}

#[test]
fn nothing_mapped_may_be_on_and_29_bits_are_identifiers() {
    let mut rig = Rig::booted();
    write(&mut rig, OFF, None);
    write(&mut rig, "605: 2F 00 1A 00 00 00 00 00", None);
    write(&mut rig, "605: 23 00 18 01 85 01 00 20", None);
    rig.exchange("000: 01 00");
    assert!(rig.exchange("205: 07").is_empty(), "a PDO of nothing is not sent");
    write(&mut rig, "605: 23 00 18 01 85 01 00 00", Some("22 00 00 08"));
    write(&mut rig, OFF, None);
    write(&mut rig, "605: 2F 00 1A 00 01 00 00 00", None);
    write(&mut rig, "605: 23 00 18 01 85 01 00 20", None);
    assert_eq!(rig.exchange("205: 07"), ["00000185: 07"]);
    write(&mut rig, OFF, None);
    assert!(rig.exchange("205: 08").is_empty());
}

#[test]
fn transmission_types_of_the_product() {
    let mut rig = Rig::booted();
    for (kind, abort) in
        [("00", None), ("F0", None), ("FE", None), ("F1", Some("30 00 09 06")), ("FD", Some("30 00 09 06"))]
    {
        write(&mut rig, &std::format!("605: 2F 00 18 02 {kind} 00 00 00"), abort);
    }
}

extern crate std;
