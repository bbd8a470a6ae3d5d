//! Smoke.
use tests::Rig;

#[test]
fn use_case_1_boot_to_active() {
    let mut valve = Rig::booted();
    valve.activate();
    valve.exchange("220: 0F 00 00 40", &["1A0: 0F 00 00 00"]);
    valve.advance(200);
    valve.exchange("220: 0F 00 00 40", &["1A0: 0F 00 33 33"]);
    assert_eq!(valve.read(0x1018, 1), 0x0100_0019);
    valve.exchange("620: 40 0A 10 00 00 00 00 00", &["5A0: 41 0A 10 00 2F 00 00 00"]);
    valve.exchange("620: 22 10 10 01 73 61 76 65", &["5A0: 60 10 10 01 00 00 00 00"]);
    valve.send("000: 81 00");
    assert_eq!(valve.take(), ["720: 00", "0A0: 00 00 00 00 00 00 00 00"]);
}

#[test]
fn use_case_3() {
    let mut valve = Rig::booted();
    valve.exchange("000: 02 00", &[]);
    valve.exchange("7E5: 04 01 00 00 00 00 00 00", &[]);
    valve.exchange("7E5: 11 17 00 00 00 00 00 00", &["7E4: 11 00 00 00 00 00 00 00"]);
    valve.exchange("7E5: 17 00 00 00 00 00 00 00", &["7E4: 17 00 00 00 00 00 00 00"]);
    valve.exchange("7E5: 04 00 00 00 00 00 00 00", &["717: 00", "097: 00 00 00 00 00 00 00 00"]);
}
