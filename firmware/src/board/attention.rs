//! What the device's task waits for: somebody wants something of it, or its time has come.
//!
//! An `AtomicWaker` and `with_deadline` do the same, and cost more from interrupt to sleep: 74 instructions for a frame
//! that is for nobody, 229 for an SDO upload.

use core::cell::Cell;
use core::future::{Future as _, poll_fn};
use core::pin::pin;
use core::sync::atomic::{AtomicU8, Ordering};
use core::task::{Context, Poll};

use critical_section::Mutex;
use embassy_executor::raw::{TaskRef, task_from_waker, wake_task};
use embassy_time::{Duration, Instant, Timer};

/// Who wants something.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum Caller {
    /// The CAN controller: a frame was received.
    Received = 1 << 0,
    /// The CAN controller: a frame was sent, or taken back.
    Sent = 1 << 1,
    /// The CAN controller: its error mode has changed.
    Errors = 1 << 2,
    /// The memory has an answer.
    Memory = 1 << 3,
    /// Something was typed, or the button was pressed.
    Front = 1 << 4,
    /// The LEDs want to know what to show.
    Leds = 1 << 5,
}

static CALLED: AtomicU8 = AtomicU8::new(0);
/// The device's task. Not a waker: that costs twice as much to wake.
static TASK: Mutex<Cell<Option<TaskRef>>> = Mutex::new(Cell::new(None));

/// Calls the device's task.
pub(super) fn call(caller: Caller) {
    CALLED.fetch_or(caller as u8, Ordering::Release);
    if let Some(task) = critical_section::with(|cs| TASK.borrow(cs).get()) {
        wake_task(task);
    }
}

/// Who has called since this was last asked.
#[derive(Clone, Copy, Default)]
pub(super) struct Calls(u8);

impl Calls {
    pub(super) const fn include(self, caller: Caller) -> bool {
        self.0 & caller as u8 != 0
    }

    /// Returns whether nobody else has called.
    pub(super) const fn are_only(self, caller: Caller) -> bool {
        self.0 == caller as u8
    }
}

/// Waits for calls, and for nothing else: the task has one timer, and it is known here when that rings.
pub(super) struct Attention {
    /// When the timer rings at the latest.
    armed: Instant,
}

impl Attention {
    /// Returns the attention of the task that this is called in.
    pub(super) async fn new() -> Self {
        poll_fn(|context| {
            let task = task_from_waker(context.waker());
            critical_section::with(|cs| TASK.borrow(cs).set(Some(task)));
            Poll::Ready(())
        })
        .await;
        Self { armed: Instant::MIN }
    }

    /// Waits until somebody calls, or until `due`; it can be woken earlier, for nothing. `now` is not long ago.
    pub(super) async fn wait(&mut self, due: Instant, now: Instant) -> Calls {
        let mut waited = false;
        poll_fn(|context| {
            let called = CALLED.swap(0, Ordering::Acquire);
            if called != 0 || waited {
                return Poll::Ready(Calls(called));
            }
            waited = true;
            self.arm(due, now, context);
            Poll::Pending
        })
        .await
    }

    /// Lets a time pass; calls are kept for the next [`wait`](Self::wait).
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

    /// Sets the timer. One that rings earlier is left alone: to set it again for each frame costs more than to be woken
    /// for nothing.
    fn arm(&mut self, due: Instant, now: Instant, context: &mut Context<'_>) {
        if self.armed <= now || due < self.armed {
            self.armed = due;
            // The timer's queue remembers the task, and the timer is not needed any more.
            let _ = pin!(Timer::at(due)).poll(context);
        }
    }
}
