//! The guard of gateways over TCP: prevents web pages from sending to the bus.
//!
//! A page can make its browser connect to any port of this machine, and chooses the body of the request. The browser
//! writes the first bytes: a request line begins with a method and a space (RFC 9112 3; `fetch` accepts any token as
//! the method, even `t1230`), TLS begins with 0x16, STUN over TCP (WebRTC) with 0x00. The guard closes a connection
//! whose first bytes cannot come from a client of the protocol, before any byte takes effect. Undecided bytes already
//! reach the dialogue, which must therefore not act before the byte that identifies its client.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, ReadBuf};

use crate::inbox::{ToWorld, WorldSender};

/// The verdict on the first bytes of a connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Verdict {
    /// Undecided: both a message of the protocol and a browser's request can begin like this.
    #[default]
    Undecided,
    /// Only a message of the protocol can begin like this.
    Client,
    /// No message of the protocol begins like this.
    Foreign,
}

/// A function that judges one byte of a connection, given that all earlier bytes were undecided.
pub type Judge = fn(u8) -> Verdict;

/// A reader that discards the read with the first foreign byte, and fails from then on.
#[derive(Debug)]
pub(super) struct Guarded<R> {
    reader: R,
    judge: Judge,
    verdict: Verdict,
    warning: Arc<ForeignWarning>,
}

impl<R> Guarded<R> {
    /// Creates a reader that judges the bytes of `reader` and reports foreign connections through `warning`.
    pub(super) fn new(reader: R, judge: Judge, warning: Arc<ForeignWarning>) -> Self {
        Self { reader, judge, verdict: Verdict::Undecided, warning }
    }
}

impl<R: AsyncRead + Unpin> AsyncRead for Guarded<R> {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buf.filled().len();
        if self.verdict != Verdict::Foreign {
            ready!(Pin::new(&mut self.reader).poll_read(cx, buf))?;
        }
        for byte in &buf.filled()[before..] {
            if self.verdict != Verdict::Undecided {
                break;
            }
            self.verdict = (self.judge)(*byte);
        }
        if self.verdict == Verdict::Foreign {
            buf.set_filled(before);
            self.warning.tell();
            return Poll::Ready(Err(io::ErrorKind::InvalidData.into()));
        }
        Poll::Ready(Ok(()))
    }
}

/// The warning about foreign connections to one bus; only the first connection is reported.
#[derive(Debug)]
pub struct ForeignWarning {
    url: String,
    world: WorldSender,
    has_warned: AtomicBool,
}

impl ForeignWarning {
    /// Creates the warning for the bus at this URL.
    #[must_use]
    pub const fn new(url: String, world: WorldSender) -> Self {
        Self { url, world, has_warned: AtomicBool::new(false) }
    }

    fn tell(&self) {
        if !self.has_warned.swap(true, Ordering::Relaxed) {
            self.world.tell(ToWorld::Warn(format!(
                "{}: closed a connection that does not use this protocol, perhaps from a web page; further ones are \
                 closed without a warning",
                self.url
            )));
        }
    }
}

#[cfg(test)]
#[path = "guard_tests.rs"]
mod tests;
