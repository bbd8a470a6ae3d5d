//! Gateways: connect clients outside the simulator to the bus.
//!
//! ```text
//! bus_url        the URLs of --bus, with a variant for every gateway
//! tcp            gateways over TCP: the listening socket and its clients
//! guard          the guard of connections over TCP against web pages
//! session        the session of one client over a stream
//! socketcand/    a bus over TCP in readable text
//! socketcan/     an interface of the Linux kernel
//! slcan/         an adapter on a serial line, over TCP or on a pseudo-terminal
//! udp_multicast/ the bus of python-can's udp_multicast
//! ```

mod bus_url;
mod guard;
mod session;
pub mod slcan;
#[cfg(target_os = "linux")]
mod socketcan;
pub mod socketcand;
mod tcp;
pub mod udp_multicast;

pub use bus_url::BusUrl;
pub use guard::{ForeignWarning, Judge, Verdict};
pub use session::{Client, Dialogue, End};
pub use tcp::{Endpoint, enter};
pub(crate) use tcp::{WAITING, joinable};

use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::inbox::{ClientEnd, ClientId, ToWorld, WorldSender};

/// An open gateway that does not serve clients yet. Dropping the value closes the gateway.
pub struct Gateway {
    /// The URL of the bus with the bound port.
    pub url: String,
    /// An example command for joining.
    pub hint: String,
    start: Box<dyn FnOnce(WorldSender, Arc<Semaphore>)>,
}

impl Gateway {
    /// Creates a gateway. `serve` starts it and returns the future that serves clients. A [`Member`] joins the world
    /// before `serve` returns.
    fn new<F: Future<Output = ()> + Send + 'static>(
        url: String,
        hint: String,
        serve: impl FnOnce(WorldSender, Arc<Semaphore>) -> F + 'static,
    ) -> Self {
        Self { url, hint, start: Box::new(|world, places| drop(tokio::spawn(serve(world, places)))) }
    }

    /// Serves clients until the caller's runtime ends. Each client of a server occupies one of the `places`.
    pub fn start(self, world: WorldSender, places: Arc<Semaphore>) {
        (self.start)(world, places);
    }
}

/// A gateway that is a single client of the world for the whole run: a multicast group, a kernel interface.
trait Member: Send + Sized {
    /// Passes frames in both directions. Returns only when the queue of the gateway overruns.
    fn exchange(&mut self, id: ClientId, client_end: ClientEnd, world: &WorldSender)
    -> impl Future<Output = ()> + Send;

    /// Joins the world, and returns a future that passes frames forever. The join precedes the future, so that the
    /// gateway receives the first frame of a world that starts later.
    fn run(mut self, world: WorldSender) -> impl Future<Output = ()> + Send {
        let mut joined = world.join();
        async move {
            loop {
                let (id, client_end) = joined;
                // Offsets the refund for joining, as `join` requires.
                client_end.permits.spend().await;
                self.exchange(id, client_end, &world).await;
                // An overrun drops the pending frames, and the gateway joins again.
                world.tell(ToWorld::Leave(id));
                joined = world.join();
            }
        }
    }
}
