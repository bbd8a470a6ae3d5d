//! Virtual time against the processor time of this machine, for many valves on a busy bus.
//!
//! Nothing is limited here: caches and pipelines are shared with whatever else the machine does, and no two machines are
//! alike. The limits of the same two scenes are those of `world`, in instructions.

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

/// Prints how many times as fast as real time a scene passes so many seconds.
fn print(scene: &str, seconds: u64, pass: impl FnOnce(u64)) {
    let start = processor_time();
    pass(seconds);
    let took = processor_time().saturating_sub(start);
    let factor = WallTime::from_secs(seconds).as_secs_f64() / took.as_secs_f64();
    println!("{scene}: {factor:.0} times as fast as real time");
}

/// Returns the processor time that this thread has used so far.
fn processor_time() -> WallTime {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    WallTime::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}
