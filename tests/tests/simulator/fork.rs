//! The clone of a simulation: it goes on as the original would, from any instant of any scenario.

use std::path::Path;

use hal_sim::scenario::{Outcome, Scenario};
use hal_sim::simulation::Simulation;
use hal_sim::state::DeviceState;
use protocol_core::memory::Image;
use protocol_core::time::Duration;

/// So many instants of each scenario, unless `SCENARIO_FORKS` says otherwise.
const FORKS: u64 = 10;

/// What came of a scenario, and how the devices are at its end.
#[derive(Debug, PartialEq)]
struct End {
    outcome: Outcome,
    states: Vec<DeviceState>,
    memories: Vec<Image>,
}

/// Runs a scenario. After `fork` things that happened, a clone takes the place of the simulation, which goes on for a
/// while by itself and is dropped then. `last`: how many things happen.
fn run(scenario: &Scenario, fork: Option<u64>, last: u64) -> End {
    let (mut states, mut memories, mut count) = (Vec::new(), Vec::new(), 0);
    let outcome = scenario.run_watched(7, |simulation| {
        if fork == Some(count) {
            let clone = simulation.clone();
            disturb(simulation);
            *simulation = clone;
        }
        count += 1;
        if count == last {
            states = simulation.states();
            let world = simulation.world();
            memories = world.devices().map(|node| world.memory(node).peek_image()).collect();
        }
    });
    End { outcome, states, memories }
}

/// Returns how many things happen in a scenario.
fn count(scenario: &Scenario) -> u64 {
    let mut count = 0;
    let _ = scenario.run_watched(7, |_| count += 1);
    count
}

/// Does to a simulation what would be seen in another one that shares anything with it.
fn disturb(simulation: &mut Simulation) {
    let world = simulation.world_mut();
    for node in world.devices() {
        world.power(node, false);
        world.power(node, true);
    }
    let end = simulation.now() + Duration::from_millis(50);
    simulation.run_until(end);
}

#[test]
fn a_clone_goes_on_as_the_original_from_any_instant_of_every_scenario() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios");
    let forks = std::env::var("SCENARIO_FORKS").map_or(FORKS, |forks| forks.parse().expect("a number"));
    let mut files = 0;
    for file in std::fs::read_dir(folder).expect("the folder of the scenarios") {
        let path = file.expect("a file").path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("a text");
        let scenario = Scenario::parse(&text).unwrap_or_else(|error| panic!("{}: {error:?}", path.display()));
        let count = count(&scenario);
        let original = run(&scenario, None, count);
        assert!(original.outcome.is_success() && !original.states.is_empty(), "{}", path.display());
        let mut random = fastrand::Rng::with_seed(24);
        for _ in 0..forks {
            let fork = random.u64(..count);
            assert!(run(&scenario, Some(fork), count) == original, "{}: after event {fork} of {count}", path.display());
        }
        files += 1;
    }
    assert!(files >= 14, "{files}");
}
