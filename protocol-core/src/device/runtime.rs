//! The runtime, which implements [`Device`] for all applications.
//!
//! An [`Application`] combines the node of a protocol with a product. The runtime keeps the time monotonic, polls the
//! application at its deadlines, hands out its writes one by one, and executes its restarts.

use heapless::VecView;

use super::fault_log::FaultLogClock;
use super::reading::Reading;
use super::writes::{KINDS, Requester, Write, Writes};
use super::{Device, Effect, Inputs, Outputs, Restart, StartCause};
use crate::controller::{BitRate, Filter, Filters};
use crate::frame::Frame;
use crate::memory::{self, Memory, RecordKey, StoreError};
use crate::time::{Instant, NEVER, latest};

/// The kinds of write that a device requests by itself: the records that a new memory lacks, and the fault log.
const OWN_WRITES: [Write; 3] = [
    Write::new(RecordKey::Factory, Requester::Device),
    Write::new(RecordKey::LocalLayer, Requester::Device),
    Write::new(RecordKey::FaultLog, Requester::Device),
];

/// Encodes the payloads of records, and handles the results of their writes.
pub trait Storing {
    /// Appends the payload of a write, with the present state. Returns `None` for a record that the product does not
    /// have, and for a payload that does not fit a record.
    fn encode(&mut self, write: Write, payload: &mut VecView<u8>) -> Option<()>;

    /// Handles the result of a write.
    fn written(&mut self, write: Write, stored: bool, base: &mut Base);
}

/// The node of a protocol, combined with a product.
///
/// The time of every call is [`Base::now`]. All earlier deadlines have been handled.
pub trait Application: Storing + Sized {
    /// The setup of a device.
    type Setup;
    /// The services that receive frames.
    type Service: Copy;

    /// Whether the device keeps a fault log.
    const FAULT_LOG: bool;
    /// The payload version of the records.
    const RECORD_VERSION: u8;
    /// The product's kinds of write, each a pair of record and requester. The queue has room for a write of each kind.
    const WRITES: &'static [Write];

    /// Creates an application without power.
    fn new(setup: Self::Setup) -> Self;

    /// Returns the service that handles a frame; `None` for most frames, after a few instructions.
    fn service(&self, frame: &Frame) -> Option<Self::Service>;

    /// Handles a frame for a service.
    fn handle(&mut self, service: Self::Service, frame: &Frame, base: &mut Base);

    /// Handles a frame for a service while a restart is pending. Most frames are ignored then.
    fn handle_restarting(&mut self, service: Self::Service, frame: &Frame, base: &mut Base);

    /// Handles the timers that are due.
    fn poll(&mut self, base: &mut Base);

    /// Applies the changes that the preceding call has caused. The runtime calls this function after every other call,
    /// before it reads the deadline.
    fn apply_changes(&mut self, base: &mut Base);

    /// Returns the time at which [`poll`](Self::poll) is next due.
    fn deadline(&self) -> Instant;

    /// Updates the inputs of the device.
    fn sense(&mut self, inputs: &Inputs, base: &mut Base);

    /// See [`Device::take_filters`].
    fn take_filters(&mut self) -> Option<Filters>;

    /// See [`Device::take_abort`].
    fn take_abort(&mut self) -> Option<Filter>;

    /// See [`Device::next_frame`].
    fn next_frame(&mut self, now: Instant) -> Option<Frame>;

    /// See [`Device::give_back`].
    fn give_back(&mut self, frame: Frame);

    /// Records that the controller has sent all its frames. Returns whether the call can change more than the pending
    /// frames, such as the deadline.
    fn all_sent(&mut self, base: &mut Base) -> bool;

    /// See [`Device::sent_except`]. Returns what [`all_sent`](Self::all_sent) returns.
    fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, base: &mut Base) -> bool;

    /// Returns whether a pending frame may be sent now.
    fn has_frame(&self) -> bool;

    /// Returns a new bit rate, once.
    fn take_bit_rate(&mut self) -> Option<BitRate>;

    /// Starts with the contents of the memory, at power-up or for a restart. With [`Restart::Application`], no write is
    /// pending.
    fn start(&mut self, scope: Restart, memory: &dyn Memory, base: &mut Base);

    /// Handles a reset of the processor by the watchdog or a panic.
    fn watchdog_reset(&mut self, base: &mut Base);

    /// See [`Device::outputs`].
    fn outputs(&self) -> Outputs;

    /// See [`Device::bit_rate`].
    fn bit_rate(&self) -> BitRate;

    /// See [`Device::node_id`].
    fn node_id(&self) -> Option<u8>;

    /// See [`Device::frames_dropped`].
    fn frames_dropped(&self) -> u32;
}

/// The state that all devices have.
#[derive(Clone, Debug)]
pub struct Base {
    now: Instant,
    /// The writes to the memory.
    pub writes: Writes,
    /// The schedule of the fault log.
    pub fault_log: FaultLogClock,
    restart: PendingRestart,
}

/// The state of the pending restart.
#[derive(Clone, Debug, Default)]
struct PendingRestart {
    /// The pending restart. It waits until all writes have ended and all frames have been sent.
    wanted: Option<Restart>,
    /// Whether the platform is executing a restart.
    handed_out: bool,
    /// Whether the restart has caused the write of the fault log that is in progress.
    log_begun: bool,
    /// Set once the write of the fault log before the restart has failed. The failed write is not repeated.
    log_failed: bool,
}

impl PendingRestart {
    /// Returns whether a restart is pending and the platform is executing none.
    const fn is_due(&self) -> bool {
        self.wanted.is_some() && !self.handed_out
    }
}

impl Base {
    /// Returns the present time.
    #[inline]
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Advances the time, never backwards.
    fn go_to(&mut self, now: Instant) {
        self.now = latest(self.now, now);
    }

    /// Requests a restart. Until the restart, [`Application::handle_restarting`] handles the frames, and all timers
    /// keep running, including the time guard (A). Of two requests the wider scope wins.
    pub fn request_restart(&mut self, scope: Restart) {
        self.restart.wanted = self.restart.wanted.max(Some(scope));
        self.restart.log_begun = false;
        self.restart.log_failed = false;
    }

    /// Returns whether a restart is pending or being executed.
    #[inline]
    #[must_use]
    pub const fn is_restarting(&self) -> bool {
        self.restart.wanted.is_some() || self.restart.handed_out
    }

    /// Requests the writes of the records that a new memory lacks.
    pub fn fill(&mut self, reading: &Reading<'_>) {
        for record in [RecordKey::Factory, RecordKey::LocalLayer] {
            if reading.is_absent(record) {
                self.writes.request(Write::new(record, Requester::Device));
            }
        }
    }

    fn store_fault_log(&mut self) {
        self.writes.request(Write::new(RecordKey::FaultLog, Requester::Device));
        self.fault_log.begun();
    }

    /// Begins the next write. A changed fault log is written before a restart (A), so that no count is lost.
    fn begin_write(&mut self) -> Option<Write> {
        let restart = &self.restart;
        if restart.is_due() && !restart.log_failed && self.fault_log.is_dirty() && self.writes.is_idle() {
            self.store_fault_log();
        }
        let write = self.writes.begin()?;
        if write.record == RecordKey::FaultLog {
            let is_clearing = write.requester != Requester::Device;
            self.restart.log_begun = self.restart.is_due() && !is_clearing;
            if is_clearing { self.fault_log.clearing() } else { self.fault_log.begun() }
        }
        Some(write)
    }

    /// Returns the next write or, without a waiting write, the restart.
    // `inline(never)` saves 9 instructions on each answer of the core alone.
    #[inline(never)]
    fn next_effect(&mut self, application: &mut dyn Storing, version: u8, all_sent: bool) -> Option<Effect> {
        while let Some(write) = self.begin_write() {
            let mut record = memory::begin(version);
            if application.encode(write, &mut record).is_some() && memory::complete(&mut record).is_ok() {
                return Some(Effect::Store(write.record, record));
            }
            // Cannot happen, because all payloads fit a record.
            self.end_write(application, write.record, false);
        }
        self.begin_restart(all_sent).map(Effect::Restart)
    }

    /// Ends the write in progress with its result. A result for another record is ignored.
    fn end_write(&mut self, application: &mut dyn Storing, record: RecordKey, stored: bool) {
        let Some(write) = self.writes.end(record) else { return };
        if record == RecordKey::FaultLog {
            self.restart.log_failed |= self.restart.log_begun && !stored;
            if write.requester == Requester::Device || !stored {
                self.fault_log.ended(stored, self.now);
            }
        }
        application.written(write, stored, self);
    }

    /// Returns the pending restart once no write and no unsent frame delays it.
    fn begin_restart(&mut self, all_sent: bool) -> Option<Restart> {
        let scope = self.restart.wanted.filter(|_| self.restart.is_due() && all_sent && self.writes.is_idle())?;
        self.restart = PendingRestart { handed_out: true, ..PendingRestart::default() };
        Some(scope)
    }
}

/// A device: an application and its [`Base`].
#[derive(Clone, Debug)]
pub struct Runtime<A: Application> {
    application: A,
    base: Base,
    /// The deadline of the application or of the fault log, whichever is earlier.
    deadline: Instant,
}

impl<A: Application> Runtime<A> {
    /// Creates a device and powers it up with the contents of the memory.
    #[must_use]
    pub fn power_on(setup: A::Setup, memory: &dyn Memory, cause: StartCause, now: Instant) -> Self {
        let mut device = Self::new(setup);
        device.start_up(memory, cause, now);
        device
    }

    /// Creates a device without power. A platform with a small stack moves the device to its final place before the
    /// [start](Self::start_up).
    #[must_use]
    pub fn new(setup: A::Setup) -> Self {
        const { assert!(A::WRITES.len() + OWN_WRITES.len() <= KINDS, "`KINDS` is too small for this device") };
        let base = Base {
            now: Instant::MIN,
            writes: Writes::new(),
            fault_log: FaultLogClock::new(),
            restart: PendingRestart::default(),
        };
        Self { application: A::new(setup), base, deadline: NEVER }
    }

    /// Powers up a new device with the contents of the memory.
    pub fn start_up(&mut self, memory: &dyn Memory, cause: StartCause, now: Instant) {
        self.base.now = latest(Instant::MIN, now);
        self.application.start(Restart::Application, memory, &mut self.base);
        if cause == StartCause::Watchdog {
            self.application.watchdog_reset(&mut self.base);
        }
        self.finish();
    }

    /// Returns the application.
    pub const fn application(&self) -> &A {
        &self.application
    }

    /// Handles a frame for a service.
    // `inline(never)` saves 49 instructions on a frame for another node, and 388 bytes of the core alone.
    #[inline(never)]
    fn take(&mut self, frame: &Frame, now: Instant, service: A::Service) {
        if self.base.is_restarting() {
            return self.take_restarting(frame, now, service);
        }
        self.advance(now);
        self.application.handle(service, frame, &mut self.base);
        self.finish();
    }

    fn take_restarting(&mut self, frame: &Frame, now: Instant, service: A::Service) {
        self.advance(now);
        self.application.handle_restarting(service, frame, &mut self.base);
        self.finish();
    }

    /// Advances the time to `now`, and handles the timers that are due.
    fn advance(&mut self, now: Instant) {
        self.base.now = latest(self.base.now, now);
        if self.base.now >= self.deadline {
            self.run_timers();
        }
    }

    // `inline(never)` saves 7 instructions on a poll without a due timer, 10 on a claim.
    #[inline(never)]
    fn run_timers(&mut self) {
        self.application.poll(&mut self.base);
        if A::FAULT_LOG && self.base.now >= self.base.fault_log.due() {
            self.base.store_fault_log();
        }
        self.application.apply_changes(&mut self.base);
        self.schedule();
    }

    /// Completes a call: applies its changes, and computes the next deadline.
    fn finish(&mut self) {
        self.application.apply_changes(&mut self.base);
        self.schedule();
        // This call may have started a timer that is due at once.
        if self.base.now >= self.deadline {
            self.run_timers();
        }
    }

    /// Returns whether the device declares this kind of write, for which the queue then has room.
    fn is_listed(write: Write) -> bool {
        OWN_WRITES.iter().chain(A::WRITES).any(|listed| listed.is_like(write))
    }

    fn schedule(&mut self) {
        self.deadline = self.application.deadline();
        if A::FAULT_LOG {
            self.deadline = self.deadline.min(self.base.fault_log.due());
        }
    }
}

impl<A: Application> Device for Runtime<A> {
    #[inline]
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool {
        let Some(service) = self.application.service(frame) else { return false };
        self.take(frame, now, service);
        true
    }

    #[inline]
    fn take_filters(&mut self) -> Option<Filters> {
        self.application.take_filters()
    }

    #[inline]
    fn take_abort(&mut self) -> Option<Filter> {
        self.application.take_abort()
    }

    fn sense(&mut self, inputs: &Inputs, now: Instant) {
        self.base.go_to(now);
        // A deadline before `now` is handled with the old inputs, a deadline at `now` with the new inputs.
        if self.base.now > self.deadline {
            self.run_timers();
        }
        self.application.sense(inputs, &mut self.base);
        self.finish();
    }

    #[inline]
    fn poll(&mut self, now: Instant) {
        if now >= self.deadline {
            self.advance(now);
        }
    }

    #[inline]
    fn next_frame(&mut self, now: Instant) -> Option<Frame> {
        self.application.next_frame(latest(self.base.now, now))
    }

    fn give_back(&mut self, frame: Frame) {
        self.application.give_back(frame);
    }

    #[inline]
    fn all_sent(&mut self, now: Instant) -> bool {
        self.base.go_to(now);
        if self.application.all_sent(&mut self.base) {
            self.finish();
        }
        self.application.has_frame()
    }

    fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, now: Instant) {
        self.base.go_to(now);
        if self.application.sent_except(is_held, &mut self.base) {
            self.finish();
        }
    }

    #[inline]
    fn next_effect(&mut self, all_sent: bool) -> Option<Effect> {
        if let Some(bit_rate) = self.application.take_bit_rate() {
            return Some(Effect::SetBitRate(bit_rate));
        }
        if self.base.restart.wanted.is_none() && self.base.writes.is_idle() {
            return None;
        }
        debug_assert!(
            self.base.writes.iter().all(|write| Self::is_listed(*write)),
            "`Application::WRITES` lacks one of {:?}",
            self.base.writes
        );
        self.base.next_effect(&mut self.application, A::RECORD_VERSION, all_sent)
    }

    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant) {
        self.advance(now);
        self.base.end_write(&mut self.application, key, result.is_ok());
        self.finish();
    }

    fn restart(&mut self, scope: Restart, memory: &dyn Memory, now: Instant) {
        self.base.go_to(now);
        self.base.restart.handed_out = false;
        if scope == Restart::Application {
            self.base.writes = Writes::new();
            self.base.fault_log = FaultLogClock::new();
        }
        self.application.start(scope, memory, &mut self.base);
        self.finish();
    }

    fn flush(&mut self, now: Instant) {
        self.advance(now);
        if self.base.fault_log.is_dirty() {
            self.base.store_fault_log();
            self.schedule();
        }
    }

    #[inline]
    fn deadline(&self) -> Instant {
        self.deadline
    }

    fn outputs(&self) -> Outputs {
        self.application.outputs()
    }

    fn bit_rate(&self) -> BitRate {
        self.application.bit_rate()
    }

    fn node_id(&self) -> Option<u8> {
        self.application.node_id()
    }

    fn frames_dropped(&self) -> u32 {
        self.application.frames_dropped()
    }
}

#[cfg(test)]
#[path = "runtime_tests.rs"]
mod tests;
