//! Checks the table of possible values against the devices: the devices have every value in the table, and no other
//! values.

use std::collections::BTreeMap;

use protocol_core::device::{Setup, hat, pve};
use protocol_core::frame::standard;
use protocol_core::time::Duration;
use serde_json::{Value as Json, json};

use super::*;
use crate::bus::Disturbance;
use crate::state::{DeviceState, PlantChange, Power};
use crate::world::{ClientPortId, NodeId, World};

const NAME: &str = "boom";

/// A device on a bus, with all states that have occurred.
struct Rig {
    world: World,
    master: ClientPortId,
    node: NodeId,
    kind: Kind,
    /// The values of each key, with and without power, and the numbers among them.
    seen: BTreeMap<(bool, String), Vec<Json>>,
}

impl Rig {
    fn new(setup: Setup) -> Self {
        let kind = setup.kind;
        let mut world = World::new(kind.bit_rates()[0], 1);
        let node = world.add(NAME, setup);
        let master = world.add_client_port("master");
        let mut rig = Self { world, master, node, kind, seen: BTreeMap::new() };
        rig.pass(2);
        rig.power(Power::On);
        rig.pass(300);
        rig
    }

    /// Advances time and records each state, which must be in the table.
    fn pass(&mut self, ms: u32) {
        for _ in 0..ms {
            self.world.run_for(Duration::from_millis(1));
            self.look();
        }
    }

    fn look(&mut self) {
        let state = DeviceState::of(self.node, self.kind, &self.world);
        let active: Vec<&str> = state.faults.iter().filter(|fault| fault.active).map(|fault| fault.fault).collect();
        let mut keys = json!(state);
        keys["faults"] = json!(active);
        let table = table(self.kind, NAME, state.powered);
        let mut known: Vec<&str> = table.iter().map(|(key, _)| *key).chain(["plant"]).collect();
        known.sort_unstable();
        assert_eq!(keys.as_object().expect("an object").keys().collect::<Vec<_>>(), known);
        for (key, values) in table {
            let value = keys[key].take();
            assert!(values.iter().any(|it| it.share(&value) != Share::None), "{key} of {}: {value}", self.kind);
            let seen = self.seen.entry((state.powered, key.to_owned())).or_default();
            if key != "t_us" && !seen.contains(&value) {
                seen.push(value);
            }
        }
    }

    fn power(&mut self, power: Power) {
        power.switch(self.node, &mut self.world).expect("it can be");
        self.look();
    }

    fn plant(&mut self, change: Json) {
        let change: PlantChange = serde_json::from_value(change).expect("a change");
        change.make(self.node, &mut self.world).expect("it can be");
        self.look();
    }

    fn send(&mut self, frame: &str) {
        self.world.send(self.master, frame.parse().expect("a frame"));
        self.pass(5);
    }

    /// Sends a frame every 50 ms.
    fn drive(&mut self, frame: &str, ms: u32) {
        for _ in 0..ms / 50 {
            self.send(frame);
            self.pass(45);
        }
    }

    /// Causes the faults of a valve. `neutral`, `full` and `float` are command frames.
    fn break_valve(&mut self, neutral: &str, full: &str, float: &str, recover: &[&str]) {
        let faults = [
            (neutral, json!({"supply_mv": 8000}), json!({"supply_mv": 24000}), neutral, 2200),
            (neutral, json!({"supply_mv": 40000}), json!({"supply_mv": 24000}), neutral, 2200),
            (neutral, json!({"temperature_c": 130}), json!({"temperature_c": 20}), neutral, 400),
            (neutral, json!({"internal_fault": true}), json!({"internal_fault": false}), neutral, 50),
            (neutral, json!({"bus_off": true}), json!({"bus_off": false}), neutral, 50),
            (full, json!({"spool": {"fault": "stuck"}}), json!({"spool": {"fault": null}}), neutral, 900),
            (neutral, json!({"spool": {"fault": "no-float"}}), json!({"spool": {"fault": null}}), float, 1500),
        ];
        for (before, broken, mended, command, ms) in faults {
            self.drive(before, 400);
            self.plant(broken);
            self.drive(command, ms);
            self.plant(mended);
            self.drive(neutral, 400);
            recover.iter().for_each(|frame| self.send(frame));
        }
        self.drive(neutral, 200);
        self.pass(400);
    }

    /// Asserts that all states of the table have occurred: words, faults, and the range of positions.
    fn assert_all_seen(rigs: &[Self]) {
        let kind = rigs[0].kind;
        for powered in [true, false] {
            for (key, values) in table(kind, NAME, powered) {
                let seen: Vec<&Json> =
                    rigs.iter().filter_map(|rig| rig.seen.get(&(powered, key.to_owned()))).flatten().collect();
                let has = |value: &Json| seen.iter().any(|seen| is_part(value, seen));
                for value in values {
                    let missing: Vec<Json> = match value {
                        Values::One(value) => vec![value],
                        Values::Numbers(range) if ["position", "set_point"].contains(&key) => {
                            vec![json!(range.start()), json!(range.end())]
                        }
                        Values::Numbers(_) => Vec::new(),
                        Values::Sets(names) => names.iter().map(|name| json!([name])).collect(),
                    };
                    let missing: Vec<&Json> = missing.iter().filter(|value| !has(value)).collect();
                    assert!(missing.is_empty(), "{key} of {kind} was never {missing:?}; powered: {powered}");
                }
            }
        }
    }
}

fn valves(proportional: pve::Kind, on_off: pve::Kind) -> [Kind; 2] {
    [Kind::Pve(proportional), Kind::Pve(on_off)]
}

#[test]
fn a_valve_on_canopen_shows_the_table_and_nothing_else() {
    for kind in valves(pve::Kind::PveaCanopen, pve::Kind::PveoCanopen) {
        let mut blank = Rig::new(Setup { node_id: None, ..Setup::<Kind>::new(kind) });
        blank.send("7E5: 04 01 00 00 00 00 00 00");
        let mut rig = Rig::new(Setup::<Kind>::new(kind));
        rig.send("000: 01 20");
        for word in ["01", "03", "0F"] {
            rig.send(&format!("220: {word} 00 00 00"));
        }
        rig.drive("220: 0F 00 00 40", 500);
        rig.drive("220: 0F 00 00 C0", 800);
        rig.drive("220: 0F 00 FF 7F", 800);
        let [neutral, full, float] = ["00 00", "00 40", "FF 7F"].map(|point| format!("220: 0F 00 {point}"));
        rig.break_valve(&neutral, &full, &float, &["220: 03 00 00 00", "220: 0B 00 00 00"]);
        for command in ["000: 02 20", "000: 80 20"] {
            rig.send(command);
        }
        rig.power(Power::Off);
        rig.pass(5);
        Rig::assert_all_seen(&[rig, blank]);
    }
}

#[test]
fn a_valve_on_isobus_shows_the_table_and_nothing_else() {
    for kind in valves(pve::Kind::PveaIsobus, pve::Kind::PveoIsobus) {
        let mut rig = Rig::new(Setup::<Kind>::new(kind));
        let avc = |flow: &str, state: &str| format!("0CFE3027: {flow} FF F{state} FF FF FF FF FF");
        for (flow, state) in [("FA", "1"), ("FA", "2"), ("00", "3"), ("00", "A"), ("00", "E"), ("00", "0")] {
            rig.drive(&avc(flow, state), 800);
        }
        rig.break_valve(&avc("00", "0"), &avc("FA", "1"), &avc("00", "3"), &[]);
        rig.send("18EEFF80: 00 00 20 07 08 FF 02 20");
        rig.pass(200);
        rig.power(Power::Off);
        rig.pass(5);
        Rig::assert_all_seen(&[rig]);
    }
}

#[test]
fn an_angle_sensor_shows_the_table_and_nothing_else() {
    for kind in [hat::Kind::Hat1000, hat::Kind::Hat3000].map(Kind::Hat) {
        let blank = Rig::new(Setup { node_id: None, ..Setup::<Kind>::new(kind) });
        let mut rig = Rig::new(Setup::<Kind>::new(kind));
        for command in ["000: 01 01", "000: 02 01", "000: 80 01"] {
            rig.send(command);
        }
        for angle_cdeg in [0, 35_999] {
            rig.plant(json!({"angle_cdeg": angle_cdeg}));
        }
        rig.plant(json!({"internal_fault": true}));
        rig.pass(20);
        rig.plant(json!({"internal_fault": false, "bus_off": true}));
        rig.pass(20);
        rig.plant(json!({"bus_off": false}));
        rig.pass(50);
        rig.world.disturb(Disturbance { frames: 20, id: Some(standard(0x581).into()) });
        rig.send("601: 40 00 10 00 00 00 00 00");
        rig.pass(50);
        rig.plant(json!({"memory": "damaged"}));
        for power in [Power::Off, Power::On] {
            rig.pass(5);
            rig.power(power);
        }
        rig.pass(50);
        Rig::assert_all_seen(&[rig, blank]);
    }
}

/// Null is written with the caller's word.
#[test]
fn what_a_key_can_be_is_told_in_order() {
    let told = |key, none| accepted(key, Kind::Pve(pve::Kind::PveaCanopen), NAME, none);
    assert_eq!(told("node_id", "null"), "1 to 127, null");
    assert_eq!(told("position", "null"), "-16384 to 16384");
    assert_eq!(told("set_point", "\"none\""), "-16384 to 16384, \"float\", \"none\"");
    assert_eq!(told("powered", "null"), "true, false");
    assert_eq!(told("command", "\"none\""), "\"none\"");
}
