//! Gateways that are a single client of the world for the whole run: a multicast group, a kernel interface.

use crate::inbox::{ClientEnd, ClientId, ToWorld, WorldSender};

/// A gateway that is a single client of the world.
pub(super) trait Member: Send + Sized {
    /// Passes frames in both directions. Returns only when the gateway's queue overruns.
    fn pass(&mut self, id: ClientId, client_end: ClientEnd, world: &WorldSender) -> impl Future<Output = ()> + Send;

    /// Joins the world at once, so that a world started later sends its first frame to the gateway, too. The returned
    /// future passes frames forever.
    fn run(mut self, world: WorldSender) -> impl Future<Output = ()> + Send {
        let mut joined = world.join();
        async move {
            loop {
                let (id, client_end) = joined;
                // The permit that the world returns for joining.
                client_end.permits.spend().await;
                self.pass(id, client_end, &world).await;
                // An overrun drops the waiting frames, and the gateway joins again.
                world.tell(ToWorld::Leave(id));
                joined = world.join();
            }
        }
    }
}
