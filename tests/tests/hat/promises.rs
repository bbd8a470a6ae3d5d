//! Whatever happens on a bus that blocks and frees: the last EMCY tells what is true (SPEC 9).

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BusErrorMode;
use tests::Rig;

use super::booted;

/// What can happen to a sensor and its bus.
#[derive(Clone, Copy, Debug)]
enum Event {
    Advance(u64),
    HoldBus(bool),
    Bus(BusErrorMode),
    Internal(bool),
    /// The internal fault comes and goes so many times.
    Toggle(usize),
    /// An NMT command to all, but "stop": in stopped EMCYs are logged and not sent.
    Nmt(u8),
    Sync,
}

fn event() -> impl Strategy<Value = Event> {
    let modes = [BusErrorMode::ErrorActive, BusErrorMode::ErrorPassive, BusErrorMode::BusOff];
    prop_oneof![
        4 => (0..=300_u64).prop_map(Event::Advance),
        3 => any::<bool>().prop_map(Event::HoldBus),
        3 => select(modes.to_vec()).prop_map(Event::Bus),
        3 => any::<bool>().prop_map(Event::Internal),
        1 => (1..30_usize).prop_map(Event::Toggle),
        2 => select(&[0x01, 0x80, 0x81, 0x82][..]).prop_map(Event::Nmt),
        2 => Just(Event::Sync),
    ]
}

fn act(rig: &mut Rig, event: Event) {
    match event {
        Event::Advance(ms) => rig.advance(ms),
        Event::HoldBus(held) => rig.hold_bus(held),
        Event::Bus(mode) => rig.sense_hat(|inputs| inputs.bus = mode),
        Event::Internal(fault) => rig.sense_hat(|inputs| inputs.internal_fault = fault),
        Event::Toggle(times) => {
            for _ in 0..times {
                rig.internal_fault_comes_and_goes();
            }
        }
        Event::Nmt(command) => rig.send(&format!("000: {command:02X} 00")),
        Event::Sync => rig.send("080:"),
    }
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
            act(&mut rig, event);
            sent.append(&mut rig.take());
        }
        rig.hold_bus(false);
        act(&mut rig, Event::Bus(if passive { BusErrorMode::ErrorPassive } else { BusErrorMode::ErrorActive }));
        rig.advance(1_000);
        sent.append(&mut rig.take());
        let register = rig.read(0x1001, 0);
        assert_eq!(told(&sent), register, "{sent:?}");
    }
}
