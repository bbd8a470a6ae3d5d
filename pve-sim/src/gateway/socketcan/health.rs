//! The health of an interface: decides whether to retry a refused frame, and creates the messages for the user. No I/O.

use std::io;

use rustix::io::Errno;

/// The maximum number of attempts for a frame while the interface's queue is full, a millisecond or more apart. Even a
/// bus at 10 kbit/s sends a frame within 15 ms: if the queue stays full for longer, no node acknowledges. The limit
/// counts attempts instead of time, because a paused process makes no attempts.
const TRIES: u32 = 100;

/// The verdict on a frame that the interface has refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Retry the frame.
    Retry,
    /// The frame is lost.
    Lost,
}

/// The health of one interface.
#[derive(Debug)]
pub(super) struct Health {
    name: String,
    /// The current problem; `None` while frames pass.
    trouble: Option<Trouble>,
}

/// A problem that blocks frames.
#[derive(Debug)]
struct Trouble {
    /// The number of frames lost since the problem began.
    lost: u64,
    /// Whether the transmit queue is full; reception may still work.
    is_full: bool,
}

impl Health {
    /// Creates the health of a working interface.
    pub(super) const fn new(name: String) -> Self {
        Self { name, trouble: None }
    }

    /// Records a received frame, which ends a problem other than a full transmit queue. Returns a message for the user,
    /// if any.
    pub(super) fn hear(&mut self) -> Option<String> {
        if self.trouble.as_ref()?.is_full { None } else { self.pass() }
    }

    /// Records that the interface has accepted a frame, which ends any problem. Returns a message for the user, if any.
    pub(super) fn pass(&mut self) -> Option<String> {
        let Trouble { lost, .. } = self.trouble.take()?;
        let frames = if lost == 1 { "1 frame was".to_owned() } else { format!("{lost} frames were") };
        Some(format!("socketcan:{}: sending frames again; {frames} not sent", self.name))
    }

    /// Records an error, which begins a problem unless one exists. Returns a message for the user, if any.
    pub(super) fn fail(&mut self, error: &io::Error) -> Option<String> {
        if self.trouble.is_some() {
            return None;
        }
        self.trouble = Some(Trouble { lost: 0, is_full: is_full(error) });
        Some(format!("socketcan:{}: {}: no frames are sent until this is resolved", self.name, reason(error)))
    }

    /// Records that the interface has refused a frame for the `tries`-th time. Returns whether to retry the frame, and
    /// a message for the user, if any.
    pub(super) fn refuse(&mut self, error: &io::Error, tries: u32) -> (Verdict, Option<String>) {
        // While the queue is known to be full, each frame gets one attempt; otherwise pending frames would accumulate.
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

/// Returns whether the queue of the interface or of the socket is full.
fn is_full(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::NOBUFS | Errno::AGAIN))
}

/// Returns whether the interface no longer exists, which leaves the socket unbound.
pub(super) fn is_gone(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::NODEV | Errno::NXIO))
}

fn reason(error: &io::Error) -> String {
    if is_full(error) { "the transmit queue is full and does not drain".to_owned() } else { error.to_string() }
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
        let expected =
            "socketcan:can0: the transmit queue is full and does not drain: no frames are sent until this is resolved";
        assert_eq!((verdict, told.as_deref()), (Verdict::Lost, Some(expected)));
        assert_eq!(health.hear(), None, "what comes in says nothing of what goes out");
        assert_eq!(health.refuse(&error(Errno::NOBUFS), 1), (Verdict::Lost, None));
        assert_eq!(health.pass().as_deref(), Some("socketcan:can0: sending frames again; 2 frames were not sent"));
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
        assert_eq!(health.hear().as_deref(), Some("socketcan:can0: sending frames again; 1 frame was not sent"));
    }

    #[test]
    fn an_interface_that_is_gone_is_not_one_that_is_down() {
        let gone = [Errno::NODEV, Errno::NXIO, Errno::NETDOWN, Errno::NOBUFS].map(|errno| is_gone(&error(errno)));
        assert_eq!(gone, [true, true, false, false]);
    }
}
