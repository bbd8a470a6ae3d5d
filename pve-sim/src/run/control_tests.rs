//! Calls of the control interface, on a wall clock that advances only while the driver waits.

use tokio::sync::oneshot::{self, Receiver, error::TryRecvError};

use super::*;
use crate::control::{Answer, LAST, Message};
use hal_sim::simulation::{Command, Refusal, Reply};

/// The receiver of an answer.
type Way<T> = Receiver<Result<T, Refusal>>;

impl Rig {
    fn with_desk(speed: f64) -> Self {
        let mut rig = Self::new(speed);
        rig.driver.control = Some(ControlServer::new(Speed::Factor(speed), None, &mut rig.driver.simulation));
        rig
    }

    /// Makes a call at a wall time.
    fn call<T>(&mut self, at: WallDuration, message: impl FnOnce(Answer<T>) -> Message) -> Way<T> {
        let (answer, way) = oneshot::channel();
        self.plan(at, PlatformEvent::Message(ToWorld::Control(message(answer))));
        way
    }

    /// Makes a call with a body in the form of clients.
    fn change(&mut self, at: WallDuration, change: &str) -> Way<Reply> {
        let change = serde_json::from_str(change).expect("a change");
        self.call(at, |answer| Message::Execute(Command::Plant("valve".to_owned(), change), answer))
    }

    fn wait_for(&mut self, at: WallDuration, state: &str, within: u64) -> Way<Reply> {
        let condition = Box::new(serde_json::from_str(state).expect("a condition"));
        let condition = hal_sim::state::Condition::State("valve".to_owned(), condition);
        let within = protocol_core::time::Duration::from_millis(within);
        self.call(at, |answer| Message::Execute(Command::Wait(condition, within), answer))
    }
}

pub(super) fn typed(line: &str) -> PlatformEvent {
    PlatformEvent::Message(ToWorld::Typed(line.to_owned(), oneshot::channel().0))
}

fn told<T: serde::Serialize>(mut way: Way<T>) -> serde_json::Value {
    match way.try_recv() {
        Ok(Ok(answer)) => serde_json::to_value(answer).expect("JSON"),
        Ok(Err(Refusal::TimedOut(timed_out))) => serde_json::to_value(timed_out).expect("JSON"),
        Ok(Err(refusal)) => panic!("{refusal}"),
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn a_call_takes_effect_at_its_own_instant() {
    for speed in [1.0, 0.25, 100.0] {
        let mut rig = Rig::with_desk(speed);
        let micros = |wall: u64| (wall as f64 * 1e3 * speed) as u64;
        let time = rig.call(millis(1000), Message::Time);
        let low = rig.change(millis(1500), r#"{"supply_mv": 8000}"#);
        let fault = rig.wait_for(millis(1600), r#"{"faults": ["supply-low"]}"#, 60_000);
        let never = rig.wait_for(millis(1600), r#"{"nmt": "stopped"}"#, 60_000);
        rig.run_until(millis(1700 + (61_000.0 / speed) as u64));
        assert_eq!(told(time)["now_us"], micros(1000));
        assert_eq!(told(low)["t_us"], micros(1500));
        assert_eq!(told(fault)["t_us"], (micros(1500) + 2_000_000).max(micros(1600)), "at {speed}");
        assert_eq!(told(never)["t_us"], micros(1600) + 60_000_000, "at {speed}");
    }
}

#[test]
fn calls_are_answered_however_slow_time_is() {
    let mut rig = Rig::with_desk(0.0001);
    rig.send(millis(0), READ);
    let time = rig.call(millis(1), Message::Time);
    let valve = rig.call(millis(1), |answer| Message::Device("valve".to_owned(), answer));
    rig.run_until(millis(2));
    assert_eq!(told(time)["now_us"], 5000);
    assert_eq!(told(valve)["powered"], true);
}

/// A stall does not advance virtual time, for waits or for cyclic frames.
#[test]
fn a_stall_moves_no_stamp() {
    let mut rig = Rig::with_desk(1.0);
    let frame: Frame = "100: 01".parse().expect("a frame");
    let period = Some(protocol_core::time::Duration::from_millis(20));
    let sent = rig.call(millis(100), |answer| Message::Execute(Command::Send(frame, period), answer));
    let waited = rig.wait_for(millis(200), r#"{"powered": false}"#, 1_000);
    rig.stall(millis(500), WallDuration::from_secs(10));
    rig.run_until(WallDuration::from_secs(15));
    let first = told(sent)["t_us"].as_u64().expect("a time");
    let times = rig.times_of("100: 01");
    assert!(times.len() > 200 && times.iter().all(|at| (at - first).is_multiple_of(20_000)), "{times:?}");
    assert_eq!(told(waited)["t_us"], 1_200_000);
}

#[test]
fn what_is_typed_and_what_is_called_change_the_same_plant() {
    let mut rig = Rig::with_desk(1.0);
    let called = rig.change(millis(100), r#"{"memory": "write-fails", "bus_off": true, "lever": 5}"#);
    rig.plan(millis(200), typed("supply_mv 8000"));
    let both = rig.call(millis(300), |answer| Message::Device("valve".to_owned(), answer));
    rig.run_until(millis(400));
    assert_eq!(told(called)["plant"]["supply_mv"], 24_000);
    let plant = told(both)["plant"].clone();
    let expected = serde_json::json!({
        "supply_mv": 8000, "temperature_c": 25, "spool": {"fault": null}, "lever": 5,
        "internal_fault": false, "memory": "write-fails", "bus_off": true,
        "brown_out_mv": null, "oil": false, "boot_ms": 0, "answer_ms": 0, "cycle_ms": 0
    });
    assert_eq!(plant, expected);
}

/// A plant change on stdin completes waits at that instant, like a change by a call.
#[test]
fn what_is_typed_is_what_is_waited_for() {
    let mut rig = Rig::with_desk(1.0);
    let waited = rig.wait_for(millis(100), r#"{"faults": ["can-bus"]}"#, 5_000);
    rig.plan(millis(200), typed("bus_off on"));
    rig.run_until(millis(6000));
    assert_eq!(told(waited)["t_us"], 200_000);
}

/// Clients that are gone are dropped, and a simulator without a control interface has no answers.
#[test]
fn nobody_is_kept_in_mind() {
    let mut rig = Rig::with_desk(1.0);
    drop(rig.wait_for(millis(100), r#"{"powered": false}"#, u64::from(u32::MAX)));
    rig.run_until(millis(300));
    assert!(!rig.driver.simulation.is_busy());
    let mut rig = Rig::new(1.0);
    let mut time = rig.call(millis(100), Message::Time);
    rig.run_until(millis(200));
    assert_eq!(time.try_recv().err(), Some(TryRecvError::Closed));
}

/// A call that would end after the limit of virtual time is refused, instead of never being answered.
#[test]
fn at_the_end_of_virtual_time_every_call_is_answered() {
    let refusal = |mut way: Way<Reply>| match way.try_recv() {
        Ok(Err(Refusal::Conflict(reason))) => reason,
        other => panic!("{other:?}"),
    };
    let frame: Frame = "100: 01".parse().expect("a frame");
    let millisecond = protocol_core::time::Duration::from_millis(1);
    for (speed, before) in [(Speed::STEP, 500_000), (Speed::Factor(1e12), 0)] {
        let mut rig = Rig::with_desk(speed.factor());
        rig.driver.is_stepped = speed == Speed::STEP;
        rig.driver.control = Some(ControlServer::new(speed, None, &mut rig.driver.simulation));
        rig.driver.simulation.run_until(LAST - protocol_core::time::Duration::from_micros(before));
        let sent = rig.call(millis(5000), |answer| Message::Execute(Command::Send(frame, None), answer));
        let late = rig.wait_for(millis(5000), r#"{"powered": false}"#, 1 + before / 1000);
        let last = rig.wait_for(millis(5000), r#"{"powered": false}"#, before / 1000);
        let now = rig.wait_for(millis(5001), r#"{"powered": true}"#, 0);
        rig.run_until(millis(5010));
        assert_eq!(told(last)["t_us"], LAST.as_micros(), "{speed}");
        assert_eq!(told(now)["t_us"], LAST.as_micros(), "{speed}");
        for way in [sent, late] {
            assert_eq!(refusal(way), "virtual time reached its limit of 584 years", "{speed}");
        }
        if speed == Speed::STEP {
            let step = rig.call(millis(5020), |answer| Message::Execute(Command::Advance(millisecond), answer));
            rig.run_until(millis(5030));
            assert_eq!(refusal(step), "virtual time reached its limit of 584 years");
        }
    }
}
