//! Virtual time against the processor time of this machine, for many valves on a busy bus.
//!
//! There are no limits here, because other programs share caches and pipelines, and machines differ. `world` limits the
//! same two scenes, in instructions.

use std::time::Duration as WallTime;

use rustix::time::{ClockId, clock_gettime};

#[path = "../scenes.rs"]
mod scenes;

use scenes::Scene;

fn main() {
    let mut busy = Scene::sync_driven();
    print("20 valves at 80 % load", 600, |seconds| busy.sync_for(seconds));
    let mut beating = Scene::heartbeats();
    print("1,000 valves with heartbeats of 1 s", 300, |seconds| beating.beat_for(seconds));
}

/// Runs a scene for a number of seconds, and prints its speed as a multiple of real time.
fn print(scene: &str, seconds: u64, pass: impl FnOnce(u64)) {
    let start = processor_time();
    pass(seconds);
    let took = processor_time().saturating_sub(start);
    let factor = WallTime::from_secs(seconds).as_secs_f64() / took.as_secs_f64();
    println!("{scene}: {factor:.0} times as fast as real time");
}

/// Returns the processor time of this thread so far.
fn processor_time() -> WallTime {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    WallTime::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}
