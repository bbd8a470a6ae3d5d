//! The runtime with an application that has one timer, a fault log and one answer.

use super::super::fault_log::FAULT_LOG_INTERVAL;
use super::*;
use crate::memory::Image;
use crate::memory::seal;
use crate::time::{Duration, after};

const MS: Duration = Duration::from_millis(1);

const SAVE: Write = Write::new(RecordKey::Parameters, Requester::Sdo);

/// A write that the application does not list.
const UNLISTED: Write = Write::new(RecordKey::Parameters, Requester::Uds);

/// An application controlled by the first byte of a frame: 1 saves, 2 counts a fault, 3 requests an unlisted write, 4
/// starts a timer due at once, 0x81 and 0x82 reset.
struct Obedient {
    beat: Instant,
    polled: heapless::Vec<Instant, 8>,
    /// Whether the last poll found an internal fault.
    found_fault: bool,
    pending: bool,
    starts: heapless::Vec<Restart, 8>,
    saved: Option<bool>,
    inputs: Inputs,
}

const fn demanded(frame: &Frame) -> Option<Restart> {
    match frame.bytes()[0] {
        0x81 => Some(Restart::Application),
        0x82 => Some(Restart::Communication),
        _ => None,
    }
}

impl Storing for Obedient {
    fn encode(&mut self, _: Write, _: &mut VecView<u8>) -> Option<()> {
        Some(())
    }

    fn written(&mut self, write: Write, stored: bool, _: &mut Base) {
        if write == SAVE {
            self.saved = Some(stored);
        }
    }
}

impl Application for Obedient {
    type Setup = Self;
    type Service = ();

    const FAULT_LOG: bool = true;
    const RECORD_VERSION: u8 = 1;
    const WRITES: &'static [Write] = &[SAVE];

    fn new(setup: Self) -> Self {
        setup
    }

    fn service(&self, frame: &Frame) -> Option<()> {
        (frame.key() == 0).then_some(())
    }

    fn handle(&mut self, (): (), frame: &Frame, base: &mut Base) {
        match frame.bytes()[0] {
            1 => base.writes.request(SAVE),
            2 => base.fault_log.changed(base.now()),
            3 => base.writes.request(UNLISTED),
            4 => self.beat = base.now(),
            _ => {}
        }
        if let Some(scope) = demanded(frame) {
            base.request_restart(scope);
        }
    }

    fn handle_restarting(&mut self, (): (), frame: &Frame, base: &mut Base) {
        if let Some(scope) = demanded(frame) {
            base.request_restart(scope);
        }
    }

    fn poll(&mut self, base: &mut Base) {
        if base.now() >= self.beat {
            self.polled.push(base.now()).unwrap();
            self.found_fault = self.inputs.internal_fault;
            self.beat = after(self.beat, Duration::from_millis(100));
        }
    }

    fn apply_changes(&mut self, _: &mut Base) {}

    fn deadline(&self) -> Instant {
        self.beat
    }

    fn sense(&mut self, inputs: &Inputs, _: &mut Base) {
        self.inputs = *inputs;
    }

    fn take_filters(&mut self) -> Option<Filters> {
        None
    }

    fn take_abort(&mut self) -> Option<Filter> {
        None
    }

    fn next_frame(&mut self, _: Instant) -> Option<Frame> {
        core::mem::take(&mut self.pending).then(|| "701: 05".parse().unwrap())
    }

    fn give_back(&mut self, _: Frame) {
        self.pending = true;
    }

    fn all_sent(&mut self, _: &mut Base) -> bool {
        true
    }

    fn sent_except(&mut self, _: &dyn Fn(Filter) -> bool, _: &mut Base) -> bool {
        true
    }

    fn has_frame(&self) -> bool {
        self.pending
    }

    fn take_bit_rate(&mut self) -> Option<BitRate> {
        None
    }

    fn start(&mut self, scope: Restart, _: &dyn Memory, base: &mut Base) {
        self.starts.push(scope).unwrap();
        self.beat = after(base.now(), Duration::from_millis(100));
    }

    fn watchdog_reset(&mut self, _: &mut Base) {}

    fn outputs(&self) -> Outputs {
        Outputs::Encoder
    }

    fn bit_rate(&self) -> BitRate {
        BitRate::Kbit250
    }

    fn node_id(&self) -> Option<u8> {
        None
    }

    fn frames_dropped(&self) -> u32 {
        0
    }
}

const START: Instant = Instant::from_secs(1);

fn started() -> Runtime<Obedient> {
    let mut runtime = Runtime::new(Obedient {
        beat: NEVER,
        polled: heapless::Vec::new(),
        found_fault: false,
        pending: false,
        starts: heapless::Vec::new(),
        saved: None,
        inputs: Inputs::default(),
    });
    runtime.start_up(&Image::empty(), StartCause::PowerOn, START);
    runtime
}

fn tell(runtime: &mut Runtime<Obedient>, byte: &str, now: Instant) {
    assert!(runtime.handle(&format_frame(byte), now));
}

fn format_frame(byte: &str) -> Frame {
    let mut text = heapless::String::<8>::new();
    text.push_str("000: ").unwrap();
    text.push_str(byte).unwrap();
    text.parse().unwrap()
}

fn store(key: RecordKey) -> Option<Effect> {
    Some(Effect::Store(key, seal(1, &[]).unwrap()))
}

#[test]
fn time_never_runs_back() {
    let mut runtime = started();
    runtime.poll(after(START, Duration::from_millis(100)));
    tell(&mut runtime, "2", START);
    assert_eq!(runtime.base.now(), after(START, Duration::from_millis(100)));
    // A fault counted at an earlier time counts as of the last time.
    assert_eq!(runtime.base.fault_log.due(), after(START, Duration::from_millis(600)));
}

#[test]
fn what_is_due_acts_before_a_frame_that_comes_later() {
    let mut runtime = started();
    tell(&mut runtime, "1", after(START, Duration::from_millis(150)));
    assert_eq!(runtime.application().polled, [after(START, Duration::from_millis(150))]);
    assert_eq!(runtime.deadline(), after(START, Duration::from_millis(200)));
}

#[test]
fn what_a_frame_makes_due_at_once_acts_at_once() {
    let mut runtime = started();
    tell(&mut runtime, "4", START);
    assert_eq!(runtime.application().polled, [START]);
    assert_eq!(runtime.deadline(), after(START, Duration::from_millis(100)));
}

/// A deadline before `now` is handled with the old inputs, a deadline at `now` with the new inputs.
#[test]
fn what_was_due_before_new_senses_acts_on_the_old_ones() {
    for (at, on_new) in [(100, true), (101, false)] {
        let mut runtime = started();
        runtime.sense(&Inputs { internal_fault: true, ..Inputs::default() }, after(START, Duration::from_millis(at)));
        assert_eq!((runtime.application().polled.len(), runtime.application().found_fault), (1, on_new), "{at} ms");
    }
}

#[test]
fn a_restart_waits_for_writes_and_for_the_bus() {
    let mut runtime = started();
    tell(&mut runtime, "1", START);
    tell(&mut runtime, "82", START);
    assert_eq!(runtime.deadline(), after(START, Duration::from_millis(100)), "its timers go on");
    assert_eq!(runtime.next_effect(true), store(RecordKey::Parameters));
    assert_eq!(runtime.next_effect(true), None);
    runtime.stored(RecordKey::Parameters, Ok(()), START);
    assert_eq!(runtime.application().saved, Some(true));
    assert_eq!(runtime.next_effect(false), None);
    assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Communication)));
    assert_eq!(runtime.next_effect(true), None, "handed out once");
    tell(&mut runtime, "1", START);
    assert_eq!(runtime.next_effect(true), None, "it takes no frames before it is carried out");
    runtime.restart(Restart::Communication, &Image::empty(), START);
    assert_eq!(runtime.application().starts, [Restart::Application, Restart::Communication]);
    assert!(!runtime.base.is_restarting());
}

#[test]
fn the_wider_of_two_restarts_counts() {
    for orders in [["82", "81"], ["81", "82"]] {
        let mut runtime = started();
        for order in orders {
            tell(&mut runtime, order, START);
        }
        assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Application)), "{orders:?}");
    }
}

#[test]
fn a_restart_that_is_demanded_while_one_is_carried_out_follows_it() {
    let mut runtime = started();
    tell(&mut runtime, "82", START);
    assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Communication)));
    tell(&mut runtime, "81", START);
    assert_eq!(runtime.next_effect(true), None);
    runtime.restart(Restart::Communication, &Image::empty(), START);
    assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Application)));
    runtime.restart(Restart::Application, &Image::empty(), START);
    assert_eq!(runtime.next_effect(true), None);
}

#[test]
fn the_fault_log_is_written_before_a_restart_and_tried_once() {
    for works in [true, false] {
        let mut runtime = started();
        tell(&mut runtime, "2", START);
        tell(&mut runtime, "81", START);
        assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
        runtime.stored(RecordKey::FaultLog, if works { Ok(()) } else { Err(StoreError) }, START);
        assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Application)));
    }
}

/// Reset communication keeps the counters, so their log must still be written; reset application reads them from the
/// memory.
#[test]
fn a_fault_log_that_failed_before_a_restart() {
    let retried = after(START, FAULT_LOG_INTERVAL);
    for (order, scope, effect) in
        [("82", Restart::Communication, store(RecordKey::FaultLog)), ("81", Restart::Application, None)]
    {
        let mut runtime = started();
        tell(&mut runtime, "2", START);
        tell(&mut runtime, order, START);
        assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
        runtime.stored(RecordKey::FaultLog, Err(StoreError), START);
        assert_eq!(runtime.next_effect(true), Some(Effect::Restart(scope)));
        runtime.restart(scope, &Image::empty(), START);
        runtime.poll(retried);
        assert_eq!(runtime.next_effect(true), effect, "{scope:?}");
    }
}

/// A fault log write in flight when the restart is requested is repeated if it fails.
#[test]
fn a_fault_log_that_fails_just_before_a_restart_is_tried_again() {
    let mut runtime = started();
    tell(&mut runtime, "2", START);
    runtime.flush(START);
    assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
    tell(&mut runtime, "81", START);
    runtime.stored(RecordKey::FaultLog, Err(StoreError), START);
    assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
    runtime.stored(RecordKey::FaultLog, Err(StoreError), START);
    assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Application)), "and once alone");
}

/// A fault counted during the last write before a restart is written too.
#[test]
fn a_count_during_the_last_write_is_not_lost() {
    let mut runtime = started();
    tell(&mut runtime, "1", START);
    assert_eq!(runtime.next_effect(true), store(RecordKey::Parameters));
    tell(&mut runtime, "81", START);
    runtime.base.fault_log.changed(START);
    runtime.stored(RecordKey::Parameters, Ok(()), START);
    assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
    runtime.stored(RecordKey::FaultLog, Ok(()), START);
    assert_eq!(runtime.next_effect(true), Some(Effect::Restart(Restart::Application)));
}

#[test]
fn a_flush_writes_the_log_at_once() {
    let mut runtime = started();
    tell(&mut runtime, "2", START);
    assert_eq!(runtime.next_effect(true), None);
    runtime.flush(after(START, MS));
    assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
    assert_eq!(runtime.deadline(), after(START, Duration::from_millis(100)));
}

#[test]
fn a_failed_log_is_tried_again_after_the_interval() {
    let mut runtime = started();
    tell(&mut runtime, "2", START);
    runtime.poll(after(START, Duration::from_millis(500)));
    assert_eq!(runtime.next_effect(true), store(RecordKey::FaultLog));
    let failed = after(START, Duration::from_millis(520));
    runtime.stored(RecordKey::FaultLog, Err(StoreError), failed);
    assert_eq!(runtime.base.fault_log.due(), after(failed, FAULT_LOG_INTERVAL));
}

/// The queue reserves places for the listed kinds only.
#[test]
#[should_panic(expected = "`Application::WRITES`")]
fn a_write_that_is_not_listed_is_found_by_every_test_that_asks_for_it() {
    let mut runtime = started();
    tell(&mut runtime, "3", START);
    runtime.next_effect(true);
}
