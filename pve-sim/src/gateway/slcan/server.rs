//! The gateway over TCP; clients connect as to a serial port server: `socket://HOST:PORT`.

use std::fmt;
use std::sync::Arc;

use tokio::sync::Semaphore;

use super::session::Session;
use crate::gateway::tcp::{Endpoint, Listener, joinable};
use crate::gateway::{Access, Address, Gateway, Opening, Parse, Scheme};
use crate::inbox::WorldSender;

const FORM: &str = "slcan://HOST:PORT";

/// The URL scheme of this gateway.
pub(in crate::gateway) const SCHEME: Scheme = Scheme { prefix: "slcan://", form: FORM, parse: Parse::With(parse) };

/// The address of the served adapter.
#[derive(Clone, Debug)]
struct ServerAddress(Endpoint);

fn parse(rest: &str) -> Result<Arc<dyn Address>, String> {
    Endpoint::parse(rest, FORM).map(|endpoint| Arc::new(ServerAddress(endpoint)) as Arc<dyn Address>)
}

impl fmt::Display for ServerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "slcan://{}", self.0)
    }
}

impl Address for ServerAddress {
    fn open(&self, _: Access) -> Opening<'_> {
        Box::pin(async move {
            let listener = self.0.bind(|endpoint| ServerAddress(endpoint.clone()).to_string()).await?;
            Ok(Box::new(Server(listener)) as Box<dyn Gateway>)
        })
    }
}

/// A server at an address that simulates one adapter per client.
#[derive(Debug)]
struct Server(Listener);

impl Gateway for Server {
    fn url(&self) -> String {
        format!("slcan://{}", self.0.address)
    }

    fn hint(&self) -> String {
        let port = format!("socket://{}", joinable(self.0.address));
        format!(
            "Join the bus with python-can and pyserial:\n  \
             can_logger -i slcan -c {port} --bus-kwargs sleep_after_open=0\n  \
             can.Bus(interface=\"slcan\", channel=\"{port}\", sleep_after_open=0)"
        )
    }

    fn start(self: Box<Self>, world: WorldSender, places: Arc<Semaphore>) {
        let url = self.url();
        let name: Arc<str> = url.as_str().into();
        tokio::spawn(self.0.run(url, world, places, move || Session::new(Arc::clone(&name))));
    }
}
