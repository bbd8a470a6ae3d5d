//! The events and the timer that wake the device task.
//!
//! An `AtomicWaker` with `with_deadline` would do the same, but would cost more instructions from interrupt to sleep:
//! 74 for a frame for another node, 229 for an SDO upload.

use core::cell::Cell;
use core::future::{Future as _, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicU8, Ordering};
use core::task::{Context, Poll};

use critical_section::Mutex;
use embassy_executor::raw::{TaskRef, task_from_waker, wake_task};
use embassy_time::{Duration, Instant, Timer};

/// An event that wakes the device task.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum Event {
    /// The CAN controller has received a frame.
    Received = 1 << 0,
    /// The CAN controller has sent or aborted a frame.
    Sent = 1 << 1,
    /// The error mode of the CAN controller has changed.
    Errors = 1 << 2,
    /// The memory has the result of a request.
    Memory = 1 << 3,
    /// A console line or a button press has arrived.
    Controls = 1 << 4,
    /// The LEDs need the present state.
    Leds = 1 << 5,
}

static PENDING: AtomicU8 = AtomicU8::new(0);
/// The device task. A waker in its place would cost twice as much.
static TASK: Mutex<Cell<Option<TaskRef>>> = Mutex::new(Cell::new(None));

/// Wakes the device task with an event.
pub(super) fn notify(event: Event) {
    PENDING.fetch_or(event as u8, Ordering::Release);
    if let Some(task) = critical_section::with(|cs| TASK.borrow(cs).get()) {
        wake_task(task);
    }
}

/// The events since the previous [`WakeUp::wait`].
#[derive(Clone, Copy, Default)]
pub(super) struct Events(u8);

impl Events {
    pub(super) const fn include(self, event: Event) -> bool {
        self.0 & event as u8 != 0
    }

    /// Returns whether `event` is the only event.
    pub(super) const fn are_only(self, event: Event) -> bool {
        self.0 == event as u8
    }
}

/// The wake-up of the device task, by events and by its only timer.
pub(super) struct WakeUp {
    /// The time to which the timer was set last.
    armed: Instant,
}

impl WakeUp {
    /// Creates the wake-up. The caller must be the device task.
    pub(super) async fn new() -> Self {
        poll_fn(|context| {
            let task = task_from_waker(context.waker());
            critical_section::with(|cs| TASK.borrow(cs).set(Some(task)));
            Poll::Ready(())
        })
        .await;
        Self { armed: Instant::MIN }
    }

    /// Waits for an event, at most until `due`. The function can return earlier without an event. `now` must be close
    /// to the present time.
    pub(super) async fn wait(&mut self, due: Instant, now: Instant) -> Events {
        let mut waited = false;
        poll_fn(|context| {
            let events = PENDING.swap(0, Ordering::Acquire);
            if events != 0 || waited {
                return Poll::Ready(Events(events));
            }
            waited = true;
            self.arm(due, now, context);
            Poll::Pending
        })
        .await
    }

    /// Waits for a duration. The next [`wait`](Self::wait) returns the events that arrive meanwhile.
    pub(super) async fn pause(&mut self, time: Duration) {
        let end = Instant::now() + time;
        poll_fn(|context| {
            let now = Instant::now();
            if now >= end {
                return Poll::Ready(());
            }
            self.arm(end, now, context);
            Poll::Pending
        })
        .await;
    }

    /// Sets the timer to `due`, unless it ends earlier. An unneeded wake-up costs less than setting the timer for every
    /// frame.
    fn arm(&mut self, due: Instant, now: Instant, context: &mut Context<'_>) {
        if self.armed <= now || due < self.armed {
            self.armed = due;
            // The timer queue holds the task, so the timer can be dropped.
            let _ = pin!(Timer::at(due)).poll(context);
        }
    }
}
