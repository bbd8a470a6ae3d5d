//! Gateways that are one client of the world for as long as it runs: a multicast group, an interface of the kernel.

use crate::inbox::{ClientEnd, ClientId, ToWorld, WorldSender};

/// A gateway that is one client of the world.
pub(super) trait Member: Send + Sized {
    /// Passes frames. Ends only when more of them came than the gateway takes.
    fn pass(&mut self, id: ClientId, client_end: ClientEnd, world: &WorldSender) -> impl Future<Output = ()> + Send;

    /// Joins the world at once, so that a world that starts later sends its first frame to the gateway, too; the returned
    /// future passes frames for ever.
    fn run(mut self, world: WorldSender) -> impl Future<Output = ()> + Send {
        let mut joined = world.join();
        async move {
            loop {
                let (id, client_end) = joined;
                // What the world gives back for joining.
                client_end.permits.spend().await;
                self.pass(id, client_end, &world).await;
                // What waits is dropped, and the gateway joins anew.
                world.tell(ToWorld::Leave(id));
                joined = world.join();
            }
        }
    }
}
