//! The cost of a frame in instructions of the host: from its reception through the pump and all due timers to the
//! answer in the controller.
//!
//! The limits are budgets: a change that exceeds one fails `./test`. The figures of other stacks stand beside them.
//! Those of CANopenNode range from the calls that the frame needs to its whole millisecond.

#![allow(missing_docs, reason = "the macros of gungraun make modules without any")]

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use protocol_core::controller::{Controller, Filter, Filters};
use protocol_core::device::hat::{self, Hat};
use protocol_core::device::pve::{Kind, PveCanopen, PveIsobus, Setup};
use protocol_core::device::{Device, Effect, Inputs, StartCause};
use protocol_core::encoder::Shaft;
use protocol_core::frame::Frame;
use protocol_core::memory::Image;
use protocol_core::pump::{pump, receive};
use protocol_core::time::{Duration, Instant, after};

/// A valve, and the frame that it receives next.
struct Case<D> {
    valve: D,
    frame: Frame,
    now: Instant,
}

fn frame(text: &str) -> Frame {
    text.parse().expect("a frame")
}

/// Returns a valve that booted half a second ago, has received these frames a millisecond apart, and has nothing to
/// send.
fn after_frames<D: Device>(power_on: impl FnOnce(Instant) -> D, texts: &[&str], next: &str) -> Box<Case<D>> {
    let mut now = Instant::from_secs(1);
    let mut valve = power_on(now);
    valve.sense(&Inputs::default(), now);
    settle(&mut valve, now);
    let booted = after(now, Duration::from_millis(510));
    while valve.deadline() <= booted {
        now = valve.deadline();
        valve.poll(now);
        settle(&mut valve, now);
    }
    now = booted;
    for text in texts {
        valve.handle(&frame(text), now);
        settle(&mut valve, now);
        now = after(now, Duration::from_millis(1));
    }
    Box::new(Case { valve, frame: frame(next), now })
}

fn settle(valve: &mut impl Device, now: Instant) {
    for _ in 0..8 {
        while valve.next_frame(now).is_some() {}
        valve.all_sent(now);
        valve.take_filters();
        if let Some(Effect::Store(key, _)) = valve.next_effect(true) {
            valve.stored(key, Ok(()), now);
        }
    }
}

fn canopen(now: Instant) -> PveCanopen {
    PveCanopen::power_on(Setup::new(Kind::PveaCanopen), &Image::empty(), StartCause::PowerOn, now)
}

fn isobus(now: Instant) -> PveIsobus {
    let setup = Setup { node_id: Some(0x83), ..Setup::new(Kind::PveaIsobus) };
    PveIsobus::power_on(setup, &Image::empty(), StartCause::PowerOn, now)
}

/// The write of a heartbeat time of one second.
const HEARTBEAT: &str = "620: 2B 17 10 00 E8 03 00 00";
const START: &str = "000: 01 00";

/// Returns a valve in operational, with the heartbeat on.
fn operational(next: &str) -> Box<Exchange<PveCanopen>> {
    after_frames(canopen, &[HEARTBEAT, START], next).into()
}

fn active(next: &str) -> Box<Exchange<PveCanopen>> {
    let cycle = "220: 0F 00 00 10";
    after_frames(canopen, &[HEARTBEAT, START, cycle, cycle, cycle, cycle], next).into()
}

fn in_segmented_upload(next: &str) -> Box<Exchange<PveCanopen>> {
    after_frames(canopen, &[HEARTBEAT, START, "620: 40 0A 10 00 00 00 00 00"], next).into()
}

fn in_selection(next: &str) -> Box<Exchange<PveCanopen>> {
    let parts = ["7E5: 40 19 00 00 01 00 00 00", "7E5: 41 00 00 36 53 00 00 00", "7E5: 42 20 00 01 00 00 00 00"];
    after_frames(canopen, &parts, next).into()
}

fn hat(now: Instant) -> Hat {
    Hat::power_on(hat::Setup::new(hat::Kind::Hat1000), &Image::empty(), StartCause::PowerOn, now)
}

/// Returns a sensor with a turning shaft in operational, with the heartbeat on and a TPDO of this type. The event timer
/// is 100 ms.
fn sensor(kind: u8, next: &str) -> Box<Case<Hat>> {
    let kind = format!("601: 2F 00 18 02 {kind:02X} 00 00 00");
    let (timer, on) = ("601: 2B 00 18 05 64 00 00 00", "601: 23 00 18 01 81 01 00 00");
    let mut case = after_frames(hat, &["601: 2B 17 10 00 E8 03 00 00", &kind, timer, on, START], next);
    let shaft = Shaft { speed_rpm: 33, since: case.now, ..Shaft::at(1_234) };
    case.valve.sense(&Inputs::encoder(shaft), case.now);
    case
}

/// Returns a sensor whose event timer has just ended.
fn pdo_due() -> Box<Exchange<Hat>> {
    let mut case = sensor(254, "080:");
    case.now = case.valve.deadline();
    let mut exchange: Box<Exchange<Hat>> = case.into();
    exchange.can.received = None;
    exchange
}

/// A controller that holds one received frame and accepts every frame to send.
#[derive(Default)]
struct ClientEnd {
    received: Option<Frame>,
    taken: Option<Frame>,
}

impl embedded_can::nb::Can for ClientEnd {
    type Frame = Frame;
    type Error = core::convert::Infallible;

    #[inline(always)]
    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Self::Error> {
        self.taken = Some(*frame);
        Ok(None)
    }

    #[inline(always)]
    fn receive(&mut self) -> nb::Result<Frame, Self::Error> {
        self.received.take().ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for ClientEnd {
    #[inline(always)]
    fn holds(&self, which: Filter) -> bool {
        self.taken.is_some_and(|frame| which.passes(&frame))
    }

    fn abort(&mut self, _: Filter) {}

    fn set_filters(&mut self, _: &Filters) {}
}

/// A valve, and a controller that holds the frame to receive.
struct Exchange<D> {
    valve: D,
    can: ClientEnd,
    now: Instant,
    /// Whether the pump has returned an effect.
    effect: bool,
}

impl<D> Exchange<D> {
    /// Pumps: reception, due timers, and the answers into the controller.
    #[inline(always)]
    fn run(mut self: Box<Self>) -> Box<Self>
    where
        D: Device,
    {
        self.effect = pump(&mut self.valve, &mut self.can, self.now).is_some();
        self
    }

    /// Receives a frame for another node, which needs no pump.
    #[inline(always)]
    fn receive(mut self: Box<Self>) -> Box<Self>
    where
        D: Device,
    {
        self.effect = receive(&mut self.valve, &mut self.can, self.now);
        self
    }
}

impl<D> From<Box<Case<D>>> for Box<Exchange<D>> {
    fn from(case: Box<Case<D>>) -> Self {
        let can = ClientEnd { received: Some(case.frame), taken: None };
        Box::new(Exchange { valve: case.valve, can, now: case.now, effect: false })
    }
}

fn budget(instructions: u64) -> LibraryBenchmarkConfig {
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, instructions)]);
    let mut config = LibraryBenchmarkConfig::default();
    config.tool(callgrind);
    config
}

// SDO upload of an UNSIGNED32 (620–858 in C).
#[library_benchmark(config = budget(480))]
#[bench::u32(operational("620: 40 18 10 01 00 00 00 00"))]
fn sdo_upload(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// SDO download of an UNSIGNED16 (577–815 in C).
#[library_benchmark(config = budget(540))]
#[bench::u16(operational("620: 2B 40 60 00 01 00 00 00"))]
fn sdo_download(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// An SDO download of the heartbeat time, an object of the node: the answer and the first heartbeat.
#[library_benchmark(config = budget(790))]
#[bench::heartbeat_time(operational(HEARTBEAT))]
fn sdo_download_of_node(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// A segment of a string.
#[library_benchmark(config = budget(400))]
#[bench::string(in_segmented_upload("620: 60 00 00 00 00 00 00 00"))]
fn sdo_segment(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// An RPDO of two objects and its TPDO (741–926 in C). The master repeats its set-point.
#[library_benchmark(config = budget(515))]
#[bench::same_set_point(active("220: 0F 00 00 10"))]
fn rpdo_to_tpdo(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// The same with a new set-point.
#[library_benchmark(config = budget(575))]
#[bench::new_set_point(active("220: 0F 00 00 20"))]
fn rpdo_to_tpdo_new(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// A frame for another node (56 in C).
#[library_benchmark(config = budget(32))]
#[bench::standard(operational("1A1: 0F 00 00 00"))]
#[bench::extended(operational("18FECA83: FF FF"))]
fn foreign(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.receive()
}

// `poll` without a due timer (472 in C).
#[library_benchmark(config = budget(9))]
#[bench::idle(operational("080:"))]
fn nothing_due(mut exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.valve.poll(exchange.now);
    exchange
}

// The last of the four numbers of LSS switch state selective.
#[library_benchmark(config = budget(370))]
#[bench::last_number(in_selection("7E5: 43 00 01 2E 5B 00 00 00"))]
fn lss_switch_selective(exchange: Box<Exchange<PveCanopen>>) -> Box<Exchange<PveCanopen>> {
    exchange.run()
}

// The same for a sensor with a turning shaft.
#[library_benchmark(config = budget(480))]
#[bench::position(sensor(1, "601: 40 04 60 00 00 00 00 00").into())]
fn hat_sdo_upload(exchange: Box<Exchange<Hat>>) -> Box<Exchange<Hat>> {
    exchange.run()
}

#[library_benchmark(config = budget(471))]
#[bench::preset(sensor(1, "601: 23 03 60 00 05 00 00 00").into())]
fn hat_sdo_download(exchange: Box<Exchange<Hat>>) -> Box<Exchange<Hat>> {
    exchange.run()
}

// A SYNC and the TPDO of the position, due by its number or because the position has changed.
#[library_benchmark(config = budget(305))]
#[bench::every(sensor(1, "080:").into())]
#[bench::on_change(sensor(0, "080:").into())]
fn hat_sync_to_tpdo(exchange: Box<Exchange<Hat>>) -> Box<Exchange<Hat>> {
    exchange.run()
}

// The end of the event timer and the TPDO of the position.
#[library_benchmark(config = budget(289))]
#[bench::due(pdo_due())]
fn hat_timed_tpdo(exchange: Box<Exchange<Hat>>) -> Box<Exchange<Hat>> {
    exchange.run()
}

fn claimed(next: &str) -> Box<Exchange<PveIsobus>> {
    after_frames(isobus, &[], next).into()
}

fn driven(next: &str) -> Box<Exchange<PveIsobus>> {
    after_frames(isobus, &["0CFE3327: 40 FF 31 FF FF FF FF FF"], next).into()
}

/// Returns a driven valve whose spool has arrived, at the time of its next AVEF.
fn avef_due(next: Option<&str>) -> Box<Exchange<PveIsobus>> {
    let mut case = after_frames(isobus, &["0CFE3327: 40 FF 31 FF FF FF FF FF"], next.unwrap_or("080:"));
    let arrived = after(case.now, Duration::from_millis(100));
    while case.valve.deadline() <= arrived {
        case.now = case.valve.deadline();
        case.valve.poll(case.now);
        settle(&mut case.valve, case.now);
    }
    case.now = case.valve.deadline();
    let mut exchange: Box<Exchange<PveIsobus>> = case.into();
    exchange.can.received = next.map(frame);
    exchange
}

// A request to all and the address claim (83 in sae-j1939-rs, without a pump).
#[library_benchmark(config = budget(206))]
#[bench::to_all(claimed("18EAFF27: 00 EE 00"))]
fn claim_request(exchange: Box<Exchange<PveIsobus>>) -> Box<Exchange<PveIsobus>> {
    exchange.run()
}

// A frame for another node (41 in sae-j1939-rs).
#[library_benchmark(config = budget(50))]
#[bench::standard(claimed("1A1: 0F 00 00 00"))]
#[bench::avc_of_another(claimed("0CFE3427: 40 FF 31 FF FF FF FF FF"))]
#[bench::request_of_another(claimed("18EA8427: 00 EE 00"))]
#[bench::proprietary(claimed("18EF8427: 00 EE 00"))]
fn isobus_foreign(exchange: Box<Exchange<PveIsobus>>) -> Box<Exchange<PveIsobus>> {
    exchange.receive()
}

// `poll` without a due timer.
#[library_benchmark(config = budget(9))]
#[bench::idle(claimed("080:"))]
fn isobus_nothing_due(mut exchange: Box<Exchange<PveIsobus>>) -> Box<Exchange<PveIsobus>> {
    exchange.valve.poll(exchange.now);
    exchange
}

// An AVC, which restarts the time guard. It moves the spool or repeats the command.
#[library_benchmark(config = budget(390))]
#[bench::same_flow(driven("0CFE3327: 40 FF 31 FF FF FF FF FF"))]
#[bench::new_flow(driven("0CFE3327: 80 FF 31 FF FF FF FF FF"))]
fn avc(exchange: Box<Exchange<PveIsobus>>) -> Box<Exchange<PveIsobus>> {
    exchange.run()
}

// The same at the time of an AVEF.
#[library_benchmark(config = budget(450))]
#[bench::same_flow(avef_due(Some("0CFE3327: 40 FF 31 FF FF FF FF FF")))]
#[bench::new_flow(avef_due(Some("0CFE3327: 80 FF 31 FF FF FF FF FF")))]
fn avc_and_avef(exchange: Box<Exchange<PveIsobus>>) -> Box<Exchange<PveIsobus>> {
    exchange.run()
}

// An AVEF at its time.
#[library_benchmark(config = budget(260))]
#[bench::due(avef_due(None))]
fn avef(exchange: Box<Exchange<PveIsobus>>) -> Box<Exchange<PveIsobus>> {
    exchange.run()
}

library_benchmark_group!(
    name = canopen_valve,
    benchmarks = [
        sdo_upload,
        sdo_download,
        sdo_download_of_node,
        sdo_segment,
        rpdo_to_tpdo,
        rpdo_to_tpdo_new,
        foreign,
        nothing_due,
        lss_switch_selective
    ]
);

library_benchmark_group!(
    name = isobus_valve,
    benchmarks = [claim_request, isobus_foreign, isobus_nothing_due, avc, avc_and_avef, avef]
);

library_benchmark_group!(
    name = sensor_on_canopen,
    benchmarks = [hat_sdo_upload, hat_sdo_download, hat_sync_to_tpdo, hat_timed_tpdo]
);

main!(library_benchmark_groups = [canopen_valve, sensor_on_canopen, isobus_valve]);
