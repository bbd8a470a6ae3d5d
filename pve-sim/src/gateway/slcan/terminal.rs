//! A pseudo-terminal, and the symbolic link through which clients open it.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::slice;
use std::task::{Context, Poll};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use tokio::io::{AsyncRead, ReadBuf};
use tokio::net::unix::pipe::{Receiver, Sender};

/// The master side of a pseudo-terminal in raw mode; clients open the other side.
#[derive(Debug)]
pub(super) struct Terminal {
    /// The master side, non-blocking.
    end: OwnedFd,
    link: Link,
}

impl Terminal {
    /// Creates a terminal and the link to it.
    ///
    /// # Errors
    /// When the system has no free terminal, or the path holds anything but a stale link.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let (end, device) = make()?;
        Ok(Self { end, link: Link::make(path, device)? })
    }

    /// Returns whether a client has the terminal open, or has left unread data.
    pub(super) fn is_in_use(&self) -> bool {
        let mut fd = PollFd::new(&self.end, PollFlags::IN);
        // A failed poll reports nothing.
        let _ = poll(slice::from_mut(&mut fd), Some(&Timespec { tv_sec: 0, tv_nsec: 0 }));
        fd.revents().contains(PollFlags::IN) || !fd.revents().contains(PollFlags::HUP)
    }

    /// Returns a reader and a writer for one client. Both fail once the client has closed the terminal.
    ///
    /// # Errors
    /// When the process has no free file descriptor.
    pub(super) fn halves(&self) -> io::Result<(WithoutEcho, Sender)> {
        // Both types work for any non-blocking descriptor.
        let reader = Receiver::from_owned_fd_unchecked(self.end.try_clone()?)?;
        let writer = Sender::from_owned_fd_unchecked(self.end.try_clone()?)?;
        Ok((WithoutEcho(reader), writer))
    }

    /// Resets the terminal modes and discards unread output of the previous client. The next client may be connected
    /// already.
    ///
    /// # Errors
    /// When the client has locked the terminal.
    pub(super) fn reset(&self) -> io::Result<()> {
        let client = open(&self.link.device)?;
        // Discards the unread output of both sides.
        tcflush(&self.end, QueueSelector::OFlush)?;
        if tcflush(&client, QueueSelector::IFlush).is_err() {
            // The next client has installed a line discipline of its own, as slcand does, with its own modes.
            return Ok(());
        }
        set_raw(&client)
    }

    /// Replaces the terminal by a new one; the client of the old one sees a hang-up.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub(super) fn renew(&mut self) -> io::Result<()> {
        let (end, device) = make()?;
        self.link.lead_to(device)?;
        self.end = end;
        Ok(())
    }
}

/// Creates a terminal that no client has open; returns its master side and the path of the device that clients open.
fn make() -> io::Result<(OwnedFd, PathBuf)> {
    let end = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
    grantpt(&end)?;
    unlockpt(&end)?;
    rustix::io::ioctl_fionbio(&end, true)?;
    let device = PathBuf::from(OsStr::from_bytes(ptsname(&end, Vec::new())?.as_bytes()));
    // The system reports a hang-up only after the other side has been open once.
    set_raw(&open(&device)?)?;
    Ok((end, device))
}

/// Opens the device that clients open, but not as the controlling terminal of this process.
fn open(device: &Path) -> io::Result<File> {
    Ok(rustix::fs::open(device, OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC, Mode::empty())?.into())
}

fn set_raw(terminal: impl AsFd) -> io::Result<()> {
    let mut attributes = tcgetattr(&terminal)?;
    attributes.make_raw();
    Ok(tcsetattr(&terminal, OptionalActions::Now, &attributes)?)
}

/// The input from clients. Each read switches the terminal's echo off, because the adapter would otherwise execute its
/// own echoed answers and frames.
#[derive(Debug)]
pub(super) struct WithoutEcho(Receiver);

impl AsyncRead for WithoutEcho {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let poll = Pin::new(&mut self.0).poll_read(cx, buf);
        // A client can switch the echo on at any time. Bytes echoed until now may be in this read.
        if poll.is_ready()
            && let Ok(mut attributes) = tcgetattr(&self.0)
            && attributes.local_modes.contains(LocalModes::ECHO)
        {
            attributes.local_modes.remove(LocalModes::ECHO);
            let _ = tcsetattr(&self.0, OptionalActions::Now, &attributes);
        }
        poll
    }
}

/// A symbolic link to a device. Dropping it removes the link.
#[derive(Debug)]
struct Link {
    path: PathBuf,
    device: PathBuf,
}

impl Link {
    fn make(path: &Path, device: PathBuf) -> io::Result<Self> {
        match symlink(&device, path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                if !is_stale(path, &device) {
                    return Err(io::Error::new(error.kind(), in_the_way(path, &device)));
                }
                fs::remove_file(path)?;
                symlink(&device, path)?;
            }
            made => made?,
        }
        Ok(Self { path: path.to_owned(), device })
    }

    /// Changes the device of the link. The path exists at every instant.
    fn lead_to(&mut self, device: PathBuf) -> io::Result<()> {
        if self.is_there() {
            let mut next = self.path.clone().into_os_string();
            next.push(".next");
            let link = Self::make(Path::new(&next), device)?;
            fs::rename(&link.path, &self.path)?;
            self.device.clone_from(&link.device);
        } else {
            *self = Self::make(&self.path, device)?;
        }
        Ok(())
    }

    /// Returns whether the path still leads to the device.
    fn is_there(&self) -> bool {
        fs::read_link(&self.path).is_ok_and(|device| device == self.device)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if self.is_there() {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Returns whether the path is a stale link: to a terminal that no longer exists, or to `device`, the new terminal.
fn is_stale(path: &Path, device: &Path) -> bool {
    fs::read_link(path).is_ok_and(|old| old.parent() == device.parent() && (old == device || !old.exists()))
}

/// Returns the error message for an occupied path. A link to an existing terminal may be stale, because another program
/// can have been given the same terminal number; the two cases cannot be distinguished.
fn in_the_way(path: &Path, device: &Path) -> String {
    let name = path.display();
    match fs::read_link(path) {
        Ok(old) if old.parent() == device.parent() => {
            format!("{name} links to {}, which is in use; if no other pve-sim uses it, remove the link", old.display())
        }
        _ => format!("{name} exists and is not a stale link"),
    }
}

#[cfg(test)]
#[path = "terminal_tests.rs"]
mod tests;
