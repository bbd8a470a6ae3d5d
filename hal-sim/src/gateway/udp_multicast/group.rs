//! A multicast group: its sockets, and the way of frames through them.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket as StdSocket};
use std::time::Duration;

use socket2::{Domain, Socket, Type};
use tokio::net::UdpSocket;
use tokio::time::sleep;

use super::message::{emit, parse};
use crate::gateway::{ClientId, Entrance, Mailbox, ToClient, ToWorld};

/// The hops of a datagram that is to reach other machines: python-can's default, the local network.
const HOPS: u32 = 1;

/// The longest datagram that is read: longer ones are cut off, and are no message then. That of a frame has some 200 bytes.
const DATAGRAM_MAX: usize = 4096;

/// How long to wait after an error of a read.
const PAUSE: Duration = Duration::from_millis(100);

/// A group that was joined.
#[derive(Debug)]
pub(super) struct Group {
    address: SocketAddr,
    /// Whether other machines take part.
    is_remote: bool,
    incoming: UdpSocket,
    outgoing: UdpSocket,
    /// Where datagrams of this gateway come from: they come back.
    own: SocketAddr,
    /// Whether the user knows that datagrams are ignored.
    has_told_ignored: bool,
    /// Whether the user knows that frames do not get out.
    is_in_trouble: bool,
}

impl Group {
    /// Joins a group. Needs a Tokio runtime.
    ///
    /// # Errors
    /// When no interface takes multicast, or another program has the port for itself.
    pub(super) fn join(address: SocketAddr, is_remote: bool) -> io::Result<Self> {
        let incoming = incoming(address)?;
        let outgoing = outgoing(address, if is_remote { HOPS } else { 0 })?;
        let own = outgoing.local_addr()?;
        let (has_told_ignored, is_in_trouble) = (false, false);
        Ok(Self { address, is_remote, incoming, outgoing, own, has_told_ignored, is_in_trouble })
    }

    /// Joins the world at once, so that a world that starts later sends its first frame to the group, too; the returned
    /// future passes frames for ever.
    pub(super) fn run(mut self, world: Entrance) -> impl Future<Output = ()> + Send {
        let mut joined = world.join();
        async move {
            loop {
                let (id, mailbox) = joined;
                // It ends only when more frames came than the system takes: what waits is dropped, and it joins anew.
                self.pass(id, mailbox, &world).await;
                world.tell(ToWorld::Leave(id));
                joined = world.join();
            }
        }
    }

    async fn pass(&mut self, id: ClientId, Mailbox { mut queue, leash }: Mailbox, world: &Entrance) {
        // What the world gives back for joining.
        leash.spend().await;
        let mut datagram = [0; DATAGRAM_MAX];
        loop {
            tokio::select! {
                () = leash.dismissed() => return,
                read = self.incoming.recv_from(&mut datagram) => match read {
                    Ok((len, from)) => {
                        if let Some(message) = self.take(&datagram[..len], from, id) {
                            if matches!(message, ToWorld::Send(..)) {
                                leash.spend().await;
                            }
                            world.tell(message);
                        }
                    }
                    Err(_) => sleep(PAUSE).await,
                },
                message = queue.recv() => match message {
                    Some(ToClient::Frame(at, frame)) => {
                        let sent = self.outgoing.send(&emit(at, &frame)).await;
                        if let Some(warning) = self.note(sent.err()) {
                            world.tell(ToWorld::Warn(warning));
                        }
                    }
                    Some(ToClient::Error(..) | ToClient::Reply(_)) => {}
                    None => return,
                },
            }
        }
    }

    /// Takes a datagram for what it is: a frame, or something that the user is told of once.
    fn take(&mut self, datagram: &[u8], from: SocketAddr, id: ClientId) -> Option<ToWorld> {
        if from == self.own {
            return None;
        }
        let ignored = if self.is_remote || is_of_this_machine(from) {
            match parse(datagram) {
                Ok(frame) => return Some(ToWorld::Send(id, frame)),
                Err(reason) => reason.to_string(),
            }
        } else {
            format!("a datagram of another machine, {}, without --allow-remote", from.ip())
        };
        let is_known = std::mem::replace(&mut self.has_told_ignored, true);
        (!is_known).then(|| {
            ToWorld::Warn(format!("udp-multicast://{}: {ignored} was ignored; more of them are not told", self.address))
        })
    }

    /// Takes note of a datagram that was sent, or was not; returns what the user is told.
    fn note(&mut self, error: Option<io::Error>) -> Option<String> {
        let was_in_trouble = std::mem::replace(&mut self.is_in_trouble, error.is_some());
        let text = match (was_in_trouble, error) {
            (false, Some(error)) => format!("{error}: nothing is sent until frames pass again"),
            (true, None) => "frames pass again".to_owned(),
            (false, None) | (true, Some(_)) => return None,
        };
        Some(format!("udp-multicast://{}: {text}", self.address))
    }
}

/// Whether an address is one of this machine: no other can be bound.
fn is_of_this_machine(mut address: SocketAddr) -> bool {
    address.set_port(0);
    StdSocket::bind(address).is_ok()
}

/// A socket that gets what is sent to the group, on the interface to which the system sends it: python-can has it so.
fn incoming(group: SocketAddr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(group), Type::DGRAM, None)?;
    // Others on this machine have the port, too.
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    // Only Unix binds a group, which keeps other datagrams of the port away.
    let bound = if cfg!(unix) { group } else { SocketAddr::new(unspecified(group), group.port()) };
    socket.bind(&bound.into())?;
    match group.ip() {
        IpAddr::V4(group) => socket.join_multicast_v4(&group, &Ipv4Addr::UNSPECIFIED)?,
        IpAddr::V6(group) => socket.join_multicast_v6(&group, 0)?,
    }
    to_tokio(socket)
}

/// A socket that sends to the group.
fn outgoing(group: SocketAddr, hops: u32) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(group), Type::DGRAM, None)?;
    match group {
        SocketAddr::V4(_) => socket.set_multicast_ttl_v4(hops)?,
        SocketAddr::V6(_) => socket.set_multicast_hops_v6(hops)?,
    }
    socket.bind(&SocketAddr::new(unspecified(group), 0).into())?;
    socket.connect(&group.into())?;
    to_tokio(socket)
}

fn to_tokio(socket: Socket) -> io::Result<UdpSocket> {
    socket.set_nonblocking(true)?;
    UdpSocket::from_std(socket.into())
}

const fn unspecified(like: SocketAddr) -> IpAddr {
    match like {
        SocketAddr::V4(_) => IpAddr::V4(Ipv4Addr::UNSPECIFIED),
        SocketAddr::V6(_) => IpAddr::V6(Ipv6Addr::UNSPECIFIED),
    }
}
