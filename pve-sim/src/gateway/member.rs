//! Gateways that are a single client of the world for the whole run: a multicast group, a kernel interface.

use crate::inbox::{ClientEnd, ClientId, ToWorld, WorldSender};

/// A gateway that is a single client of the world.
pub(super) trait Member: Send + Sized {
    /// Passes frames in both directions. Returns only when the queue of the gateway overruns.
    fn pass(&mut self, id: ClientId, client_end: ClientEnd, world: &WorldSender) -> impl Future<Output = ()> + Send;

    /// Joins the world immediately, so that the gateway receives the first frame of a world started later. The returned
    /// future passes frames forever.
    fn run(mut self, world: WorldSender) -> impl Future<Output = ()> + Send {
        let mut joined = world.join();
        async move {
            loop {
                let (id, client_end) = joined;
                // Receives the permit that the world returns for joining.
                client_end.permits.spend().await;
                self.pass(id, client_end, &world).await;
                // An overrun drops the pending frames, and the gateway joins again.
                world.tell(ToWorld::Leave(id));
                joined = world.join();
            }
        }
    }
}
