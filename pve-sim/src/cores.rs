//! Runs tasks on several threads, and delivers their results in order.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// The number of tasks per thread that may begin ahead of the next result. Early results wait in memory.
const AHEAD: usize = 4;
/// The maximum time without a result before `meanwhile` is called.
const PAUSE: Duration = Duration::from_millis(200);

/// The reason for an early end.
#[derive(Debug)]
pub(crate) enum Stopped<E> {
    /// A signal.
    Interrupted,
    /// A task panicked.
    Panicked,
    /// An error of `take`.
    Failed(E),
}

/// Returns the number of processors.
pub(crate) fn processors() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Runs tasks on `jobs` threads, and calls `take` with the results in order. Calls `meanwhile` before each result, and
/// after each [`PAUSE`] without a result. After an error or once `interrupted` is true, the threads are not joined; at
/// the latest they end with the process.
pub(crate) fn in_order<T, R, E>(
    tasks: Vec<T>,
    jobs: usize,
    work: impl Fn(T) -> R + Send + Sync + 'static,
    interrupted: &AtomicBool,
    mut take: impl FnMut(R) -> Result<(), E>,
    mut meanwhile: impl FnMut(),
) -> Result<(), Stopped<E>>
where
    T: Send + 'static,
    R: Send + 'static,
{
    let (senders, results): (Vec<_>, Vec<_>) = tasks.iter().map(|_| channel()).unzip();
    let shared = Arc::new((Mutex::new(tasks.into_iter().zip(senders)), work));
    // Has an item for each task that has begun, and whose result has not been taken.
    let (begin, begun) = sync_channel(jobs * AHEAD);
    for _ in 0..jobs.min(results.len()) {
        let (shared, begin) = (shared.clone(), begin.clone());
        thread::spawn(move || {
            let next = || shared.0.lock().unwrap_or_else(PoisonError::into_inner).next();
            while begin.send(()).is_ok()
                && let Some((task, sender)) = next()
            {
                let _ = sender.send((shared.1)(task));
            }
        });
    }
    for result in results {
        let result = loop {
            if interrupted.load(Ordering::Relaxed) {
                return Err(Stopped::Interrupted);
            }
            meanwhile();
            match result.recv_timeout(PAUSE) {
                Ok(result) => break result,
                Err(RecvTimeoutError::Timeout) => {}
                // The thread has dropped the sender.
                Err(RecvTimeoutError::Disconnected) => return Err(Stopped::Panicked),
            }
        };
        take(result).map_err(Stopped::Failed)?;
        let _ = begun.recv();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    static NEVER: AtomicBool = AtomicBool::new(false);

    #[test]
    fn results_come_in_order_and_few_wait() {
        let (waiting, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let mut taken = Vec::new();
        let work = {
            let (waiting, most) = (waiting.clone(), most.clone());
            move |task: usize| {
                // The first task is slow.
                for _ in 0..if task == 0 { 1000 } else { 0 } {
                    thread::yield_now();
                }
                most.fetch_max(1 + waiting.fetch_add(1, Ordering::SeqCst), Ordering::SeqCst);
                task
            }
        };
        let take = |task| {
            waiting.fetch_sub(1, Ordering::SeqCst);
            taken.push(task);
            Ok::<(), ()>(())
        };
        assert!(in_order((0..1000).collect(), 3, work, &NEVER, take, || {}).is_ok());
        assert_eq!(taken, (0..1000).collect::<Vec<_>>());
        assert!(most.load(Ordering::SeqCst) <= 3 * AHEAD + 4, "{most:?}");
    }

    #[test]
    fn an_error_and_a_signal_end_the_work() {
        let take = |task| if task == 5 { Err(task) } else { Ok(()) };
        let stopped = in_order((0..100).collect(), 2, |task: i32| task, &NEVER, take, || {});
        assert!(matches!(stopped, Err(Stopped::Failed(5))));
        let interrupted = AtomicBool::new(true);
        let stopped = in_order(vec![1], 1, |task: i32| task, &interrupted, |_| Ok::<(), ()>(()), || {});
        assert!(matches!(stopped, Err(Stopped::Interrupted)));
    }

    #[test]
    fn a_panic_is_reported() {
        for jobs in [1, 2] {
            let work = |task: i32| assert!(task != 3, "on purpose");
            let stopped = in_order((0..100).collect(), jobs, work, &NEVER, |()| Ok::<(), ()>(()), || {});
            assert!(matches!(stopped, Err(Stopped::Panicked)), "{jobs}");
        }
    }
}
