//! A kernel interface: its socket, and the frames through it.

use std::future::pending;
use std::io;
use std::time::Duration;

use socketcan::{CanFrame, CanSocket, Socket as _};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::time::{Instant, sleep, sleep_until};

use super::health::{Health, Verdict, is_gone};
use crate::gateway::Member;
use crate::inbox::{ClientEnd, ClientId, ToClient, ToWorld, WorldSender, spend};

/// The delay between attempts while the interface's queue is full.
const RETRY: Duration = Duration::from_millis(1);

/// The retry interval for a missing interface, and the delay after a read error.
const PAUSE: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(super) struct Interface {
    name: String,
    /// The socket. The asynchronous socket of the crate `socketcan` does not report that an interface goes down.
    socket: AsyncFd<CanSocket>,
    health: Health,
    /// The time of the next retry for a missing interface; `None` while the socket is bound.
    next_open: Option<Instant>,
}

/// A frame pending for the interface.
#[derive(Debug)]
struct Waiting {
    frame: CanFrame,
    tries: u32,
    next_try: Instant,
}

impl Interface {
    /// Opens an interface, which may be down; requires a Tokio runtime.
    ///
    /// # Errors
    /// When no CAN interface has that name, or the kernel lacks SocketCAN.
    pub(super) fn open(name: &str) -> io::Result<Self> {
        let socket = open(name)?;
        Ok(Self { name: name.to_owned(), socket, health: Health::new(name.to_owned()), next_open: None })
    }

    /// Sends a frame to the interface. Returns the frame if sending must be retried; `None` if the frame was accepted
    /// or is lost.
    fn send(&mut self, waiting: Waiting, world: &WorldSender) -> Option<Waiting> {
        match self.socket.get_ref().write_frame(&waiting.frame) {
            Ok(()) => {
                tell(world, self.health.pass());
                None
            }
            Err(error) => {
                self.note(&error);
                let tries = waiting.tries.saturating_add(1);
                let (verdict, told) = self.health.refuse(&error, tries);
                tell(world, told);
                (verdict == Verdict::Retry).then(|| Waiting { tries, next_try: Instant::now() + RETRY, ..waiting })
            }
        }
    }

    /// Schedules a retry to open the interface if an error reveals that the interface no longer exists.
    fn note(&mut self, error: &io::Error) {
        if is_gone(error) && self.next_open.is_none() {
            self.next_open = Some(Instant::now() + PAUSE);
        }
    }

    /// Reopens the interface if it exists again.
    fn reopen(&mut self) {
        self.next_open = match open(&self.name) {
            Ok(socket) => {
                self.socket = socket;
                None
            }
            Err(_) => Some(Instant::now() + PAUSE),
        };
    }
}

impl Member for Interface {
    async fn exchange(&mut self, id: ClientId, ClientEnd { mut queue, permits }: ClientEnd, world: &WorldSender) {
        let mut waiting: Option<Waiting> = None;
        loop {
            let next_try = waiting.as_ref().map(|waiting| waiting.next_try);
            tokio::select! {
                () = permits.dismissed() => return,
                // Reception continues while the bus accepts no frame.
                (permit, read) = async {
                    (permits.permit().await, read(&self.socket).await)
                }, if self.next_open.is_none() => match read {
                    Ok(frame) => {
                        tell(world, self.health.hear());
                        // Error frames and CAN FD frames are not requested from the kernel.
                        if let Some(frame) = same(&frame) {
                            spend(permit);
                            world.tell(ToWorld::Send(id, frame));
                        }
                    }
                    Err(error) => {
                        self.note(&error);
                        tell(world, self.health.fail(&error));
                        sleep(PAUSE).await;
                    }
                },
                message = queue.recv(), if waiting.is_none() => match message {
                    Some(ToClient::Frame(_, frame)) => {
                        waiting = same(&frame).map(|frame| Waiting { frame, tries: 0, next_try: Instant::now() });
                    }
                    Some(ToClient::Error(..) | ToClient::Reply(_)) => {}
                    None => return,
                },
                () = until(next_try) => {
                    waiting = waiting.and_then(|waiting| self.send(waiting, world));
                }
                () = until(self.next_open) => self.reopen(),
            }
        }
    }
}

/// Waits until an instant, or forever.
async fn until(instant: Option<Instant>) {
    match instant {
        Some(instant) => sleep_until(instant).await,
        None => pending().await,
    }
}

#[allow(deprecated, reason = "the successor is unsafe; the descriptor of a CanSocket never changes")]
fn open(name: &str) -> io::Result<AsyncFd<CanSocket>> {
    let socket = CanSocket::open(name)?;
    socket.set_nonblocking(true)?;
    AsyncFd::with_interest(socket, Interest::READABLE | Interest::ERROR)
}

/// Waits for a frame or an error, such as the interface going down.
async fn read(socket: &AsyncFd<CanSocket>) -> io::Result<CanFrame> {
    socket.async_io(Interest::READABLE | Interest::ERROR, CanSocket::read_frame).await
}

fn tell(world: &WorldSender, warning: Option<String>) {
    if let Some(warning) = warning {
        world.tell(ToWorld::Warn(warning));
    }
}

/// Converts a frame to another type; `None` for more than eight bytes.
fn same<A: embedded_can::Frame, B: embedded_can::Frame>(frame: &A) -> Option<B> {
    if frame.is_remote_frame() { B::new_remote(frame.id(), frame.dlc()) } else { B::new(frame.id(), frame.data()) }
}

#[cfg(test)]
mod tests {
    use embedded_can::Frame as _;
    use protocol_core::frame::{Frame, extended, standard};

    use super::*;

    #[test]
    fn frames_are_the_same_on_both_sides() {
        let frames = [
            Frame::new(standard(0x7FF), &[1, 2, 3]),
            Frame::new(extended(0x1FFF_FFFF), &[0; 8]),
            Frame::new(standard(0), &[]),
            Frame::new_remote(extended(0x123), 5),
        ];
        for frame in frames.map(|frame| frame.expect("a frame")) {
            let kernels: CanFrame = same(&frame).expect("a frame of the kernel");
            assert_eq!(same(&kernels), Some(frame));
        }
    }

    #[tokio::test]
    async fn an_interface_that_is_not_there_is_an_error() {
        assert!(Interface::open("pve-sim-none").is_err());
    }
}
