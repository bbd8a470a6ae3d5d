//! Runs tasks on several threads, and delivers their results in order.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// The number of tasks per thread that may begin ahead of the next result. Early results wait in memory.
const AHEAD: usize = 4;
/// The maximum time without a message before `meanwhile` is called.
const PAUSE: Duration = Duration::from_millis(200);

/// Messages to the thread that takes the results.
pub(super) enum Message<R> {
    /// The index of a task, and its result.
    Done(usize, R),
    /// A task that panicked.
    Panicked,
    /// A signal, which ends the work.
    Interrupted,
}

/// The reason for an early end.
pub(super) enum Stopped<E> {
    /// A signal.
    Interrupted,
    /// A thread panicked.
    Panicked,
    /// An error of `take`.
    Failed(E),
}

/// The indices of the next task to begin and of the next result to take.
#[derive(Default)]
struct Turn {
    next: Mutex<(usize, usize)>,
    moved: Condvar,
}

impl Turn {
    fn lock(&self) -> MutexGuard<'_, (usize, usize)> {
        self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the index of the next task. Waits while this task is more than `ahead` tasks beyond the next result.
    fn begin(&self, ahead: usize) -> usize {
        let mut next = self.lock();
        while next.0 > next.1 + ahead {
            next = self.moved.wait(next).unwrap_or_else(PoisonError::into_inner);
        }
        next.0 += 1;
        next.0 - 1
    }

    fn taken(&self, places: usize) {
        self.lock().1 = places;
        self.moved.notify_all();
    }
}

/// Runs tasks on `jobs` threads, and calls `take` with the results in order. Calls `meanwhile` after each message, and
/// after each [`PAUSE`] without a message. After an error or a signal, the threads are not joined; at the latest they
/// end with the process.
pub(super) fn in_order<T, R, E>(
    tasks: Vec<T>,
    jobs: usize,
    work: impl Fn(&T) -> R + Send + Sync + 'static,
    (sender, messages): (Sender<Message<R>>, Receiver<Message<R>>),
    mut take: impl FnMut(R) -> Result<(), E>,
    mut meanwhile: impl FnMut(),
) -> Result<(), Stopped<E>>
where
    T: Send + Sync + 'static,
    R: Send + 'static,
{
    let (count, shared, turn) = (tasks.len(), Arc::new((tasks, work)), Arc::new(Turn::default()));
    for _ in 0..jobs.min(count) {
        let (shared, turn, sender) = (shared.clone(), turn.clone(), sender.clone());
        thread::spawn(move || {
            loop {
                let place = turn.begin(jobs * AHEAD);
                let Some(task) = shared.0.get(place) else { break };
                // The other threads would wait for the result of this one.
                let done = catch_unwind(AssertUnwindSafe(|| shared.1(task)));
                if sender.send(done.map_or(Message::Panicked, |result| Message::Done(place, result))).is_err() {
                    break;
                }
            }
        });
    }
    drop(sender);
    let mut early: BTreeMap<usize, R> = BTreeMap::new();
    let mut taken = 0;
    while taken < count {
        match messages.recv_timeout(PAUSE) {
            Ok(Message::Done(place, result)) => drop(early.insert(place, result)),
            Ok(Message::Interrupted) => return Err(Stopped::Interrupted),
            Ok(Message::Panicked) | Err(RecvTimeoutError::Disconnected) => return Err(Stopped::Panicked),
            Err(RecvTimeoutError::Timeout) => {}
        }
        while let Some(result) = early.remove(&taken) {
            take(result).map_err(Stopped::Failed)?;
            taken += 1;
            turn.taken(taken);
        }
        meanwhile();
    }
    Ok(())
}

/// Creates the channel to the thread that takes the results.
pub(super) fn messages<R>() -> (Sender<Message<R>>, Receiver<Message<R>>) {
    channel()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn results_come_in_order_and_few_wait() {
        let (waiting, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let mut taken = Vec::new();
        let work = {
            let (waiting, most) = (waiting.clone(), most.clone());
            move |task: &usize| {
                // The first task is slow.
                for _ in 0..if *task == 0 { 1000 } else { 0 } {
                    thread::yield_now();
                }
                most.fetch_max(1 + waiting.fetch_add(1, Ordering::SeqCst), Ordering::SeqCst);
                *task
            }
        };
        let take = |task| {
            waiting.fetch_sub(1, Ordering::SeqCst);
            taken.push(task);
            Ok::<(), ()>(())
        };
        assert!(in_order((0..1000).collect(), 3, work, messages(), take, || {}).is_ok());
        assert_eq!(taken, (0..1000).collect::<Vec<_>>());
        assert!(most.load(Ordering::SeqCst) <= 3 * AHEAD + 4, "{most:?}");
    }

    #[test]
    fn an_error_and_a_signal_end_the_work() {
        let take = |task| if task == 5 { Err(task) } else { Ok(()) };
        let stopped = in_order((0..100).collect(), 2, |task: &i32| *task, messages(), take, || {});
        assert!(matches!(stopped, Err(Stopped::Failed(5))));
        let (sender, receiver) = messages();
        sender.send(Message::Interrupted).expect("a receiver");
        let stopped = in_order(vec![1], 1, |task: &i32| *task, (sender, receiver), |_| Ok::<(), ()>(()), || {});
        assert!(matches!(stopped, Err(Stopped::Interrupted)));
    }

    #[test]
    fn a_panic_is_reported() {
        for jobs in [1, 2] {
            let work = |task: &i32| assert!(*task != 3, "on purpose");
            let stopped = in_order((0..100).collect(), jobs, work, messages(), |()| Ok::<(), ()>(()), || {});
            assert!(matches!(stopped, Err(Stopped::Panicked)), "{jobs}");
        }
    }
}
