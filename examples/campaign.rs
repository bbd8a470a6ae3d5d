//! A controller in Rust against the faults of its valve: `cargo test --package hal-sim --features campaign --test
//! campaign`. The two masters are those of scenarios/campaigns: a careful one, and one with two mistakes.
use std::fs;

use embedded_can::{Frame as _, Id, StandardId, nb::Can};
use hal_sim::campaign::{Campaign, CellResult, Controller, Plan, Verdict};
use hal_sim::{Client, Duration, Frame, Instant};

/// A master: configures the heartbeat of its valve, holds the spool, then moves it to and fro.
#[derive(Clone, Default)]
struct Master {
    is_careful: bool,
    is_stopped: bool,
    /// The next set-point.
    set_point: Option<Instant>,
    /// The latest heartbeat, and the latest answer to a set-point.
    heard: [Option<Instant>; 2],
}

const HOLD: [u8; 4] = [0x0B, 0x00, 0x00, 0x00];
/// Control word "active", with a set-point of 50 % to each side.
const SIDES: [[u8; 4]; 2] = [[0x0F, 0x00, 0x00, 0x20], [0x0F, 0x00, 0x00, 0xE0]];
const CYCLE: Duration = Duration::from_millis(50);
const ACTIVE: Instant = Instant::from_millis(1500);
/// The longest silence of heartbeats and answers.
const SILENCE: [Duration; 2] = [Duration::from_millis(250), Duration::from_millis(120)];

impl Master {
    fn hear(&mut self, frame: &Frame, can: &mut Client, now: Instant) {
        let Id::Standard(id) = frame.id() else { return };
        match (id.as_raw(), frame.data()) {
            // The EMCY "no error" after boot-up: configure the heartbeat, 100 ms.
            (0x0A0, _) if now < Instant::from_millis(100) => send(can, 0x620, &[0x2B, 0x17, 0x10, 0, 100, 0, 0, 0]),
            // The first mistake: an EMCY in HOLD is ignored.
            (0x0A0, _) if self.is_careful || now >= ACTIVE => self.stop(can),
            (0x5A0, [0x60, ..]) => {
                send(can, 0x000, &[0x01, 0x20]); // NMT start
                self.set_point = Some(now);
            }
            (0x720, _) => self.heard[0] = Some(now),
            (0x1A0, _) => self.heard[1] = Some(now),
            _ => {}
        }
    }

    /// Stops the valve by NMT, and sends no more set-points.
    fn stop(&mut self, can: &mut Client) {
        if !std::mem::replace(&mut self.is_stopped, true) {
            send(can, 0x000, &[0x02, 0x20]);
            self.set_point = None;
        }
    }
}

impl Controller for Master {
    fn poll(&mut self, can: &mut Client, now: Instant) -> Instant {
        while let Ok(frame) = can.receive() {
            self.hear(&frame, can, now);
        }
        // The second mistake: the careless master does not monitor the valve.
        let ends = self.heard.iter().zip(SILENCE).filter_map(|(heard, silence)| heard.map(|heard| heard + silence));
        let end = ends.min().filter(|_| self.is_careful && !self.is_stopped).unwrap_or(Instant::MAX);
        if now >= end {
            self.stop(can);
        }
        if let Some(due) = self.set_point.filter(|due| *due <= now) {
            let sides = now.as_millis().checked_sub(ACTIVE.as_millis()).map(|time| time / 500 % 2);
            send(can, 0x220, &sides.map_or(HOLD, |side| SIDES[side as usize]));
            // Each movement begins a new cycle.
            let movement = ACTIVE.max(Instant::from_millis(now.as_millis() / 500 * 500 + 500));
            self.set_point = Some((due + CYCLE).min(movement));
        }
        self.set_point.unwrap_or(Instant::MAX).min(end)
    }
}

fn send(can: &mut Client, id: u16, data: &[u8]) {
    let frame = StandardId::new(id).and_then(|id| Frame::new(id, data)).expect("a frame");
    can.transmit(&frame).expect("the world is there");
}

/// Returns a plan of scenarios/campaigns, with three faults instead of its own, at every second instant.
fn plan(name: &str, scenario: &str) -> Plan {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/campaigns/");
    let text = fs::read_to_string(format!("{folder}{name}.toml")).expect("a plan");
    let faults = r#"faults = [{ plant = { internal_fault = true } }, { power = { on = false } }, { plant = { temperature_c = 130 } }]"#;
    let text = text.replace("faults = [\"all-of-pve\"]", faults).replace("step_ms = 50", "step_ms = 100");
    let read = |path: &str| match scenario {
        "" => fs::read_to_string(format!("{folder}{path}")).map_err(|error| error.to_string()),
        scenario => Ok(scenario.to_owned()),
    };
    Plan::parse(&text, read).expect("a plan")
}

/// The devices without a master: the controller is in Rust.
const DEVICES: &str = r#"
devices = ["pvea-canopen@0x20,name=valve,brown-out-mv=7000"]
steps = [{ at_ms = 6000 }]
"#;

/// Runs every fourth cell with the scripted master and with the master in Rust; compares the results.
fn run(name: &str, is_careful: bool) -> Vec<CellResult> {
    let (scripted, devices) = (plan(name, ""), plan(name, DEVICES));
    let scripted = Campaign::new(&scripted).expect("it passes without a fault");
    let make = || Master { is_careful, ..Master::default() };
    let forked = Campaign::with_controller(&devices, make).expect("it passes without a fault");
    let mut results = Vec::new();
    for number in (0..scripted.cells()).step_by(4) {
        let cell = scripted.numbered(number).expect("a cell");
        let [script, rust] = [scripted.cell(cell), forked.cell(cell)].map(|result| result.expect("a result"));
        assert_eq!((script.verdict, &script.fault), (rust.verdict, &rust.fault), "{script:?} {rust:?}");
        for (script, rust) in [(script.detected_us, rust.detected_us), (script.safe_us, rust.safe_us)] {
            let difference = script.unwrap_or(0).abs_diff(rust.unwrap_or(0));
            assert!(script.is_some() == rust.is_some() && difference <= 1000, "{script:?} {rust:?}");
        }
        results.push(rust);
    }
    results
}

#[test]
fn the_careful_master_passes() {
    assert!(run("valve-careful", true).iter().all(|cell| cell.verdict == Verdict::Safe));
}

#[test]
fn both_mistakes_of_the_careless_master_are_found() {
    let results = run("valve-careless", false);
    let undetected = |fault: &str, at: &dyn Fn(u64) -> bool| {
        let cells: Vec<&CellResult> =
            results.iter().filter(|cell| cell.fault.contains(fault) && at(cell.at_us)).collect();
        !cells.is_empty() && cells.iter().all(|cell| cell.verdict == Verdict::SafeUndetected)
    };
    assert!(undetected("internal_fault", &|at| at < 1_490_000), "an EMCY in HOLD is ignored: {results:?}");
    assert!(!undetected("internal_fault", &|at| at > 1_500_000), "an EMCY in ACTIVE is not: {results:?}");
    assert!(undetected("power off", &|_| true), "a heartbeat that ends is not noticed: {results:?}");
}
