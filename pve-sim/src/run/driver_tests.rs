//! Time as clients see it, on a wall clock that advances only while the driver waits: hours of inactivity, and pauses
//! of the process, take no real time.

use protocol_core::controller::BitRate;
use std::sync::{Arc, Condvar, Mutex};

use protocol_core::device::pve;
use protocol_core::frame::Frame;

use super::*;
use crate::inbox::{ClientEnd, ClientId, ClientQueue, Reply, ToClient};
use hal_sim::devices::NamedDevice;
use hal_sim::{Kind, Memory};

#[path = "control_tests.rs"]
mod control_tests;

/// Events from the platform, in the order of time.
enum PlatformEvent {
    Message(ToWorld),
    /// The process pauses for this time; messages that arrive meanwhile are read afterwards.
    Stall(WallDuration),
}

/// A wall clock that advances only while the driver waits.
struct Script {
    now: WallInstant,
    /// The time of the driver's work between two clock readings.
    work: WallDuration,
    end: WallInstant,
    plan: VecDeque<(WallInstant, PlatformEvent)>,
    /// The number of waits.
    waits: u64,
    /// The time spent spinning.
    awake: WallDuration,
}

impl Script {
    fn pass(&mut self, until: Option<WallInstant>) -> Option<Arrival> {
        self.waits += 1;
        let next = self.plan.front().map(|(at, _)| *at);
        let until = until.into_iter().chain(next).min().unwrap_or(self.end);
        self.now = self.now.max(until.min(self.end));
        self.take()
    }
}

impl Platform for Script {
    fn now(&mut self) -> WallInstant {
        self.now += self.work;
        self.now
    }

    fn is_ending(&self) -> bool {
        self.now >= self.end
    }

    fn take(&mut self) -> Option<Arrival> {
        while let Some((at, event)) = self.plan.pop_front_if(|(at, _)| *at <= self.now) {
            match event {
                PlatformEvent::Message(message) => return Some(Arrival { at: at.max(self.now), message }),
                PlatformEvent::Stall(length) => self.now += length,
            }
        }
        None
    }

    fn wait(&mut self, until: Option<WallInstant>, spin: WallDuration) -> Option<Arrival> {
        let early = until.map_or(self.end, |until| until - spin).max(self.now);
        let arrival = self.pass(until);
        self.awake += self.now.saturating_duration_since(early);
        arrival
    }
}

/// The text on stdout or stderr.
#[derive(Clone, Default)]
struct Said(Arc<(Mutex<Vec<u8>>, Condvar)>);

impl Said {
    fn text(&self) -> String {
        String::from_utf8(self.0.0.lock().unwrap().clone()).unwrap()
    }

    /// Waits until the printer has printed a text.
    fn wait_for(&self, wanted: &str) {
        let is_missing = |bytes: &mut Vec<u8>| !String::from_utf8_lossy(bytes).contains(wanted);
        let (mutex, changed) = &*self.0;
        let waited = changed.wait_timeout_while(mutex.lock().unwrap(), PATIENCE, is_missing);
        assert!(!waited.unwrap().1.timed_out(), "no {wanted}");
    }
}

/// The longest wait for the printer.
const PATIENCE: WallDuration = WallDuration::from_secs(20);

impl Write for Said {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let (mutex, changed) = &*self.0;
        let written = mutex.lock().unwrap().write(bytes);
        changed.notify_all();
        written
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A valve at node ID 0x20, and two clients: a sender and a listener.
struct Rig {
    driver: Driver<Script>,
    start: WallInstant,
    sender: ClientId,
    listener: ClientId,
    client_end: ClientEnd,
    heard: Vec<(u64, Frame)>,
    _sender_end: ClientEnd,
    shown: Said,
    said: Said,
}

fn millis(millis: u64) -> WallDuration {
    WallDuration::from_millis(millis)
}

/// Returns the driver of a powered valve, after the events `before`.
fn driver(speed: f64, start: WallInstant, before: Vec<ToWorld>, stdout: Said, said: Said) -> Driver<Script> {
    let mut simulation = Simulation::new(BitRate::Kbit250, 1);
    simulation.add(&NamedDevice::new("valve", Kind::Pve(pve::Kind::PveaCanopen)), Memory::in_ram());
    let plan = before.into_iter().map(|message| (start, PlatformEvent::Message(message))).collect();
    let (work, awake) = (WallDuration::ZERO, WallDuration::ZERO);
    let script = Script { now: start, work, end: start, plan, waits: 0, awake };
    Driver::embedded(simulation, script, speed, stdout, said).unwrap()
}

impl Rig {
    fn new(speed: f64) -> Self {
        let (shown, said, start) = (Said::default(), Said::default(), WallInstant::now());
        let driver = driver(speed, start, Vec::new(), shown.clone(), said.clone());
        let (sender, listener) = (ClientId::next(), ClientId::next());
        let (to_client, client_end) = ClientQueue::new();
        let (sender_queue, _sender_end) = ClientQueue::new();
        let mut rig = Self { driver, start, sender, listener, client_end, heard: Vec::new(), _sender_end, shown, said };
        rig.plan(millis(0), PlatformEvent::Message(ToWorld::Join(sender, sender_queue)));
        rig.plan(millis(0), PlatformEvent::Message(ToWorld::Join(listener, to_client)));
        rig.plan(millis(0), PlatformEvent::Message(ToWorld::Listen(listener, Reply::new(""))));
        rig
    }

    fn plan(&mut self, at: WallDuration, event: PlatformEvent) {
        let at = self.start + at;
        let place = self.driver.platform.plan.partition_point(|(other, _)| *other <= at);
        self.driver.platform.plan.insert(place, (at, event));
    }

    fn send(&mut self, at: WallDuration, frame: &str) {
        let frame = frame.parse().expect("a frame");
        let sender = self.sender;
        self.plan(at, PlatformEvent::Message(ToWorld::Send(sender, frame)));
    }

    fn stall(&mut self, at: WallDuration, length: WallDuration) {
        self.plan(at, PlatformEvent::Stall(length));
    }

    /// Runs until a wall time.
    fn run_until(&mut self, end: WallDuration) {
        self.driver.platform.end = self.start + end;
        while !self.driver.platform.is_ending() {
            self.driver.turn();
            self.listen();
        }
    }

    /// Reads the listener's messages.
    fn listen(&mut self) {
        let micros = |at: Timestamp| at.to_string().replace('.', "").parse().expect("digits");
        while let Ok(message) = self.client_end.queue.try_recv() {
            if let ToClient::Frame(at, frame) = message {
                self.heard.push((micros(at), frame));
            }
        }
    }

    /// Returns the times of a frame on the bus, in microseconds.
    fn times_of(&self, wanted: &str) -> Vec<u64> {
        self.heard.iter().filter(|(_, frame)| frame.to_string() == wanted).map(|(at, _)| *at).collect()
    }

    /// Returns the frames with an identifier.
    fn frames_of(&self, id: &str) -> Vec<String> {
        self.heard.iter().map(|(_, frame)| frame.to_string()).filter(|frame| frame.starts_with(id)).collect()
    }

    /// Ends the run; returns the messages for the user.
    fn end(self) -> Vec<String> {
        self.driver.trace.finish();
        self.said.text().lines().map(str::to_owned).collect()
    }

    /// Boots the valve into ACTIVE within 100 ms, as in use case 1.
    fn activate(&mut self) {
        self.send(millis(20), "000: 01 00");
        for at in [40, 60, 80] {
            self.send(millis(at), SET_POINT);
        }
    }

    /// Returns whether the valve reported ACTIVE, and afterwards no other state.
    fn stayed_active(&self) -> bool {
        let states = self.frames_of("1A0:");
        let first = states.iter().position(|state| state.starts_with(ACTIVE)).expect("it was activated");
        states[first..].iter().all(|state| state.starts_with(ACTIVE))
    }
}

const SET_POINT: &str = "220: 0F 00 00 10";
const ACTIVE: &str = "1A0: 0F";
const READ: &str = "620: 40 00 10 00 00 00 00 00";

#[test]
fn a_frame_is_on_the_bus_when_it_was_sent() {
    for speed in [1.0, 0.25, 100.0] {
        let mut rig = Rig::new(speed);
        for seconds in [1, 11, 3600] {
            rig.send(WallDuration::from_secs(seconds), READ);
        }
        rig.run_until(WallDuration::from_secs(3601));
        let requests = rig.times_of(READ);
        for (seconds, at) in [1.0, 11.0, 3600.0].iter().zip(&requests) {
            let sent = (seconds * speed * 1e6) as u64;
            assert!((sent..sent + 1000).contains(at), "sent at {sent} µs, on the bus at {at} µs");
        }
        assert_eq!(requests.len(), 3);
    }
}

#[test]
fn an_answer_follows_its_request_after_hours_of_quiet() {
    let mut rig = Rig::new(1.0);
    rig.send(WallDuration::from_secs(7200), "620: 40 0A 10 00 00 00 00 00");
    for (number, at) in [(0, 2), (1, 4), (0, 6), (1, 8), (0, 10), (1, 12), (0, 14)] {
        let toggle = if number == 0 { "60" } else { "70" };
        rig.send(millis(7_200_000 + at), &format!("620: {toggle} 00 00 00 00 00 00 00"));
    }
    rig.run_until(WallDuration::from_secs(7201));
    let answers = rig.frames_of("5A0:");
    assert_eq!(answers.len(), 8, "{answers:?}");
    assert!(answers.iter().all(|answer| !answer.starts_with("5A0: 80")), "{answers:?}");
}

/// Time guarding allows 250 ms.
#[test]
fn set_points_up_to_240_ms_apart_keep_a_valve_active() {
    let mut rig = Rig::new(1.0);
    rig.activate();
    let mut at = 80;
    for period in (180..=240).cycle().take(600) {
        at += period;
        rig.send(millis(at), SET_POINT);
    }
    rig.run_until(millis(at + 1));
    assert!(rig.stayed_active());
}

#[test]
fn set_points_300_ms_apart_do_not() {
    let mut rig = Rig::new(1.0);
    rig.activate();
    rig.send(millis(380), SET_POINT);
    rig.run_until(millis(400));
    assert!(!rig.stayed_active());
}

#[test]
fn a_process_that_stands_still_is_no_master_that_does() {
    for (speed, stall) in [(1.0, 51), (1.0, 120), (1.0, 10_000), (0.5, 86_400_000)] {
        for offset in (0..200).step_by(7) {
            let mut rig = Rig::new(speed);
            rig.activate();
            let times = [280, 480, 680, 880 + stall, 1080 + stall, 1280 + stall];
            for at in times {
                rig.send(millis(at), SET_POINT);
            }
            rig.stall(millis(680 + offset), millis(stall));
            rig.run_until(millis(1300 + stall));
            assert!(rig.stayed_active(), "{stall} ms, {offset} ms after a set-point, at {speed}");
            let said = rig.end();
            assert!(said.len() == 1 && said[0].contains("the host stalled for"), "{said:?}");
        }
    }
}

/// A set-point sent during the pause is read afterwards.
#[test]
fn a_master_goes_on_while_the_process_stands_still() {
    let mut rig = Rig::new(1.0);
    rig.activate();
    for at in (280..3000).step_by(200) {
        rig.send(millis(at), SET_POINT);
    }
    for at in [500, 1000, 1500, 2000] {
        rig.stall(millis(at), millis(400));
    }
    rig.run_until(millis(3000));
    assert!(rig.stayed_active());
}

#[test]
fn what_is_no_pause_is_made_up_for() {
    let mut rig = Rig::new(1.0);
    for at in (100..10_000).step_by(100) {
        rig.stall(millis(at), millis(25));
    }
    rig.send(millis(10_000), READ);
    rig.run_until(millis(10_100));
    let at = rig.times_of(READ)[0];
    assert!((10_000_000..10_030_000).contains(&at), "{at} µs");
    assert_eq!(rig.end(), [""; 0]);
}

#[test]
fn above_the_speed_of_the_wall_clock_no_time_is_lost() {
    let mut rig = Rig::new(2.0);
    rig.stall(millis(100), WallDuration::from_secs(5));
    rig.send(WallDuration::from_secs(6), READ);
    rig.run_until(WallDuration::from_secs(7));
    let at = rig.times_of(READ)[0];
    assert!((12_000_000..12_001_000).contains(&at), "{at} µs");
    assert_eq!(rig.end(), [""; 0]);
}

#[test]
fn pauses_are_told_once_a_minute() {
    let mut rig = Rig::new(1.0);
    for second in [1, 2, 3, 70, 71, 140] {
        rig.stall(WallDuration::from_secs(second), millis(500));
    }
    rig.run_until(WallDuration::from_secs(150));
    let said = rig.end();
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(!said[0].contains("times"), "{said:?}");
    assert!(said[1].contains(" 3 times, 1.560 s in total;"), "{said:?}");
    assert!(said[2].contains(" 2 times, 1.040 s in total;"), "{said:?}");
}

/// A valve with heartbeats of 10 ms, at a speed that would need a billion of them per second.
#[test]
fn a_speed_that_cannot_be_reached_is_told_once_and_keeps_nobody_waiting() {
    let mut rig = Rig::new(1e7);
    rig.driver.platform.work = millis(5);
    rig.send(millis(0), "620: 2B 17 10 00 0A 00 00 00");
    rig.send(millis(1100), READ);
    rig.send(millis(1200), READ);
    rig.run_until(millis(1300));
    assert_eq!(rig.times_of(READ).len(), 2);
    let said = rig.end();
    assert_eq!(said, ["pve-sim: --speed 10000000 is too fast for this machine: virtual time runs as fast as possible"]);
}

/// The machine simulates 125 virtual seconds per second and pauses for 3 s: it takes 12 s to catch up.
#[test]
fn a_pause_does_not_prove_a_speed_out_of_reach() {
    let mut rig = Rig::new(100.0);
    rig.send(millis(0), "620: 2B 17 10 00 0A 00 00 00");
    rig.run_until(millis(100));
    rig.driver.platform.work = millis(40);
    rig.stall(millis(200), WallDuration::from_secs(3));
    rig.send(WallDuration::from_secs(19), READ);
    rig.run_until(WallDuration::from_secs(20));
    let at = rig.times_of(READ)[0];
    assert!((1_900_000_000..1_905_000_000).contains(&at), "{at} µs");
    assert_eq!(rig.end(), [""; 0]);
}

/// A controller at a different bit rate repeats its frame thousands of times a second.
#[test]
fn a_busy_bus_that_nobody_listens_to_wakes_nobody_up() {
    let mut rig = Rig::new(1.0);
    rig.send(millis(10), "620: 2B 17 10 00 01 00 00 00");
    rig.run_until(millis(20));
    rig.plan(millis(20), PlatformEvent::Message(ToWorld::Leave(rig.listener)));
    rig.run_until(millis(30));
    let before = rig.driver.platform.waits;
    rig.run_until(millis(10_030));
    let waits = rig.driver.platform.waits - before;
    assert!(waits < 600, "{waits} times in 10 s");
    assert!(rig.driver.simulation.world().now() > Instant::from_secs(10), "{:?}", rig.driver.simulation.world().now());
}

/// The bus counts nanoseconds in 64 bits, which a frame on the wire must not overrun.
#[test]
fn the_end_of_virtual_time_is_told_once() {
    for speed in [1e10, 1e300] {
        let mut rig = Rig::new(speed);
        for seconds in [1, 2, 3, 4] {
            rig.send(WallDuration::from_secs(seconds), READ);
        }
        rig.run_until(WallDuration::from_secs(5));
        let said = rig.end();
        let told = "pve-sim: virtual time reached its limit of 584 years: the bus has stopped";
        assert_eq!(said, [told], "{speed}");
    }
}

#[test]
fn a_speed_that_is_reached_is_not_complained_about() {
    let mut rig = Rig::new(1000.0);
    rig.send(millis(0), "620: 2B 17 10 00 0A 00 00 00");
    rig.run_until(WallDuration::from_millis(1200));
    assert_eq!(rig.end(), [""; 0]);
}

/// A network gateway joins before the world starts.
#[test]
fn who_has_joined_before_the_devices_start_hears_their_boot_up() {
    let (id, (to_client, mut client_end)) = (ClientId::next(), ClientQueue::new());
    let before = vec![ToWorld::Join(id, to_client), ToWorld::Listen(id, Reply::new(""))];
    let mut driver = driver(1.0, WallInstant::now(), before, Said::default(), Said::default());
    driver.turn();
    let heard: Vec<ToClient> = std::iter::from_fn(|| client_end.queue.try_recv().ok()).collect();
    let boot_up = "720: 00".parse::<Frame>().expect("a frame");
    assert!(heard.iter().any(|message| matches!(message, ToClient::Frame(_, frame) if *frame == boot_up)));
}

/// Supplies come up within 5 ms, which would be seconds at a thousandth of the speed.
#[test]
fn nobody_waits_for_devices_to_start() {
    let mut rig = Rig::new(0.001);
    rig.send(millis(0), READ);
    rig.run_until(millis(1));
    assert!(rig.driver.clients.is_heard());
    assert_eq!(rig.driver.arrivals.len(), 0);
    assert_eq!(rig.driver.simulation.world().now(), Instant::from_micros(5000));
}

#[test]
fn frames_wait_until_all_devices_have_started() {
    for speed in [0.001, 1.0, 1000.0] {
        let mut rig = Rig::new(speed);
        rig.send(millis(0), READ);
        rig.run_until(WallDuration::from_secs(20));
        let answers = rig.frames_of("5A0:");
        assert!(answers[0].starts_with("5A0: 43"), "{answers:?} at {speed}");
    }
}

#[test]
fn an_idle_world_is_looked_at_a_few_times_a_second() {
    let mut rig = Rig::new(1.0);
    rig.run_until(WallDuration::from_secs(100));
    assert!(rig.driver.platform.waits < 100 * 60, "{}", rig.driver.platform.waits);
}

/// Two messages wait at each clock reading.
#[test]
fn clients_that_keep_the_world_busy_hold_up_neither_trace_nor_log() {
    let mut rig = Rig::new(1.0);
    rig.driver.platform.work = millis(1);
    for at in 0..200 {
        rig.send(millis(at / 2), READ);
    }
    rig.run_until(millis(100));
    assert!(!rig.driver.platform.plan.is_empty() && rig.driver.platform.waits == 0, "it has been busy");
    rig.shown.wait_for("720#00");
}

/// At the end, a slow program stores without waiting for its next cycle; it would send its heartbeat too early.
#[test]
fn a_run_ends_without_frames_that_the_device_does_not_send() {
    let mut rig = Rig::new(1.0);
    rig.send(millis(10), "620: 2B 17 10 00 64 00 00 00");
    rig.plan(millis(20), control_tests::typed("cycle_ms 1000"));
    rig.run_until(millis(4500));
    let heartbeats = rig.frames_of("720: 7F").len();
    assert!((3..6).contains(&heartbeats), "{heartbeats}");
    assert!(rig.driver.finish());
    assert_eq!(rig.shown.text().matches("720#7F").count(), heartbeats);
}

/// 100 requests with answers: the thread wakes up in time for two frames each.
#[test]
fn at_speed_1_a_client_at_work_lets_the_machine_sleep() {
    let mut rig = Rig::new(1.0);
    for at in (20..1020).step_by(10) {
        rig.send(millis(at), READ);
    }
    rig.run_until(millis(1020));
    let awake = rig.driver.platform.awake;
    assert!(awake < millis(12), "awake for {awake:?} of a second");
    assert_eq!(rig.frames_of("5A0:").len(), 100);
}
