//! How fast virtual time passes against the processor time of this machine: many valves, a busy bus.
//!
//! Processor time leaves out what else the machine does at the moment, but not that other programs share its caches and
//! pipelines: on a busy machine it passes at some 60 %, and not every machine is as fast as the one of the figures. The
//! limits leave room for that, at half of what was measured (2,750 and 4,500); the sharp ones are those of `world`, in
//! instructions.

use std::process::ExitCode;
use std::time::Duration as WallTime;

use rustix::time::{ClockId, clock_gettime};

#[path = "../scenes.rs"]
mod scenes;

use scenes::Scene;

/// A scene, and how fast it has to pass.
struct Run {
    name: &'static str,
    scene: fn() -> Box<Scene>,
    /// Lets so many virtual seconds of it pass.
    pass: fn(&mut Scene, u64),
    seconds: u64,
    /// Virtual against processor time, at least.
    limit: f64,
}

const RUNS: [Run; 2] = [
    Run {
        name: "20 valves at 80 % load",
        scene: Scene::sync_driven,
        pass: Scene::sync_for,
        seconds: 600,
        limit: 1_350.0,
    },
    Run {
        name: "1,000 valves with heartbeats of 1 s",
        scene: Scene::heartbeats,
        pass: Scene::beat_for,
        seconds: 300,
        limit: 2_200.0,
    },
];

fn main() -> ExitCode {
    let mut in_time = true;
    for Run { name, scene, pass, seconds, limit } in RUNS {
        let mut scene = scene();
        let start = processor_time();
        pass(&mut scene, seconds);
        let took = processor_time().saturating_sub(start);
        let factor = WallTime::from_secs(seconds).as_secs_f64() / took.as_secs_f64();
        println!("{name}: {factor:.0} times as fast as real time, limit {limit:.0}");
        in_time &= factor >= limit;
    }
    if in_time { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What this thread has used so far.
fn processor_time() -> WallTime {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    WallTime::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}
