//! The reported error frames, event by event.

use super::*;

const GATEWAY: &str = "the gateway";
const VALVE: &str = "valve";

fn event(micros: u64, who: &str, what: EventKind) -> Event {
    Event { at: Instant::from_micros(micros), who: who.into(), what }
}

fn frame(text: &str) -> Frame {
    text.parse().expect("a frame")
}

fn failed(micros: u64, who: &str, text: &str) -> Event {
    let start = Instant::from_micros(micros);
    let what = EventKind::ErrorFrame { frame: frame(text), start, error: BusError::Bit, signalled_by: VALVE.into() };
    event(micros, who, what)
}

fn sent(micros: u64, who: &str, text: &str) -> Event {
    event(micros, who, EventKind::Frame { frame: frame(text), start: Instant::from_micros(micros) })
}

fn mode(micros: u64, who: &str, from: BusErrorMode, to: BusErrorMode) -> Event {
    event(micros, who, EventKind::ErrorMode { from, to })
}

/// Returns the reports of events, one per line.
fn told(events: impl IntoIterator<Item = Event>) -> Vec<String> {
    let mut errors = Errors::default();
    let lines = events.into_iter().filter_map(|event| errors.note(&event));
    lines.map(|(class, text)| format!("{:?} {text}", class.expect("an error"))).collect()
}

#[test]
fn of_a_frame_that_nobody_takes_only_the_first_error_frame_is_told() {
    let events = (0..5000).map(|number| failed(number * 200, GATEWAY, "123: 01"));
    assert_eq!(told(events), ["BusError error frame: bit error in 123: 01 from the gateway"]);
}

#[test]
fn each_change_of_a_mode_is_told_with_what_led_to_it() {
    use BusErrorMode::{BusOff, ErrorActive, ErrorPassive};
    let mut events: Vec<Event> = (0..16).map(|number| failed(number * 200, GATEWAY, "123: 01")).collect();
    events.push(mode(3000, GATEWAY, ErrorActive, ErrorPassive));
    events.extend((16..32).map(|number| failed(number * 200, GATEWAY, "123: 01")));
    events.push(mode(6400, GATEWAY, ErrorPassive, BusOff));
    events.push(mode(12_000, GATEWAY, BusOff, ErrorActive));
    events.push(mode(13_000, VALVE, ErrorActive, ErrorPassive));
    events.push(sent(14_000, GATEWAY, "123: 01"));
    events.push(mode(15_000, VALVE, ErrorPassive, ErrorActive));
    assert_eq!(
        told(events),
        [
            "BusError error frame: bit error in 123: 01 from the gateway",
            "ErrorPassive the gateway: error-passive (16 error frames so far)",
            "BusOff the gateway: bus-off, was error-passive for 3.400 ms (32 error frames so far)",
            "Restarted the gateway: error-active, was bus-off for 5.600 ms (32 error frames so far)",
            "ErrorPassive valve: error-passive (32 error frames so far)",
            "ErrorActive valve: error-active, was error-passive for 2.000 ms (32 error frames so far)",
        ]
    );
}

#[test]
fn an_error_frame_of_something_else_is_told_again() {
    let first = [failed(0, GATEWAY, "123: 01"), failed(200, VALVE, "720: 05"), failed(400, GATEWAY, "123: 01")];
    assert_eq!(told(first).len(), 2, "each sender has its own");
    let other = [failed(0, GATEWAY, "123: 01"), failed(200, GATEWAY, "100: 01")];
    assert_eq!(told(other).len(), 2, "another frame");
    let after_success = [failed(0, GATEWAY, "123: 01"), sent(200, GATEWAY, "123: 01"), failed(400, GATEWAY, "123: 01")];
    assert_eq!(told(after_success).len(), 2, "one that was sent in between");
    let later = [failed(0, GATEWAY, "123: 01"), failed(1_000_001, GATEWAY, "123: 01")];
    assert_eq!(told(later).len(), 2, "after more than a second");
}

#[test]
fn dropped_frames_are_told() {
    let event = event(0, VALVE, EventKind::FramesDropped { count: 3 });
    assert_eq!(told([event]), ["TransmitOverflow valve: dropped 3 pending frames"]);
}
