//! The cost of the simulated world in instructions of the host: a frame on buses of many sizes, and a second of buses
//! under load. Traces and gateways are left out.
//!
//! The limits are budgets, at most 20 % above the measured values. A change that exceeds one fails `./test`.

#![allow(missing_docs, reason = "the macros of gungraun make modules without any")]

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};

#[path = "../scenes.rs"]
mod scenes;

use protocol_core::frame::Frame;
use scenes::Scene;

fn budget(instructions: u64) -> LibraryBenchmarkConfig {
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, instructions)]);
    let mut config = LibraryBenchmarkConfig::default();
    config.tool(callgrind);
    config
}

fn foreign(valves: usize) -> (Box<Scene>, Frame) {
    (Scene::idle(valves), scenes::frame("1A1: 0F 00 00 20 00 40 00 00"))
}

fn request(valves: usize) -> (Box<Scene>, Frame) {
    (Scene::idle(valves), scenes::frame("601: 40 18 10 01 00 00 00 00"))
}

// A frame for no valve, from the moment when a client gives it to the bus.
#[library_benchmark]
#[bench::valves_1(args = (foreign(1)), config = budget(1_500))]
#[bench::valves_20(args = (foreign(20)), config = budget(1_500))]
#[bench::valves_100(args = (foreign(100)), config = budget(1_500))]
fn foreign_frame((mut scene, frame): (Box<Scene>, Frame)) -> Box<Scene> {
    scene.pass(frame, 1);
    scene
}

// An SDO upload, from the moment when the client gives the request to the bus to its answer.
#[library_benchmark]
#[bench::valves_20(args = (request(20)), config = budget(4_200))]
fn sdo_round_trip((mut scene, frame): (Box<Scene>, Frame)) -> Box<Scene> {
    scene.pass(frame, 2);
    scene
}

// The clone of a world of two valves. A campaign makes one for each fault.
#[library_benchmark]
#[bench::valves_2(args = (Scene::idle(2)), config = budget(44_000))]
fn clone(scene: Box<Scene>) -> [Box<Scene>; 2] {
    [scene.clone(), scene]
}

// A second of 20 valves that answer every SYNC, at 80 % load.
#[library_benchmark]
#[bench::valves_20(args = (Scene::sync_driven()), config = budget(5_900_000))]
fn sync_driven(mut scene: Box<Scene>) -> Box<Scene> {
    scene.sync_for(1);
    scene
}

// A second of 1,000 valves on one bus that send heartbeats only.
#[library_benchmark]
#[bench::valves_1000(args = (Scene::heartbeats()), config = budget(2_700_000))]
fn heartbeats(mut scene: Box<Scene>) -> Box<Scene> {
    scene.beat_for(1);
    scene
}

library_benchmark_group!(name = frames, benchmarks = [foreign_frame, sdo_round_trip, clone]);
library_benchmark_group!(name = seconds, benchmarks = [sync_driven, heartbeats]);

main!(library_benchmark_groups = [frames, seconds]);
