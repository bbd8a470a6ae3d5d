//! The cost of a frame outside the world, in instructions of the host: read from a client, written to one, logged and
//! explained. `cargo bench --package pve-sim` measures clients by the wall clock, and the processor time of the whole
//! simulator.
//!
//! The limits are budgets, at most a fifth above the measured values.

#![allow(missing_docs, reason = "the macros of gungraun make modules without any")]

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use hal_sim::Kind;
use hal_sim::explain::{Explainer, Node};
use hal_sim::log::{Timestamp, write_frame};
use protocol_core::device::pve;
use protocol_core::frame::Frame;
use pve_sim::gateway::socketcand::{Parser, Request, emit_frame};

const AT: Timestamp = Timestamp::from_micros(1_795_223_549_715_344);

fn frame(text: &str) -> Frame {
    text.parse().expect("a frame")
}

/// Returns the explainer of a bus with twenty valves.
fn explainer() -> Explainer {
    let kind = Kind::Pve(pve::Kind::PveaCanopen);
    let node = |id: u8| Node { name: format!("valve-{id}"), kind, node_id: Some(id) };
    Explainer::new((1..=20).map(node).collect())
}

fn budget(instructions: u64) -> LibraryBenchmarkConfig {
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, instructions)]);
    let mut config = LibraryBenchmarkConfig::default();
    config.tool(callgrind);
    config
}

#[library_benchmark(config = budget(5_000))]
#[bench::send("< send 605 8 40 18 10 1 0 0 0 0 >")]
fn request(text: &str) -> Option<Request> {
    let mut parser = Parser::default();
    text.bytes().find_map(|byte| parser.push(byte)).and_then(Result::ok)
}

#[library_benchmark(config = budget(1_500))]
#[bench::frame(frame("585: 43 18 10 01 19 00 00 01"), String::with_capacity(256))]
fn to_client(frame: Frame, mut out: String) -> String {
    emit_frame(&mut out, AT, &frame);
    out
}

#[library_benchmark(config = budget(1_700))]
#[bench::frame(frame("585: 43 18 10 01 19 00 00 01"), String::with_capacity(256))]
fn logged(frame: Frame, mut out: String) -> String {
    write_frame(&mut out, AT, "pve0", &frame);
    out
}

#[library_benchmark(config = budget(7_400))]
#[bench::sdo_answer(explainer(), frame("585: 43 18 10 01 19 00 00 01"))]
fn explained(explainer: Explainer, frame: Frame) -> (Explainer, String) {
    let meaning = explainer.explain(&frame, Some("valve-5"));
    (explainer, meaning)
}

library_benchmark_group!(name = gateway, benchmarks = [request, to_client, logged, explained]);

main!(library_benchmark_groups = [gateway]);
