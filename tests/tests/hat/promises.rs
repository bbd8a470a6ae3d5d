//! Whatever happens on a bus that blocks and frees: the last EMCY tells what is true (SPEC 9).

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use tests::hostile::Disturbance;

use super::booted;

fn event() -> impl Strategy<Value = Disturbance> {
    let modes = [BusErrorMode::ErrorActive, BusErrorMode::ErrorPassive, BusErrorMode::BusOff];
    // Of the NMT commands not "stop": in stopped EMCYs are logged and not sent.
    let orders = ["000: 01 00", "000: 80 00", "000: 81 00", "000: 82 00"];
    prop_oneof![
        4 => (0..=300_u64).prop_map(Disturbance::Advance),
        3 => any::<bool>().prop_map(Disturbance::HoldBus),
        3 => select(modes.to_vec()).prop_map(Disturbance::Bus),
        3 => any::<bool>().prop_map(Disturbance::Internal),
        1 => (1..30_usize).prop_map(Disturbance::Toggle),
        2 => select(orders.to_vec()).prop_map(Disturbance::Send),
        2 => Just(Disturbance::Send("080:")),
    ]
}

/// The error register of the last EMCY since the last boot-up; 0 without one.
fn told(frames: &[String]) -> u32 {
    let since_boot = frames.iter().rev().take_while(|frame| *frame != "701: 00");
    let last = since_boot.filter_map(|frame| frame.strip_prefix("081: ")).next();
    last.map_or(0, |data| u32::from_str_radix(&data[6..8], 16).expect("a register"))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_last_emcy_tells_the_present_register(events in vec(event(), 1..80), passive in any::<bool>()) {
        let mut rig = booted();
        // A TPDO with every SYNC, and no error that stops it.
        rig.write_all(&[(0x1800, 2, 1, 1), (0x1800, 1, 4, 0x181), (0x1029, 1, 1, 1), (0x1029, 2, 1, 1)]);
        let mut sent = Vec::new();
        for event in events {
            event.act(&mut rig);
            sent.append(&mut rig.take());
        }
        rig.hold_bus(false);
        let mode = if passive { BusErrorMode::ErrorPassive } else { BusErrorMode::ErrorActive };
        Disturbance::Bus(mode).act(&mut rig);
        rig.advance(1_000);
        sent.append(&mut rig.take());
        let register = rig.read(0x1001, 0);
        assert_eq!(told(&sent), register, "{sent:?}");
    }
}
