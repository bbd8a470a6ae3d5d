use protocol_core::controller::BitRate;
use protocol_core::device::Kind;
use serde_json::{Value, json};

use super::super::{Command, Refusal, Reply, Simulation};
use super::*;
use crate::devices::NamedDevice;
use crate::memory::Memory;
use crate::state::Power;

/// Creates a simulation with a valve and an angle sensor, powered for 100 ms.
fn simulation() -> Simulation {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    for (name, kind) in [("boom", "pvea-canopen"), ("angle", "hat1000")] {
        let device = NamedDevice::new(name, Kind::from_name(kind).expect("a kind"));
        simulation.add(&device, Memory::in_ram());
    }
    simulation.power_up(Duration::from_ticks(0));
    simulation.run_until(Instant::from_micros(100_000));
    simulation
}

fn change(simulation: &mut Simulation, device: &str, change: Value) -> Result<Reply, Refusal> {
    let change = serde_json::from_value(change).expect("a change");
    simulation.run(Command::Plant(device.to_owned(), change))
}

/// Returns a plant word of a device after `ms` milliseconds.
fn after_ms(simulation: &mut Simulation, ms: u64, device: &str, word: &str) -> Value {
    simulation.run_until(after(simulation.now(), Duration::from_millis(ms)));
    json!(simulation.state(device).expect("a device"))["plant"][word].clone()
}

#[test]
fn a_change_ends_and_the_earlier_values_are_back() {
    let mut simulation = simulation();
    for (device, limited, word, given, earlier) in [
        ("boom", json!({"supply_mv": 6000, "for_ms": 100}), "supply_mv", json!(6000), json!(24_000)),
        ("boom", json!({"spool": "stuck", "for_ms": 100}), "spool", json!({"fault": "stuck"}), json!({"fault": null})),
        ("boom", json!({"lever": 4000, "for_ms": 100}), "lever", json!(4000), json!(null)),
        ("boom", json!({"memory": "write-fails", "for_ms": 100}), "memory", json!("write-fails"), json!("ok")),
        ("boom", json!({"internal_fault": true, "for_ms": 100}), "internal_fault", json!(true), json!(false)),
        ("boom", json!({"bus_off": true, "for_ms": 100}), "bus_off", json!(true), json!(false)),
        ("boom", json!({"oil": true, "for_ms": 100}), "oil", json!(true), json!(false)),
        ("boom", json!({"brown_out_mv": 7000, "for_ms": 100}), "brown_out_mv", json!(7000), json!(null)),
        ("boom", json!({"answer_ms": [5, 20], "for_ms": 100}), "answer_ms", json!([5, 20]), json!(0)),
        ("angle", json!({"boot_ms": 300, "for_ms": 100}), "boot_ms", json!(300), json!(0)),
        ("angle", json!({"cycle_ms": 10, "for_ms": 100}), "cycle_ms", json!(10), json!(0)),
        ("angle", json!({"angle_cdeg": 9000, "for_ms": 100}), "angle_cdeg", json!(9000), json!(0)),
        ("angle", json!({"measuring_error": true, "for_ms": 100}), "measuring_error", json!(true), json!(false)),
    ] {
        change(&mut simulation, device, limited.clone()).unwrap_or_else(|refusal| panic!("{limited}: {refusal}"));
        assert_eq!(after_ms(&mut simulation, 99, device, word), given, "{limited}");
        assert_eq!(after_ms(&mut simulation, 1, device, word), earlier, "{limited}");
    }
}

#[test]
fn a_profile_is_interpolated_every_millisecond_or_has_steps() {
    let mut simulation = simulation();
    let points = json!([[10, 20_000], [20, 10_000], [21, 30_000]]);
    change(&mut simulation, "boom", json!({"profile": {"word": "supply_mv", "points": points}})).expect("a profile");
    let mut values =
        |spans: &[u64]| spans.iter().map(|ms| after_ms(&mut simulation, *ms, "boom", "supply_mv")).collect::<Vec<_>>();
    assert_eq!(
        values(&[0, 9, 1, 1, 4, 4, 1, 1, 500]),
        [24_000, 24_000, 20_000, 19_000, 15_000, 11_000, 10_000, 30_000, 30_000]
    );
    let steps = json!({"word": "supply_mv", "points": points, "steps": true});
    change(&mut simulation, "boom", json!({"profile": steps})).expect("a profile");
    let mut values =
        |spans: &[u64]| spans.iter().map(|ms| after_ms(&mut simulation, *ms, "boom", "supply_mv")).collect::<Vec<_>>();
    assert_eq!(values(&[9, 1, 9, 1, 1]), [30_000, 20_000, 20_000, 10_000, 30_000]);
}

#[test]
fn cranking() {
    let mut simulation = simulation();
    let cranking = json!({"profile": {"word": "supply_mv", "points": "cranking"}});
    change(&mut simulation, "boom", cranking).expect("a profile");
    let values = [25, 25, 70, 780].map(|ms| after_ms(&mut simulation, ms, "boom", "supply_mv"));
    assert_eq!(values, [15_000, 6_000, 9_000, 24_000]);
}

/// Changes of other words, and of the same word of another device, are accepted.
#[test]
fn two_changes_of_one_word_do_not_overlap() {
    let mut simulation = simulation();
    change(&mut simulation, "boom", json!({"supply_mv": 6000, "for_ms": 100})).expect("a change");
    let busy = "supply_mv of boom is already changing until 200 ms";
    for other in [
        json!({"supply_mv": 7000}),
        json!({"supply_mv": 7000, "for_ms": 5}),
        json!({"temperature_c": 90, "profile": {"word": "supply_mv", "points": [[0, 7000]]}}),
    ] {
        assert_eq!(change(&mut simulation, "boom", other), Err(Refusal::Conflict(busy.to_owned())));
    }
    assert_eq!(after_ms(&mut simulation, 0, "boom", "temperature_c"), json!(25), "nothing has changed");
    change(&mut simulation, "boom", json!({"temperature_c": 90})).expect("another word");
    assert_eq!(after_ms(&mut simulation, 100, "boom", "supply_mv"), json!(24_000));
    change(&mut simulation, "boom", json!({"supply_mv": 7000})).expect("it is over");
}

#[test]
fn what_is_no_profile_is_refused_and_changes_nothing() {
    let mut simulation = simulation();
    let profile =
        |word: &str, points: Value| json!({"profile": {"word": word, "points": points}, "internal_fault": true});
    for (request, reason) in [
        (
            profile("supply_mv", json!([[50, 1], [50, 2]])),
            "profile of supply_mv: 50 ms after 50 ms; times must increase",
        ),
        (
            profile("supply_mv", json!([[50, 1], [20, 2]])),
            "profile of supply_mv: 20 ms after 50 ms; times must increase",
        ),
        (profile("supply_mv", json!([[-1, 1]])), "profile of supply_mv: -1 ms must be from 0 to 86400000"),
        (
            profile("supply_mv", json!([[0, 100_001]])),
            "profile of supply_mv: 100001 is out of range; accepted: 0 to 100000 mV",
        ),
        (profile("supply_mv", json!([])), "profile of supply_mv has no points; accepted: at least one"),
        (profile("spool", json!([[0, 1]])), "'spool' cannot have a profile; accepted: supply_mv, "),
        (
            profile("angle_cdeg", json!([[0, 1]])),
            "angle_cdeg 1: not a plant word of this kind of device; accepted: supply_mv, temperature_c, spool, lever, internal_fault, ",
        ),
        (json!({"boot_ms": 60_001}), "boot_ms 60001: out of range; accepted: 0 to 60000 ms"),
        (
            json!({"answer_ms": [20, 5]}),
            "answer_ms 20..5: out of range; accepted: 0 to 60000 ms, or a range as in 5..20",
        ),
        (json!({"brown_out_mv": 0}), "brown_out_mv 0: out of range; accepted: 1 to 100000, or off"),
        (json!({"for_ms": 5}), "for_ms is only valid together with a change"),
        (
            json!({"supply_mv": 5, "profile": {"word": "supply_mv", "points": "cranking"}}),
            "profile of supply_mv: not valid together with for_ms or a value of supply_mv",
        ),
    ] {
        let refusal = change(&mut simulation, "boom", request.clone()).expect_err("it is refused").to_string();
        assert!(refusal.starts_with(reason) && !refusal.contains('\n'), "{request}: {refusal}");
        assert_eq!(after_ms(&mut simulation, 1, "boom", "internal_fault"), json!(false), "{request}");
    }
    assert_eq!(after_ms(&mut simulation, 1, "boom", "supply_mv"), json!(24_000));
}

/// A reset restarts the start delay; a device without power stays off.
#[test]
fn a_reset_during_the_start_delay() {
    let mut simulation = simulation();
    let power =
        |simulation: &mut Simulation, change| simulation.run(Command::Power("boom".to_owned(), change)).map(drop);
    change(&mut simulation, "boom", json!({"boot_ms": 100})).expect("a delay");
    assert_eq!(power(&mut simulation, Power::Watchdog), Ok(()));
    assert_eq!(after_ms(&mut simulation, 60, "boom", "boot_ms"), json!(100));
    assert_eq!(power(&mut simulation, Power::Watchdog), Ok(()), "the device has power");
    let mut is_powered = |ms| {
        simulation.run_until(after(simulation.now(), Duration::from_millis(ms)));
        simulation.state("boom").expect("a device").powered
    };
    assert_eq!([is_powered(99), is_powered(1)], [false, true]);
    assert_eq!(power(&mut simulation, Power::Off), Ok(()));
    assert!(power(&mut simulation, Power::Watchdog).is_err());
}

/// A clone continues as the original does.
#[test]
fn a_clone_has_the_changes_in_progress() {
    let mut original = simulation();
    change(&mut original, "boom", json!({"profile": {"word": "supply_mv", "points": "cranking"}})).expect("a profile");
    change(&mut original, "boom", json!({"temperature_c": 90, "for_ms": 77})).expect("a change");
    original.run_until(after(original.now(), Duration::from_millis(33)));
    let mut clone = original.clone();
    for _ in 0..100 {
        let states = [&mut original, &mut clone].map(|simulation| {
            simulation.run_until(after(simulation.now(), Duration::from_millis(10)));
            simulation.states()
        });
        assert_eq!(states[0], states[1]);
    }
}
