//! Writes stdout and stderr on a separate thread: a pipe that is closed or not read must not block the world.

use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use tokio_util::sync::CancellationToken;

/// The maximum number of pending texts; beyond it, trace lines are dropped.
const QUEUE: usize = 4096;

/// The maximum number of bytes in one write, not counting the last line.
const BATCH: usize = 64 * 1024;

/// The time limit for writing the pending texts at the end of a run, and then for the message that it has expired:
/// stderr may have no reader, too.
const END_TIMEOUT: Duration = Duration::from_secs(2);

const UNREAD: &str = "pve-sim: stdout was not read in time";

enum Text {
    /// Trace lines, each with its newline.
    Trace(String),
    /// Text for the user, printed after all earlier lines.
    Note(String),
}

/// The writer of stdout and stderr.
pub(super) struct Printer {
    queue: SyncSender<Text>,
    stderr: Stderr,
    lost: Arc<AtomicU64>,
    is_cut: Arc<AtomicBool>,
    ended: Receiver<()>,
}

/// Stderr, locked while a text is written.
#[derive(Clone)]
struct Stderr(Arc<Mutex<dyn Write + Send>>);

impl Stderr {
    fn note(&self, text: &str) {
        let mut stderr = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = writeln!(stderr, "{text}").and_then(|()| stderr.flush());
    }
}

impl Printer {
    /// Starts the thread. Cancels `stop` when stdout is closed.
    pub(super) fn start(
        stdout: impl Write + Send + 'static,
        stderr: impl Write + Send + 'static,
        stop: CancellationToken,
    ) -> io::Result<Self> {
        let (queue, texts) = sync_channel(QUEUE);
        let (alive, ended) = channel();
        let lost = Arc::new(AtomicU64::new(0));
        let is_cut = Arc::new(AtomicBool::new(false));
        let stderr = Stderr(Arc::new(Mutex::new(stderr)));
        let writer =
            Writer { stdout: Some(stdout), stderr: stderr.clone(), lost: lost.clone(), is_cut: is_cut.clone(), stop };
        thread::Builder::new().name("printer".to_owned()).spawn(move || {
            writer.run(&texts);
            drop(alive);
        })?;
        Ok(Self { queue, stderr, lost, is_cut, ended })
    }

    /// Prints trace lines; drops them if the queue is full.
    pub(super) fn trace(&self, lines: String) {
        if let Err(TrySendError::Full(Text::Trace(lines))) = self.queue.try_send(Text::Trace(lines)) {
            let count = lines.bytes().filter(|byte| *byte == b'\n').count();
            self.lost.fetch_add(count as u64, Ordering::Relaxed);
        }
    }

    /// Prints a warning on stderr.
    pub(super) fn warn(&self, line: String) {
        self.note(format!("pve-sim: {line}"));
    }

    /// Prints a text on stderr, because on stdout a reader could mistake the text for a frame.
    pub(super) fn note(&self, text: String) {
        // If the queue is full, nobody reads stdout or stderr, and the text is dropped.
        let _ = self.queue.try_send(Text::Note(text));
    }

    /// Waits until everything is printed or the time limit expires; returns whether stdout is complete, or closed by
    /// its reader.
    pub(super) fn finish(self) -> bool {
        let Self { queue, stderr, is_cut, ended, .. } = self;
        drop(queue);
        if ended.recv_timeout(END_TIMEOUT) != Err(RecvTimeoutError::Timeout) {
            return !is_cut.load(Ordering::Relaxed);
        }
        let (alive, told) = channel::<()>();
        let _ = thread::Builder::new().name("last note".to_owned()).spawn(move || {
            stderr.note(&format!("{UNREAD}: the end of the trace is missing"));
            drop(alive);
        });
        let _ = told.recv_timeout(END_TIMEOUT);
        false
    }
}

struct Writer<O> {
    /// Stdout; `None` after a failed write.
    stdout: Option<O>,
    stderr: Stderr,
    lost: Arc<AtomicU64>,
    /// True if trace lines were dropped, or a write to stdout has failed other than for a reader that has gone.
    is_cut: Arc<AtomicBool>,
    stop: CancellationToken,
}

impl<O: Write> Writer<O> {
    fn run(mut self, texts: &Receiver<Text>) {
        let mut batch = String::new();
        while let Ok(text) = texts.recv() {
            self.take(text, &mut batch);
            while batch.len() < BATCH
                && let Ok(text) = texts.try_recv()
            {
                self.take(text, &mut batch);
            }
            self.print(&mut batch);
            self.tell_lost();
        }
        // Lines can be dropped after the last text was taken.
        self.tell_lost();
    }

    fn tell_lost(&self) {
        let lost = self.lost.swap(0, Ordering::Relaxed);
        if lost > 0 && self.stdout.is_some() {
            self.is_cut.store(true, Ordering::Relaxed);
            self.stderr.note(&format!("{UNREAD}: dropped {lost} lines of the trace"));
        }
    }

    fn take(&mut self, text: Text, batch: &mut String) {
        match text {
            Text::Trace(lines) => batch.push_str(&lines),
            Text::Note(text) => {
                self.print(batch);
                self.stderr.note(&text);
            }
        }
    }

    /// Writes a batch of trace lines.
    fn print(&mut self, batch: &mut String) {
        if let Some(stdout) = &mut self.stdout {
            match stdout.write_all(batch.as_bytes()).and_then(|()| stdout.flush()) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                    self.stdout = None;
                    self.stop.cancel();
                }
                Err(error) => {
                    self.stdout = None;
                    self.is_cut.store(true, Ordering::Relaxed);
                    self.stderr.note(&format!("pve-sim: stdout: {error}; the trace has stopped"));
                }
            }
        }
        batch.clear();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::Sender;

    use super::*;

    /// A writer that passes on its input; a write waits until the previous one was taken.
    struct Pipe(SyncSender<String>);

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let text = String::from_utf8_lossy(bytes).into_owned();
            self.0.send(text).map(|()| bytes.len()).map_err(|_| io::ErrorKind::BrokenPipe.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    struct Collect(Sender<u8>);

    impl Write for Collect {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            bytes.iter().try_for_each(|byte| self.0.send(*byte)).map_err(|_| io::ErrorKind::BrokenPipe)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn text(bytes: &Receiver<u8>) -> String {
        String::from_utf8(bytes.iter().collect()).expect("text")
    }

    #[test]
    fn a_closed_stdout_ends_the_trace_and_is_told() {
        let (stdout, closed) = sync_channel(1);
        drop(closed);
        let (stderr, said) = channel();
        let stop = CancellationToken::new();
        let printer = Printer::start(Pipe(stdout), Collect(stderr), stop.clone()).unwrap();
        assert!(!stop.is_cancelled());
        printer.trace("one\n".to_owned());
        printer.trace("two\n".to_owned());
        printer.warn("still here".to_owned());
        assert!(printer.finish());
        assert_eq!(text(&said), "pve-sim: still here\n");
        assert!(stop.is_cancelled());
    }

    #[test]
    fn a_stdout_that_nobody_reads_loses_lines_and_says_so() {
        let (stdout, pipe) = sync_channel(0);
        let (stderr, said) = channel();
        let printer = Printer::start(Pipe(stdout), Collect(stderr), CancellationToken::new()).unwrap();
        // One batch waits for the reader, the queue fills up, and the rest finds no space.
        let lines = 4 * QUEUE;
        for _ in 0..lines {
            printer.trace("line\n".to_owned());
        }
        let lost = printer.lost.load(Ordering::Relaxed) as usize;
        assert!(lost > 0);
        let reader = thread::spawn(move || pipe.iter().collect::<String>().lines().count());
        assert!(!printer.finish(), "the trace has a gap");
        assert_eq!(reader.join().unwrap() + lost, lines);
        assert_eq!(text(&said), format!("pve-sim: stdout was not read in time: dropped {lost} lines of the trace\n"));
    }
}
