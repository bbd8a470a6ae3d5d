//! The health of an interface: whether a refused frame is tried again, and what the user is told. No I/O.

use std::io;

use rustix::io::Errno;

/// How often a frame is tried while the interface's queue is full, a millisecond or more apart. The slowest bus, of 10
/// kbit/s, takes a frame in 15 ms: a queue that stands still for longer has nobody who acknowledges. Tries are counted,
/// and not time: a process that stood still has not tried.
const TRIES: u32 = 100;

/// What becomes of a frame that the interface has refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is tried again.
    Retry,
    /// It is lost.
    Lost,
}

/// The health of one interface.
#[derive(Debug)]
pub(super) struct Health {
    name: String,
    /// `None` while frames pass.
    trouble: Option<Trouble>,
}

/// Why frames do not pass.
#[derive(Debug)]
struct Trouble {
    /// The number of frames that were lost since then.
    lost: u64,
    /// Whether the queue stands still: frames may come in all the same.
    is_full: bool,
}

impl Health {
    /// Returns that of an interface which takes frames.
    pub(super) const fn new(name: String) -> Self {
        Self { name, trouble: None }
    }

    /// Takes note of a frame that came in; returns what the user is told.
    pub(super) fn hear(&mut self) -> Option<String> {
        if self.trouble.as_ref()?.is_full { None } else { self.pass() }
    }

    /// Takes note of a frame that the interface took; returns what the user is told.
    pub(super) fn pass(&mut self) -> Option<String> {
        let Trouble { lost, .. } = self.trouble.take()?;
        let frames = if lost == 1 { "1 frame was".to_owned() } else { format!("{lost} frames were") };
        Some(format!("socketcan:{}: frames pass again; {frames} not sent", self.name))
    }

    /// Takes note of an error without a frame; returns what the user is told.
    pub(super) fn fail(&mut self, error: &io::Error) -> Option<String> {
        if self.trouble.is_some() {
            return None;
        }
        self.trouble = Some(Trouble { lost: 0, is_full: is_full(error) });
        Some(format!("socketcan:{}: {}: nothing is sent until frames pass again", self.name, reason(error)))
    }

    /// Decides about a frame that was refused for the `tries`th time; returns what the user is told, too.
    pub(super) fn refuse(&mut self, error: &io::Error, tries: u32) -> (Verdict, Option<String>) {
        // A queue that is known to stand still gets one try a frame, or frames would pile up behind it.
        if is_full(error) && self.trouble.is_none() && tries < TRIES {
            return (Verdict::Retry, None);
        }
        let told = self.fail(error);
        if let Some(trouble) = &mut self.trouble {
            trouble.lost = trouble.lost.saturating_add(1);
        }
        (Verdict::Lost, told)
    }
}

/// Returns whether the interface's queue, or the socket's, is full.
fn is_full(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::NOBUFS | Errno::AGAIN))
}

/// Returns whether the interface is not there any more, so that the socket is bound to none.
pub(super) fn is_gone(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::NODEV | Errno::NXIO))
}

fn reason(error: &io::Error) -> String {
    if is_full(error) { "its queue is full and stands still".to_owned() } else { error.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn health() -> Health {
        Health::new("can0".to_owned())
    }

    fn error(errno: Errno) -> io::Error {
        errno.into()
    }

    #[test]
    fn a_full_queue_is_waited_for_and_not_told() {
        let mut health = health();
        for tries in [1, 2, 99] {
            let refused = health.refuse(&error(Errno::NOBUFS), tries);
            assert_eq!(refused, (Verdict::Retry, None), "try {tries}");
        }
        assert_eq!(health.pass(), None);
    }

    #[test]
    fn a_queue_that_stands_still_is_told_once_and_gets_one_try_a_frame() {
        let mut health = health();
        let (verdict, told) = health.refuse(&error(Errno::NOBUFS), TRIES);
        let expected = "socketcan:can0: its queue is full and stands still: nothing is sent until frames pass again";
        assert_eq!((verdict, told.as_deref()), (Verdict::Lost, Some(expected)));
        assert_eq!(health.hear(), None, "what comes in says nothing of what goes out");
        assert_eq!(health.refuse(&error(Errno::NOBUFS), 1), (Verdict::Lost, None));
        assert_eq!(health.pass().as_deref(), Some("socketcan:can0: frames pass again; 2 frames were not sent"));
        assert_eq!(health.pass(), None);
        assert_eq!(health.refuse(&error(Errno::NOBUFS), 1).0, Verdict::Retry);
    }

    #[test]
    fn an_interface_that_is_down_is_told_once() {
        let mut health = health();
        let told = health.fail(&error(Errno::NETDOWN)).expect("a warning");
        assert!(told.starts_with("socketcan:can0: Network is down"), "{told}");
        assert_eq!(health.fail(&error(Errno::NETDOWN)), None);
        assert_eq!(health.refuse(&error(Errno::NETDOWN), 1), (Verdict::Lost, None));
        assert_eq!(health.hear().as_deref(), Some("socketcan:can0: frames pass again; 1 frame was not sent"));
    }

    #[test]
    fn an_interface_that_is_gone_is_not_one_that_is_down() {
        let gone = [Errno::NODEV, Errno::NXIO, Errno::NETDOWN, Errno::NOBUFS].map(|errno| is_gone(&error(errno)));
        assert_eq!(gone, [true, true, false, false]);
    }
}
