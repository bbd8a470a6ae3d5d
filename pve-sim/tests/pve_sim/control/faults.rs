//! Every fault of SPEC 2, on both protocols, injected and awaited.

use serde_json::{Value, json};

use super::{Rig, micros};

/// A master on the bus, with the name of the device.
struct Valve {
    rig: Rig,
    name: &'static str,
    canopen: bool,
}

const CYCLE: u32 = 100;

impl Valve {
    /// Returns a valve that has reached a set-point of half its stroke.
    fn at_work(kind: &'static str) -> Self {
        let rig = Rig::stepped(&["--device", &format!("{kind},name=valve")]);
        let valve = Self { rig, name: "valve", canopen: kind.contains("canopen") };
        if valve.canopen {
            valve.rig.send("000: 01 20");
            valve.rig.send_every(CYCLE, "220: 0F 00 00 20");
        } else {
            valve.rig.send_every(CYCLE, "0CFE3027: 7D FF 31 FF FF FF FF FF");
        }
        let position = if kind.starts_with("pvea") { 8192 } else { 16384 };
        valve.wait(json!({"position": position, "faults": [], "solenoids": true}), 1000);
        valve
    }

    fn plant(&self, change: Value) -> u64 {
        micros(&self.rig.plant(self.name, change)["t_us"])
    }

    #[track_caller]
    fn wait(&self, state: Value, millis: u32) -> Value {
        self.rig.wait(self.name, state, millis)
    }

    /// Waits until a fault is the only active one, with its LED and solenoids.
    #[track_caller]
    fn shut_down(&self, fault: &str, within: u32) -> Value {
        let flashing = !matches!(fault, "internal" | "can-bus");
        let led = json!({"color": "red", "flashing": flashing});
        let mut state = json!({"faults": [fault], "led": led, "solenoids": false});
        if self.canopen {
            state["dsm"] = "fault-hold".into();
        } else {
            state["command"] = "blocked".into();
        }
        let state = self.wait(state, within);
        let names = state["faults"].as_array().expect("a list").iter();
        let counts: Vec<(&Value, &Value)> =
            names.map(|fault| (&fault["fault"], &fault["count"])).filter(|(_, count)| **count != 0).collect();
        // On CANopen both spool faults share a counter.
        let shared = self.canopen && fault.contains("-not-");
        assert_eq!(counts.len(), if shared { 2 } else { 1 }, "{counts:?}");
        assert!(counts.iter().all(|(_, count)| **count == 1), "{counts:?}");
        state
    }
}

fn both(test: impl Fn(Valve)) {
    for kind in ["pvea-canopen@0x20", "pvea-isobus@0x80"] {
        test(Valve::at_work(kind));
    }
}

#[test]
fn supply_and_temperature() {
    both(|valve| {
        for (sick, well, fault, delay_ms) in [
            (json!({"supply_mv": 8999}), json!({"supply_mv": 24000}), "supply-low", 2000),
            (json!({"supply_mv": 36001}), json!({"supply_mv": 24000}), "supply-high", 2000),
            (json!({"temperature_c": 121}), json!({"temperature_c": 25}), "temperature", 250),
        ] {
            valve.rig.power(valve.name, json!({"on": false}));
            let valve = Valve::at_work(if valve.canopen { "pvea-canopen@0x20" } else { "pvea-isobus@0x80" });
            let since = valve.plant(sick);
            let state = valve.shut_down(fault, 3000);
            assert_eq!(micros(&state["t_us"]), since + delay_ms * 1000, "{fault}");
            valve.plant(well);
            valve.wait(json!({"faults": []}), 0);
        }
    });
}

#[test]
fn a_stuck_spool() {
    both(|valve| {
        valve.plant(json!({"spool": {"fault": "stuck"}}));
        valve.rig.done("DELETE", "/bus/frames", None);
        let other = if valve.canopen { "220: 0F 00 00 C0" } else { "0CFE3027: FA FF 32 FF FF FF FF FF" };
        let since = valve.rig.send_every(CYCLE, other);
        let state = valve.shut_down("spool-not-at-set-point", 2000);
        assert_eq!(micros(&state["t_us"]), since + 500_000);
        assert_eq!(state["position"], 8192, "it is where it was");
        valve.plant(json!({"spool": {"fault": null}}));
        valve.wait(json!({"position": {"min": -100, "max": 100}}), 200);
    });
}

#[test]
fn a_spool_that_does_not_reach_float() {
    both(|valve| {
        valve.plant(json!({"spool": {"fault": "no-float"}}));
        valve.rig.done("DELETE", "/bus/frames", None);
        let float = if valve.canopen { "220: 0F 00 FF 7F" } else { "0CFE3027: 00 FF 33 FF FF FF FF FF" };
        valve.rig.send_every(CYCLE, float);
        valve.wait(json!({"set_point": "float"}), 10);
        valve.shut_down("float-not-reached", 3000);
    });
}

#[test]
fn set_points_that_do_not_come() {
    both(|valve| {
        let last = valve.rig.trace().into_iter().rfind(|(_, _, from)| from == "http").expect("a set-point").0;
        valve.rig.done("DELETE", "/bus/frames", None);
        let state = valve.shut_down("time-guarding", 1000);
        assert_eq!(micros(&state["t_us"]), last + 250_000);
    });
}

#[test]
fn an_internal_fault_and_a_watchdog_reset() {
    both(|valve| {
        let since = valve.plant(json!({"internal_fault": true}));
        assert_eq!(micros(&valve.shut_down("internal", 0)["t_us"]), since, "at once");
        valve.plant(json!({"internal_fault": false}));
        valve.wait(json!({"faults": []}), 0);
        valve.rig.power(valve.name, json!({"reset": "watchdog"}));
        let told = if valve.canopen {
            json!({"id": 0xA0, "data": "0010 .."})
        } else {
            json!({"id": 0x18FE_CA80, "extended": true})
        };
        let told = valve.rig.post("/wait", json!({"frame": told, "within_ms": 2000}));
        assert_eq!(told["from"], "valve", "{told}");
    });
}

#[test]
fn bus_off() {
    both(|valve| {
        valve.plant(json!({"bus_off": true}));
        valve.shut_down("can-bus", 0);
        valve.plant(json!({"bus_off": false}));
        // 128 sequences of 11 recessive bits
        valve.wait(json!({"faults": []}), 1000);
    });
}

/// 32 destroyed frames in a row take a sender off the bus; it recovers by itself.
#[test]
fn a_disturbed_sender_goes_bus_off() {
    both(|valve| {
        let (id, extended) = if valve.canopen { (0x1A0, false) } else { (0x0CFE_1080, true) };
        valve.rig.post("/bus/disturb", json!({"frames": 32, "id": id, "extended": extended}));
        valve.wait(json!({"faults": ["can-bus"], "led": {"color": "red", "flashing": false}}), 1000);
        let left = valve.rig.get("/bus")["disturb"].clone();
        assert_eq!(left, json!({"frames": 0, "id": null, "extended": false}));
        valve.wait(json!({"faults": []}), 1000);
    });
}

#[test]
fn a_memory_that_cannot_be_read_or_written() {
    both(|valve| {
        valve.plant(json!({"memory": "damaged"}));
        valve.rig.advance(1000);
        let state = valve.rig.device(valve.name);
        assert_eq!((&state["faults"][2]["active"], &state["plant"]["memory"]), (&json!(false), &json!("damaged")));
        valve.rig.power(valve.name, json!({"on": false}));
        valve.rig.power(valve.name, json!({"on": true}));
        let state = valve.wait(json!({"faults": ["internal"]}), 10);
        assert_eq!(state["plant"]["memory"], "ok", "the start has put it aside");
        valve.rig.power(valve.name, json!({"on": false}));
        valve.rig.power(valve.name, json!({"on": true}));
        valve.wait(json!({"faults": []}), 0);
        valve.rig.advance(100);

        // The fault log can no longer be stored.
        valve.plant(json!({"memory": "write-fails"}));
        valve.plant(json!({"temperature_c": 130}));
        valve.wait(json!({"faults": ["internal", "temperature"]}), 60_000);
        valve.plant(json!({"memory": "ok", "temperature_c": 25}));
        valve.wait(json!({"faults": []}), 60_000);
    });
}

#[test]
fn an_angle_sensor() {
    let rig = Rig::stepped(&["--device", "hat3000@5"]);
    rig.plant("hat3000", json!({"internal_fault": true}));
    rig.wait("hat3000", json!({"faults": ["controller"]}), 0);
    let told = rig.post("/wait", json!({"frame": {"id": 0x85, "data": "00FF8102 .."}, "within_ms": 10}));
    assert_eq!(told["from"], "hat3000");
    let counts =
        |state: &Value| state["faults"].as_array().map(|faults| faults.iter().map(|f| f["count"].as_u64()).collect());
    assert_eq!(counts(&rig.device("hat3000")), Some(vec![Some(0), Some(1), Some(0), Some(0)]));
    rig.plant("hat3000", json!({"internal_fault": false, "bus_off": true}));
    rig.wait("hat3000", json!({"faults": ["can-bus"]}), 0);
    rig.plant("hat3000", json!({"bus_off": false}));
    rig.wait("hat3000", json!({"faults": []}), 100);
    assert_eq!(counts(&rig.device("hat3000")), Some(vec![Some(0), Some(1), Some(0), Some(1)]));
    rig.plant("hat3000", json!({"memory": "damaged"}));
    rig.power("hat3000", json!({"reset": "watchdog"}));
    rig.wait("hat3000", json!({"faults": ["set-up"]}), 10);
    // A preset of 1/4 turn, and the shaft turns on from there.
    rig.plant("hat3000", json!({"angle_cdeg": 9000, "speed_rpm": 60}));
    let since = micros(&rig.device("hat3000")["t_us"]);
    let state = rig.wait("hat3000", json!({"position": 8192}), 1000);
    assert_eq!(micros(&state["t_us"]), since + 250_000, "half a turn: 16384 steps a second");
}
