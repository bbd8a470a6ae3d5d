//! A controller in Rust against the faults of its valve: `cargo test --package hal-sim --features campaign --test
//! campaign`. The two masters are those of scenarios/campaigns: a careful one, and one with two mistakes.
use std::fs;

use embedded_can::{Frame as _, Id, StandardId, nb::Can};
use hal_sim::campaign::{self, Campaign, CellResult, Controller, Plan, Verdict};
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

/// Returns a plan of scenarios/campaigns, at more instants. `scenario` replaces the text of its scenario.
fn plan(name: &str, scenario: Option<&str>) -> Plan {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/campaigns/");
    let file = |name: &str| fs::read_to_string(format!("{folder}{name}")).expect("a file");
    let text = file(&format!("program-{name}.toml")).replace("step_ms = 400", "step_ms = 100");
    Plan::parse(&text, |path| Ok(scenario.map_or_else(|| file(path), str::to_owned))).expect("a plan")
}

/// The devices without a master: the controller is in Rust.
const DEVICES: &str = r#"
devices = ["pvea-canopen@0x20,name=valve,brown-out-mv=7000"]
steps = [{ at_ms = 6000 }]
"#;

/// Returns the cells of a row, in the order of their instants.
fn cells<M: campaign::Master>(campaign: &Campaign<'_, M>, row: usize) -> Vec<CellResult> {
    let mut cells = Vec::new();
    campaign.row(row, &mut |cell| cells.push(cell));
    cells.sort_by_key(|cell| cell.at_us);
    cells
}

/// Returns the worst cell; of equally bad cells, the first.
fn worst(cells: &[CellResult]) -> &CellResult {
    cells.iter().max_by_key(|cell| (cell.severity(), std::cmp::Reverse(cell.at_us))).expect("a cell")
}

/// Returns the instants from which the verdict is another one, with this verdict.
fn changes(cells: &[CellResult]) -> Vec<(u64, Verdict)> {
    let pairs = cells.windows(2).filter(|pair| pair[0].verdict != pair[1].verdict);
    pairs.map(|pair| (pair[1].at_us, pair[1].verdict)).collect()
}

/// Runs the plan with the master in Rust, and with the same master as scenario. Checks that both agree to 1 ms, and
/// returns the cells of each row.
fn run(name: &str, is_careful: bool) -> Vec<Vec<CellResult>> {
    let (scripted, devices) = (plan(name, None), plan(name, Some(DEVICES)));
    let scripted = Campaign::new(&scripted).expect("it passes without a fault");
    let make = || Master { is_careful, ..Master::default() };
    let forked = Campaign::with_controller(&devices, make).expect("it passes without a fault");
    let near = |one: Option<u64>, other: Option<u64>| match (one, other) {
        (Some(one), Some(other)) => one.abs_diff(other) <= 1000,
        (one, other) => one == other,
    };
    let rows = 0..scripted.rows().len();
    let compared = rows.map(|row| {
        let (script, rust) = (cells(&scripted, row), cells(&forked, row));
        for one in &script {
            let Some(other) = rust.iter().find(|cell| cell.at_us == one.at_us) else { continue };
            assert_eq!((one.verdict, &one.fault), (other.verdict, &other.fault), "{one:?} {other:?}");
            assert!(near(one.detected_us, other.detected_us) && near(one.safe_us, other.safe_us), "{one:?} {other:?}");
        }
        let (one, other) = (worst(&script), worst(&rust));
        assert!(one.verdict == other.verdict && near(one.reaction_us(), other.reaction_us()), "{one:?} {other:?}");
        let (script, changed) = (changes(&script), changes(&rust));
        let are_near =
            |(one, other): (&(u64, Verdict), &(u64, Verdict))| one.1 == other.1 && one.0.abs_diff(other.0) <= 1000;
        assert!(script.len() == changed.len() && script.iter().zip(&changed).all(are_near), "{script:?} {changed:?}");
        rust
    });
    compared.collect()
}

#[test]
fn the_careful_master_passes() {
    assert!(run("careful", true).iter().flatten().all(|cell| cell.verdict == Verdict::Safe));
}

#[test]
fn both_mistakes_of_the_careless_master_are_found() {
    let rows = run("careless", false);
    let of = |fault: &str| rows.iter().find(|cells| cells[0].fault.contains(fault)).expect("a row");
    let worst_of = |fault: &str| (worst(of(fault)).at_us, worst(of(fault)).verdict);
    // An EMCY in HOLD is ignored, until the master activates the valve at 1.5 s.
    assert_eq!(worst_of("internal_fault"), (500_000, Verdict::SafeUndetected));
    let [(end, Verdict::Safe)] = changes(of("internal_fault"))[..] else { panic!("{:?}", of("internal_fault")) };
    assert!((1_498_000..=1_500_000).contains(&end), "{end}");
    // A heartbeat that ends is never noticed.
    for fault in ["power off", "bus_off"] {
        assert_eq!((worst_of(fault), changes(of(fault))), ((500_000, Verdict::SafeUndetected), Vec::new()));
    }
}
