//! The client connections, limited in number: a new connection replaces the one that has been idle longest.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use tokio::sync::{Notify, Semaphore, SemaphorePermit};
use tokio_util::sync::CancellationToken;

#[derive(Debug)]
pub(super) struct Connection {
    local: SocketAddr,
    /// The time of the last traffic in either direction.
    last: Mutex<Instant>,
    /// The number of pending requests to the world.
    pending_calls: AtomicUsize,
    dismissed: Notify,
    /// Cancelled at the end of the client's requests.
    ended: CancellationToken,
    /// The permits of calls that wait for virtual time, shared by all connections.
    waits: Arc<Semaphore>,
}

/// The guard of a pending request: while it exists, the connection is not idle.
#[derive(Debug)]
pub(super) struct PendingCall<'a>(&'a Connection);

impl Connection {
    pub(super) const fn local(&self) -> SocketAddr {
        self.local
    }

    /// Marks a request to the world as pending.
    pub(super) fn begin_call(&self) -> PendingCall<'_> {
        self.pending_calls.fetch_add(1, Ordering::Relaxed);
        PendingCall(self)
    }

    /// Returns a permit to wait for virtual time; `None` if all permits are taken.
    pub(super) fn wait(&self) -> Option<SemaphorePermit<'_>> {
        self.waits.try_acquire().ok()
    }

    /// Marks the end of the client's requests: the client has disconnected, or closed its sending half.
    pub(super) fn end_requests(&self) {
        self.ended.cancel();
    }

    /// Returns a token that is cancelled at the end of the client's requests.
    pub(super) const fn ended(&self) -> &CancellationToken {
        &self.ended
    }

    /// Waits until the connection must close.
    pub(super) async fn dismissed(&self) {
        self.dismissed.notified().await;
    }

    /// Records traffic.
    pub(super) fn touch(&self) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    /// Returns the time at which the connection became idle; `None` while a request is pending.
    fn idle_since(&self) -> Option<Instant> {
        let last = *self.last.lock().unwrap_or_else(PoisonError::into_inner);
        (self.pending_calls.load(Ordering::Relaxed) == 0).then_some(last)
    }
}

impl Drop for PendingCall<'_> {
    fn drop(&mut self) {
        self.0.pending_calls.fetch_sub(1, Ordering::Relaxed);
    }
}

#[derive(Debug)]
pub(super) struct Connections {
    places: usize,
    waits: Arc<Semaphore>,
    all: Mutex<Vec<Arc<Connection>>>,
}

impl Connections {
    /// Creates a set for at most `places` connections. Calls that wait for virtual time may occupy at most half of the
    /// places, because their connections are never closed and other clients must still be served.
    pub(super) fn new(places: usize) -> Self {
        let waits = Arc::new(Semaphore::new((places / 2).max(1)));
        Self { places, waits, all: Mutex::default() }
    }

    /// Admits a new connection; a full set first closes the connection that has been idle longest. Returns `None` if
    /// all connections have pending requests.
    pub(super) fn admit(&self, local: SocketAddr) -> Option<Arc<Connection>> {
        let mut all = self.lock();
        if all.len() >= self.places {
            let quiet = all.iter().enumerate().filter_map(|(place, other)| Some((other.idle_since()?, place)));
            let (_, quietest) = quiet.min()?;
            all.swap_remove(quietest).dismissed.notify_one();
        }
        let connection = Arc::new(Connection {
            local,
            last: Mutex::new(Instant::now()),
            pending_calls: AtomicUsize::new(0),
            dismissed: Notify::new(),
            ended: CancellationToken::new(),
            waits: Arc::clone(&self.waits),
        });
        all.push(Arc::clone(&connection));
        Some(connection)
    }

    pub(super) fn leave(&self, connection: &Arc<Connection>) {
        self.lock().retain(|other| !Arc::ptr_eq(other, connection));
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Arc<Connection>>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quietest_connection_makes_room_and_none_that_waits_for_the_world() {
        let local = "127.0.0.1:8408".parse().expect("an address");
        let connections = Connections::new(2);
        let (first, second) = (connections.admit(local).expect("a place"), connections.admit(local).expect("a place"));
        let pending_calls = first.begin_call();
        let third = connections.admit(local).expect("the place of the second");
        let left: Vec<_> = connections.lock().iter().map(Arc::as_ptr).collect();
        assert!(left.contains(&Arc::as_ptr(&first)) && left.contains(&Arc::as_ptr(&third)), "{second:?} went");
        let _other = third.begin_call();
        assert!(connections.admit(local).is_none());
        drop(pending_calls);
        let fourth = connections.admit(local).expect("the place of the first");
        connections.leave(&third);
        connections.leave(&fourth);
        assert!(connections.lock().is_empty());
    }

    #[test]
    fn calls_that_wait_take_half_of_the_places_at_the_most() {
        let local = "127.0.0.1:8408".parse().expect("an address");
        for (places, room) in [(256, 128), (5, 2), (1, 1)] {
            let connections = Connections::new(places);
            let all: Vec<_> = (0..places).filter_map(|_| connections.admit(local)).collect();
            let mut waits: Vec<_> = all.iter().filter_map(|connection| connection.wait()).collect();
            assert_eq!(waits.len(), room);
            waits.pop();
            assert!(all[0].wait().is_some(), "one that has its answer makes room");
        }
    }
}
