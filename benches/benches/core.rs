//! What a frame costs the core, in instructions of the host: frame in → frame out, with everything due done.
//!
//! The limits are budgets: a change that breaks one fails `./test`. The figures of the best C stack, measured the same
//! way, stand beside them.

#![allow(missing_docs, reason = "the macros of gungraun make modules without any")]

use std::hint::black_box;

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use protocol_core::device::pve::{Kind, PveCanopen, Setup};
use protocol_core::device::{Device, Effect, Senses, StartCause};
use protocol_core::frame::Frame;
use protocol_core::memory::Image;
use protocol_core::time::{Duration, Instant, after};

/// A valve and the frame that it is about to receive.
struct Case {
    valve: PveCanopen,
    frame: Frame,
    now: Instant,
}

fn frame(text: &str) -> Frame {
    text.parse().expect("a frame")
}

/// A booted valve at node 0x20 that has received these frames, a millisecond apart, and has nothing to send.
fn after_frames(texts: &[&str], next: &str) -> Box<Case> {
    let mut now = Instant::from_secs(1);
    let setup = Setup::new(Kind::PveaCanopen);
    let mut valve = PveCanopen::power_on(setup, &Image::empty(), StartCause::PowerOn, now);
    valve.sense(&Senses::default(), now);
    settle(&mut valve, now);
    for text in texts {
        now = after(now, Duration::from_millis(1));
        valve.handle(&frame(text), now);
        settle(&mut valve, now);
    }
    now = after(now, Duration::from_millis(1));
    Box::new(Case { valve, frame: frame(next), now })
}

fn settle(valve: &mut PveCanopen, now: Instant) {
    for _ in 0..8 {
        while valve.next_frame().is_some() {}
        if let Some(Effect::Store(key, _)) = valve.next_effect(now) {
            valve.stored(key, Ok(()), now);
        }
    }
}

fn idle(next: &str) -> Box<Case> {
    after_frames(&[], next)
}

fn active(next: &str) -> Box<Case> {
    let start = "000: 01 00";
    let cycle = "220: 0F 00 00 10";
    after_frames(&[start, cycle, cycle, cycle, cycle], next)
}

fn in_segmented_upload(next: &str) -> Box<Case> {
    after_frames(&["620: 40 0A 10 00 00 00 00 00"], next)
}

fn in_selection(next: &str) -> Box<Case> {
    let parts = ["7E5: 40 19 00 00 01 00 00 00", "7E5: 41 00 00 36 53 00 00 00", "7E5: 42 20 00 01 00 00 00 00"];
    after_frames(&parts, next)
}

/// The path of a frame through the device: handled, everything due done, the answer handed out.
#[inline(always)]
fn pass(case: &mut Case) -> Option<Frame> {
    case.valve.handle(&case.frame, case.now);
    case.valve.poll(case.now);
    case.valve.next_frame()
}

fn budget(instructions: u64) -> LibraryBenchmarkConfig {
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, instructions)]);
    let mut config = LibraryBenchmarkConfig::default();
    config.tool(callgrind);
    config
}

// SDO upload of an UNSIGNED32 (755 in C).
#[library_benchmark(config = budget(499))]
#[bench::u32(idle("620: 40 18 10 01 00 00 00 00"))]
fn sdo_upload(mut case: Box<Case>) -> (Box<Case>, Option<Frame>) {
    let answer = black_box(pass(&mut case));
    (case, answer)
}

// SDO download of an UNSIGNED16 (701 in C).
#[library_benchmark(config = budget(499))]
#[bench::u16(idle("620: 2B 40 60 00 01 00 00 00"))]
fn sdo_download(mut case: Box<Case>) -> (Box<Case>, Option<Frame>) {
    let answer = black_box(pass(&mut case));
    (case, answer)
}

// A segment of a string.
#[library_benchmark(config = budget(499))]
#[bench::string(in_segmented_upload("620: 60 00 00 00 00 00 00 00"))]
fn sdo_segment(mut case: Box<Case>) -> (Box<Case>, Option<Frame>) {
    let answer = black_box(pass(&mut case));
    (case, answer)
}

// RPDO of two objects → TPDO (658 in C): the master repeats its set-point, or changes it.
#[library_benchmark(config = budget(449))]
#[bench::same_set_point(active("220: 0F 00 00 10"))]
fn rpdo_to_tpdo(mut case: Box<Case>) -> (Box<Case>, Option<Frame>) {
    let answer = black_box(pass(&mut case));
    (case, answer)
}

// RPDO with a new set-point: the spool sets out, and the monitors reckon when to look next.
#[library_benchmark(config = budget(900))]
#[bench::new_set_point(active("220: 0F 00 00 20"))]
fn rpdo_moves_spool(mut case: Box<Case>) -> (Box<Case>, Option<Frame>) {
    let answer = black_box(pass(&mut case));
    (case, answer)
}

// A frame for somebody else (57 in C).
#[library_benchmark(config = budget(39))]
#[bench::standard(idle("1A1: 0F 00 00 00"))]
#[bench::extended(idle("18FECA83: FF FF"))]
fn foreign(mut case: Box<Case>) -> Box<Case> {
    case.valve.handle(&case.frame, case.now);
    case
}

// `poll` with nothing due (472 in C).
#[library_benchmark(config = budget(29))]
#[bench::idle(idle("080:"))]
fn nothing_due(mut case: Box<Case>) -> Box<Case> {
    case.valve.poll(case.now);
    case
}

// The last of the four numbers of LSS switch state selective.
#[library_benchmark(config = budget(499))]
#[bench::last_number(in_selection("7E5: 43 00 01 2E 5B 00 00 00"))]
fn lss_switch_selective(mut case: Box<Case>) -> (Box<Case>, Option<Frame>) {
    let answer = black_box(pass(&mut case));
    (case, answer)
}

library_benchmark_group!(
    name = canopen,
    benchmarks = [
        sdo_upload,
        sdo_download,
        sdo_segment,
        rpdo_to_tpdo,
        rpdo_moves_spool,
        foreign,
        nothing_due,
        lss_switch_selective
    ]
);

main!(library_benchmark_groups = canopen);
