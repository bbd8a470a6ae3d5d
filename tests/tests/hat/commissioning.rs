//! The manual's two commissioning sequences, frame by frame (H 11.2).

use protocol_core::controller::BitRate;

use super::booted;

#[test]
fn node_id_11_2_1() {
    let mut rig = booted();
    rig.exchange("7E5: 04 01 00 00 00 00 00 00", &[]);
    rig.exchange("7E5: 11 0C 00 00 00 00 00 00", &["7E4: 11 00 00 00 00 00 00 00"]);
    rig.exchange("7E5: 17 00 00 00 00 00 00 00", &["7E4: 17 00 00 00 00 00 00 00"]);
    rig.power_cycle_sends(&["70C: 00"]);
    assert_eq!(rig.read(0x2001, 1), 12);
}

#[test]
fn bit_rate_11_2_2() {
    let mut rig = booted();
    rig.silent_to(&["000: 02 00", "7E5: 04 01 00 00 00 00 00 00"]);
    rig.exchange("7E5: 13 00 04 00 00 00 00 00", &["7E4: 13 00 00 00 00 00 00 00"]);
    // 500 ms to the switch, 500 ms of silence, no answer.
    rig.exchange("7E5: 15 F4 01 00 00 00 00 00", &[]);
    rig.advance(499);
    assert_eq!(rig.bit_rates(), []);
    rig.advance(1);
    assert_eq!(rig.bit_rates(), [BitRate::Kbit125]);
    rig.exchange("7E5: 17 00 00 00 00 00 00 00", &[]);
    rig.silent_for(500);
    rig.exchange("7E5: 17 00 00 00 00 00 00 00", &["7E4: 17 00 00 00 00 00 00 00"]);
    rig.power_cycle_sends(&["701: 00"]);
    assert_eq!(rig.device().bit_rate(), BitRate::Kbit125);
}
