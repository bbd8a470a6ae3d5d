//! Campaigns: verdicts, forks, injections, golden runs, refinement.

use super::*;

/// A valve that is in ACTIVE after some 170 ms, and a master that stops the valve at an EMCY.
const CAREFUL: &str = r#"
devices = ["pvea-canopen@0x20,name=valve"]
reactions = [{ on = "0A0", from_ms = 50, send = "000#0220" }]
steps = [
  { expect = ["720#00", "0A0"] },
  { send = "000#0120" },
  { send = "220#0F00 0010", every_ms = 50, expect = { dsm = "active", position = 4096 } },
  { at_ms = 500 },
]
"#;

const ORACLES: &str = r#"
detected = { expect = "000#02..", within_ms = 50 }
safe = { expect = { solenoids = false }, within_ms = 60 }
observe_ms = 400
"#;

const GRID: &str = "instants = { from_ms = 300, to_ms = 400, step_ms = 20 }";

fn plan(faults: &str, instants: &str, scenario: &str) -> Plan {
    let text = format!("scenario = \"drive.toml\"\nfaults = [{faults}]\n{instants}\n{ORACLES}");
    Plan::parse(&text, |_| Ok(scenario.to_owned())).unwrap_or_else(|error| panic!("{text}: {error:?}"))
}

fn campaign(plan: &Plan) -> Campaign<'_> {
    Campaign::new(plan).unwrap_or_else(|error| panic!("{error}"))
}

fn row<M: Master>(campaign: &Campaign<'_, M>, row: usize) -> Vec<CellResult> {
    let mut results = Vec::new();
    campaign.row(row, &mut |result| results.push(result));
    results
}

/// The verdicts on the cells of the first row.
fn verdicts(faults: &str, scenario: &str) -> Vec<Verdict> {
    let plan = plan(faults, GRID, scenario);
    row(&campaign(&plan), 0).iter().filter(|cell| !cell.refined).map(|cell| cell.verdict).collect()
}

const INTERNAL: &str = "{ plant = { internal_fault = true } }";

#[test]
fn what_the_master_notices_is_safe_in_time() {
    let plan = plan(INTERNAL, GRID, CAREFUL);
    for cell in row(&campaign(&plan), 0) {
        assert_eq!((cell.verdict, cell.struck), (Verdict::Safe, 1), "{cell:?}");
        let detected = cell.detected_us.expect("detected");
        // An EMCY and an NMT command: two frames, possibly behind others. The solenoids are off before.
        assert!((700..2000).contains(&detected) && cell.safe_us < Some(detected), "{cell:?}");
    }
    let careless = CAREFUL.replace("from_ms = 50", "from_ms = 60000");
    assert_eq!(verdicts(INTERNAL, &careless), [Verdict::SafeUndetected; 6]);
    // The reaction takes 60 ms: a limit of 50 ms is broken.
    let slow = CAREFUL.replace("{ on = \"0A0\", from_ms = 50,", "{ missing = \"1A0#0F..\", for_ms = 110,");
    assert!(verdicts(INTERNAL, &slow).iter().all(|verdict| matches!(verdict, Verdict::Late | Verdict::Safe)));
    assert!(verdicts(INTERNAL, &slow).contains(&Verdict::Late));
    // Corrupted set-points are not detected, and the valve follows them.
    assert_eq!(verdicts("{ corrupt = \"220\", data = { toggle = \"000000 10\" } }", CAREFUL), [Verdict::Undetected; 6]);
    // One lost set-point has no effect on the spool.
    assert_eq!(verdicts("{ lose = \"220\", count = 1 }", CAREFUL), [Verdict::NoEffect; 6]);
}

#[test]
fn a_fault_that_does_not_act_is_no_success() {
    for fault in [
        "{ lose = \"7FF\" }",
        "{ plant = { supply_mv = 24000 } }",
        "{ power = { on = true } }",
        "{ lose = \"720\", from_ms = 399 }",
        "{ plant = { profile = { word = \"supply_mv\", points = [[0, 24000], [300, 24000]] } } }",
    ] {
        assert_eq!(verdicts(fault, CAREFUL), [Verdict::NotInjected; 6], "{fault}");
    }
    let profile = "{ plant = { profile = { word = \"supply_mv\", points = [[0, 24000], [300, 25000]] } } }";
    assert_eq!(verdicts(profile, CAREFUL), [Verdict::NoEffect; 6]);
}

/// A power cut does not close a spool at once, and a stuck one never.
#[test]
fn without_power_a_spool_is_safe_once_its_springs_have_closed_it() {
    let result = |scenario: &str, fault: &str| {
        let text = format!(
            "scenario = \"x\"\nfaults = [{{ {fault} }}]\nobserve_ms = 300\n\
             instants = {{ from_ms = 400, to_ms = 400, step_ms = 10 }}\n\
             safe = {{ within_ms = 100, expect = {{ position = 0 }} }}"
        );
        let plan = Plan::parse(&text, |_| Ok(scenario.to_owned())).unwrap_or_else(|error| panic!("{text}: {error:?}"));
        let result = campaign(&plan).cell(campaign(&plan).numbered(0).expect("a cell")).expect("a result");
        (result.verdict, result.safe_us)
    };
    let stuck = CAREFUL.replace("{ at_ms = 500 }", "{ at_ms = 399, plant = { spool = \"stuck\" } }, { at_ms = 500 }");
    for fault in ["power = { on = false }", "power = { on = false }, for_ms = 20", "power = { reset = \"watchdog\" }"] {
        // A quarter of the stroke takes 37.5 ms; the last unit of the position counts as neutral.
        let (verdict, safe_us) = result(CAREFUL, fault);
        assert_eq!(verdict, Verdict::Safe, "{fault}");
        assert!(safe_us.is_some_and(|us| (37_480..=37_500).contains(&us)), "{fault}: {safe_us:?}");
        assert_eq!(result(&stuck, fault).0, Verdict::NotSafe, "{fault}");
    }
}

#[test]
fn a_state_that_holds_only_for_a_moment_is_not_safe() {
    // The master moves the spool from side to side, so the spool passes neutral.
    let steps: String = (1..6)
        .map(|step| {
            format!("{{ at_ms = {}, send = \"220#0F00 00{}\", every_ms = 50 }},\n", step * 200, ["20", "E0"][step % 2])
        })
        .collect();
    let swing = CAREFUL.replace("  { at_ms = 500 },\n", &steps).replace(", position = 4096", "");
    let text = |safe: &str| {
        format!(
            "scenario = \"x\"\nfaults = [{{ corrupt = \"220\", data = {{ toggle = \"000000 08\" }} }}]\nobserve_ms = 300\n\
             instants = {{ from_ms = 300, to_ms = 300, step_ms = 10 }}\nsafe = {{ within_ms = 250, expect = {safe} }}"
        )
    };
    let verdict = |safe: &str| {
        let text = text(safe);
        let plan = Plan::parse(&text, |_| Ok(swing.clone())).unwrap_or_else(|error| panic!("{text}: {error:?}"));
        let result = campaign(&plan).cell(campaign(&plan).numbered(0).expect("a cell")).expect("a result");
        result.verdict
    };
    assert_eq!(verdict("{ position = { min = -328, max = 328 } }"), Verdict::NotSafe);
    assert_eq!(verdict("{ position = { min = -328, max = 328 } }, for_ms = 20"), Verdict::NotSafe);
    assert_eq!(verdict("{ position = { min = -328, max = 328 } }, for_ms = 1"), Verdict::Safe);
    assert_eq!(verdict("{ position = { min = -12000, max = 12000 } }"), Verdict::Safe);
}

#[test]
fn forked_cells_are_as_cells_from_the_start() {
    let faults = format!(
        "{INTERNAL}, {{ power = {{ on = false }}, for_ms = 100 }}, {{ lose = \"220\" }}, {{ swap = \"220\" }}, \
         {{ insert = \"220#0B00 0000\", every_ms = 30 }}, {{ plant = {{ profile = {{ word = \"supply_mv\", points = \"cranking\" }} }} }}"
    );
    for instants in [GRID, "instants = { from_ms = 300, to_ms = 330, at = \"each frame\" }"] {
        let plan = plan(&faults, instants, CAREFUL);
        let (forked, unforked) = (campaign(&plan), campaign(&plan).without_forks());
        for number in 0..forked.rows().len() {
            let results = row(&forked, number);
            assert_eq!(results, row(&unforked, number));
            for result in results.iter().step_by(5) {
                assert_eq!(forked.cell(result.cell()).as_ref(), Some(result));
                if let Some(number) = result.number {
                    assert_eq!(forked.numbered(number), Some(result.cell()));
                }
            }
        }
        assert_eq!(forked.numbered(forked.cells()), None);
    }
}

#[test]
fn the_instants_of_each_frame_are_its_ends() {
    let plan = plan(INTERNAL, "instants = { from_ms = 300, to_ms = 360, at = \"each frame\" }", CAREFUL);
    let campaign = campaign(&plan);
    let outcome = plan.scenario.run_traced(1);
    let ends: Vec<u64> = row(&campaign, 0).iter().filter(|cell| !cell.refined).map(|cell| cell.at_us).collect();
    // A set-point and its answer, every 50 ms.
    assert_eq!((ends.len() as u64, campaign.cells()), (campaign.cells(), campaign.rows()[0].cells));
    assert!(
        ends.len() >= 2 && ends.iter().all(|end| (300_000..=360_000).contains(end)),
        "{ends:?}\n{}",
        outcome.trace()
    );
}

#[test]
fn a_change_of_the_verdict_is_found_to_one_millisecond() {
    // The master listens from 350 ms on.
    let late = CAREFUL.replace("from_ms = 50", "from_ms = 350");
    let plan = plan(INTERNAL, GRID, &late);
    let mut results = row(&campaign(&plan), 0);
    results.sort_by_key(|result| result.at_us);
    let change = results.windows(2).find(|pair| pair[0].verdict != pair[1].verdict).expect("a change");
    assert_eq!(change[1].at_us - change[0].at_us, 1000, "{change:?}");
    assert!((348_000..=350_000).contains(&change[1].at_us), "{change:?}");
    // Every millisecond of the worst interval, once: the first interval without a listening master.
    let refined: Vec<u64> = results.iter().filter(|cell| cell.refined).map(|cell| cell.at_us).collect();
    let worst = (301_000..320_000).step_by(1000);
    assert!(worst.into_iter().all(|at| refined.iter().filter(|known| **known == at).count() == 1), "{refined:?}");
    assert!(results.iter().all(|cell| cell.refined == cell.number.is_none()));
}

#[test]
fn a_golden_run_that_proves_nothing_is_an_error() {
    let refused = |scenario: &str| {
        let plan = plan(INTERNAL, GRID, scenario);
        Campaign::new(&plan).err().map(|error| error.to_string()).unwrap_or_default()
    };
    let fails = refused(&CAREFUL.replace("position = 4096", "position = 4097"));
    assert!(
        fails.contains("the scenario fails without a fault (seed 1):") && fails.contains("drive.toml:7"),
        "{fails}"
    );
    let stops = CAREFUL.replace("{ at_ms = 500 },", "{ at_ms = 380, send = \"000#0220\" },");
    let detected = refused(&stops);
    assert!(detected.contains("detected: the proof holds without a fault, at 380 ms"), "{detected}");
}

#[test]
fn the_communication_errors_are_those_of_the_cyclic_identifiers() {
    let plan = plan("\"communication\"", GRID, CAREFUL);
    let campaign = campaign(&plan);
    let references: Vec<&str> = campaign.rows().iter().filter_map(Row::reference).collect();
    // The set-point and its answer; boot-up, EMCY and NMT frames occur only at the start.
    assert_eq!(references.len(), 16, "{references:?}");
    assert_eq!(references.iter().filter(|text| **text == "IEC 61784-3: loss").count(), 2);
    let first = campaign.rows()[0].fault();
    assert_eq!(first, "corrupt 1A0, data toggle 00000040");
}

#[test]
fn seeds_are_rows_of_their_own() {
    let text =
        format!("scenario = \"x\"\nseeds = [1, 2]\nfaults = [{INTERNAL}, {{ lose = \"220\" }}]\n{GRID}\n{ORACLES}");
    let plan = Plan::parse(&text, |_| Ok(CAREFUL.to_owned())).expect("a plan");
    let campaign = campaign(&plan);
    let rows: Vec<(u64, u64)> = campaign.rows().iter().map(|row| (row.seed, row.first)).collect();
    assert_eq!(rows, [(1, 0), (2, 6), (1, 12), (2, 18)]);
    assert_eq!(row(&campaign, 1)[0].seed, 2);
}

#[test]
fn the_trace_of_a_cell_tells_fault_and_verdict() {
    let plan = plan(INTERNAL, GRID, CAREFUL);
    let campaign = campaign(&plan);
    let cell = campaign.numbered(1).expect("a cell");
    let (trace, result) = (campaign.trace(cell).expect("a trace"), campaign.cell(cell).expect("a result"));
    let detected = result.detected_us.expect("detected");
    let notes: Vec<&str> = trace.lines().filter(|line| line.starts_with("--")).collect();
    let told = format!("-- detected: after {}.{:03} ms", detected / 1000, detected % 1000);
    assert_eq!((notes[0], notes[1]), ("-- fault: valve: internal_fault = true", &*told), "{trace}");
    assert!(notes[3] == "-- verdict: safe" && trace.contains("EMCY: internal"), "{trace}");
}
