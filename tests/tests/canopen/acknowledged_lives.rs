//! Random lives of a valve, each with stores, failing writes and a bus that blocks, each ended by a power cut: what was
//! acknowledged is there in the next one (SPEC 4.5, 6).

use std::collections::BTreeSet;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol_core::controller::BitRate;
use protocol_core::time::Duration;
use tests::{Rig, lss};

/// 0x1028:1 when it is off, the default.
const DEFAULT: u32 = 0x8000_0000;

/// What a client does in one life.
#[derive(Clone, Copy, Debug)]
enum Event {
    /// Changes a parameter, and saves.
    Save,
    Load,
    /// Stores a bit rate by LSS.
    Rate(BitRate),
    /// Stores a node ID by UDS.
    NodeId(u8),
    Advance(u64),
    HoldBus(bool),
    /// The write of this number from now on fails.
    Fail(usize),
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        4 => Just(Event::Save),
        3 => Just(Event::Load),
        2 => select(&[BitRate::Kbit500, BitRate::Kbit250, BitRate::Kbit125][..]).prop_map(Event::Rate),
        2 => (0x10..0x40_u8).prop_map(Event::NodeId),
        8 => (0..=30_u64).prop_map(Event::Advance),
        1 => any::<bool>().prop_map(Event::HoldBus),
        2 => (0..4_usize).prop_map(Event::Fail),
    ]
}

/// What the memory may hold of a value that is stored again and again.
#[derive(Debug)]
struct Kept<T> {
    /// As it was found, then as it was asked for.
    values: Vec<T>,
    /// How many requests have been acknowledged. Which ones is not told: the first ones at the least.
    acknowledged: usize,
}

impl<T: Copy + Ord> Kept<T> {
    fn found(value: T) -> Self {
        Self { values: vec![value], acknowledged: 0 }
    }

    fn may_be(&self) -> BTreeSet<T> {
        self.values[self.acknowledged..].iter().copied().collect()
    }
}

/// A life: what was found at its start, and what was asked for.
struct Life {
    parameter: Kept<u32>,
    rate: Kept<BitRate>,
    node_id: Kept<u8>,
    load_asked: bool,
    load_acknowledged: bool,
    /// The node ID in force.
    own: u8,
}

impl Life {
    fn begin(valve: &mut Rig) -> Self {
        let own = valve.node_id().expect("a node ID");
        valve.take();
        let parameter = valve.read(0x1028, 1);
        valve.send(lss::TO_CONFIGURATION);
        valve.take();
        Self {
            parameter: Kept::found(parameter),
            rate: Kept::found(valve.device().bit_rate()),
            node_id: Kept::found(own),
            load_asked: false,
            load_acknowledged: false,
            own,
        }
    }

    fn act(&mut self, valve: &mut Rig, event: Event, fresh: u32) {
        let sdo = format!("{:03X}", 0x600 + u16::from(self.own));
        match event {
            Event::Save => {
                valve.send(&format!("{sdo}: 23 28 10 01 {fresh:02X} 02 00 00"));
                self.parameter.values.push(0x200 | fresh);
                valve.send(&format!("{sdo}: 23 10 10 01 73 61 76 65"));
            }
            Event::Load => {
                valve.send(&format!("{sdo}: 23 11 10 01 6C 6F 61 64"));
                self.load_asked = true;
            }
            Event::Rate(rate) => {
                valve.send(&format!("7E5: 13 00 {:02X} 00 00 00 00 00", rate.table_index()));
                valve.send(lss::STORE);
                self.rate.values.push(rate);
            }
            Event::NodeId(node_id) => {
                valve.send(&format!("{:08X}: 04 2E 10 01 {node_id:02X}", 0x1BC7_8800 | u32::from(self.own)));
                self.node_id.values.push(node_id);
            }
            Event::Advance(ms) => valve.advance(ms),
            Event::HoldBus(held) => valve.hold_bus(held),
            Event::Fail(number) => _ = valve.failing_writes.insert(number),
        }
        let answer = format!("{:03X}: 60 1", 0x580 + u16::from(self.own));
        for frame in valve.take() {
            match frame.strip_prefix(&answer) {
                Some(saved) if saved.starts_with("0 10") => self.parameter.acknowledged += 1,
                Some(loaded) if loaded.starts_with("1 10") => self.load_acknowledged = true,
                _ => {}
            }
            self.rate.acknowledged += usize::from(frame == lss::STORED);
            self.node_id.acknowledged += usize::from(frame == "1BC408F1: 03 6E 10 01");
        }
    }

    /// What the next life has to find.
    fn check(&self, next: &Self) -> Result<(), TestCaseError> {
        let mut parameters = self.parameter.may_be();
        if self.load_acknowledged {
            parameters = [DEFAULT].into();
        } else if self.load_asked {
            parameters.insert(DEFAULT);
        }
        let found = next.parameter.values[0];
        prop_assert!(parameters.contains(&found), "0x1028:1 is {:X}, not one of {:X?}", found, parameters);
        let (rates, found) = (self.rate.may_be(), next.rate.values[0]);
        prop_assert!(rates.contains(&found), "{:?}, not one of {:?}", found, rates);
        let (node_ids, found) = (self.node_id.may_be(), next.own);
        prop_assert!(node_ids.contains(&found), "node {:X}, not one of {:X?}", found, node_ids);
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn what_was_acknowledged_is_there(
        lives in vec(vec(event(), 0..20), 1..8),
        ms in 1..=20_u64,
    ) {
        let mut valve = Rig::booted();
        valve.write_time = Duration::from_millis(ms);
        let mut life = Life::begin(&mut valve);
        let mut fresh = 0;
        for events in lives {
            for event in events {
                fresh = (fresh + 1) % 0x80;
                life.act(&mut valve, event, fresh);
            }
            valve.hold_bus(false);
            life.act(&mut valve, Event::Advance(0), 0);
            valve.failing_writes.clear();
            valve.power_cycle();
            let next = Life::begin(&mut valve);
            life.check(&next)?;
            life = next;
        }
    }
}
