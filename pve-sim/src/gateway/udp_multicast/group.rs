//! A multicast group: its sockets, and the frames through them.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket as StdSocket};
use std::time::Duration;

use protocol_core::frame::Frame;
use socket2::{Domain, Socket, Type};
use tokio::net::UdpSocket;
use tokio::time::sleep;

use super::message::{emit, parse};
use crate::gateway::Member;
use crate::inbox::{ClientEnd, ClientId, ToClient, ToWorld, WorldSender, spend};

/// The hop limit towards other machines: python-can's default, the local network.
const HOPS: u32 = 1;

/// The size of the receive buffer. Longer datagrams are truncated and therefore invalid; a frame takes about 200 bytes.
const DATAGRAM_MAX: usize = 4096;

/// The delay after a read error.
const PAUSE: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(super) struct Group {
    incoming: UdpSocket,
    outgoing: UdpSocket,
    intake: Intake,
    /// Whether the user was told that frames cannot be sent.
    is_in_trouble: bool,
}

/// The filter of received datagrams.
#[derive(Debug)]
struct Intake {
    group: SocketAddr,
    /// The address of this gateway's sending socket, whose datagrams are looped back.
    own: SocketAddr,
    /// Whether datagrams from other machines are accepted.
    is_remote: bool,
    /// Whether the user was told about an ignored datagram.
    has_warned: bool,
}

impl Group {
    /// Joins a group; requires a Tokio runtime.
    ///
    /// # Errors
    /// When no interface supports multicast, or another program has the port exclusively.
    pub(super) fn join(address: SocketAddr, is_remote: bool) -> io::Result<Self> {
        let incoming = incoming(address).map_err(|error| with_remedy(error, address))?;
        let outgoing =
            outgoing(address, if is_remote { HOPS } else { 0 }).map_err(|error| with_remedy(error, address))?;
        let intake = Intake { group: address, own: outgoing.local_addr()?, is_remote, has_warned: false };
        Ok(Self { incoming, outgoing, intake, is_in_trouble: false })
    }

    /// Records the result of sending a datagram. Returns a message for the user when sending begins to fail or works
    /// again.
    fn note(&mut self, error: Option<io::Error>) -> Option<String> {
        let was_in_trouble = std::mem::replace(&mut self.is_in_trouble, error.is_some());
        let text = match (was_in_trouble, error) {
            (false, Some(error)) => format!("{error}: no frames are sent until this is resolved"),
            (true, None) => "sending frames again".to_owned(),
            (false, None) | (true, Some(_)) => return None,
        };
        Some(format!("udp-multicast://{}: {text}", self.intake.group))
    }
}

impl Member for Group {
    async fn exchange(&mut self, id: ClientId, ClientEnd { mut queue, permits }: ClientEnd, world: &WorldSender) {
        let mut datagram = [0; DATAGRAM_MAX];
        loop {
            tokio::select! {
                () = permits.dismissed() => return,
                // Reception continues while the bus accepts no frame.
                (permit, read) = async {
                    (permits.permit().await, self.incoming.recv_from(&mut datagram).await)
                } => match read {
                    Ok((len, from)) => match self.intake.take(&datagram[..len], from) {
                        Ok(Some(frame)) => {
                            spend(permit);
                            world.tell(ToWorld::Send(id, frame));
                        }
                        Ok(None) => {}
                        Err(warning) => world.tell(ToWorld::Warn(warning)),
                    },
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
}

impl Intake {
    /// Returns the frame of a datagram; `None` for a datagram of this gateway, and for every ignored datagram after the
    /// first.
    ///
    /// # Errors
    /// A message for the user about the first ignored datagram.
    fn take(&mut self, datagram: &[u8], from: SocketAddr) -> Result<Option<Frame>, String> {
        if from == self.own {
            return Ok(None);
        }
        let ignored = if self.is_remote || is_of_this_machine(from) {
            match parse(datagram) {
                Ok(frame) => return Ok(Some(frame)),
                Err(reason) => reason.to_owned(),
            }
        } else {
            format!("a datagram from remote host {}; use --allow-remote to accept it", from.ip())
        };
        if std::mem::replace(&mut self.has_warned, true) {
            return Ok(None);
        }
        Err(format!(
            "udp-multicast://{}: ignored {ignored}. Further datagrams are ignored without a warning",
            self.group
        ))
    }
}

/// Returns whether an address belongs to this machine, by binding a socket to the address.
fn is_of_this_machine(mut address: SocketAddr) -> bool {
    address.set_port(0);
    StdSocket::bind(address).is_ok()
}

/// Adds the remedy to the error of a group without a route.
#[cfg(target_os = "linux")]
fn with_remedy(error: io::Error, group: SocketAddr) -> io::Error {
    use rustix::io::Errno;
    match Errno::from_io_error(&error) {
        Some(Errno::NODEV | Errno::NETUNREACH) if group.is_ipv4() => io::Error::other(format!(
            "{error}; no route for the group: 'ip route add 224.0.0.0/4 dev lo' keeps it on this machine"
        )),
        _ => error,
    }
}

#[cfg(not(target_os = "linux"))]
fn with_remedy(error: io::Error, _: SocketAddr) -> io::Error {
    error
}

/// Creates a socket that receives the group's datagrams. Like python-can, it joins on the interface through which the
/// system sends to the group.
fn incoming(group: SocketAddr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(group), Type::DGRAM, None)?;
    // Other programs on this machine also use the port.
    socket.set_reuse_address(true)?;
    #[cfg(unix)]
    socket.set_reuse_port(true)?;
    // Unix can bind to a group; the socket then receives no other datagrams to the port.
    let bound = if cfg!(unix) { group } else { SocketAddr::new(unspecified(group), group.port()) };
    socket.bind(&bound.into())?;
    match group.ip() {
        IpAddr::V4(group) => socket.join_multicast_v4(&group, &Ipv4Addr::UNSPECIFIED)?,
        IpAddr::V6(group) => socket.join_multicast_v6(&group, 0)?,
    }
    to_tokio(socket)
}

/// Creates a socket that sends to the group, at most `hops` hops away.
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

#[cfg(test)]
mod tests {
    use protocol_core::frame::standard;

    use tokio::time::timeout;

    use super::*;
    use crate::inbox::{ClientQueue, Inbox, PERMITS};
    use hal_sim::log::Timestamp;

    const GROUP: &str = "239.74.163.2:43113";

    fn intake(is_remote: bool) -> Intake {
        let parse = |text: &str| text.parse().expect("an address");
        Intake { group: parse(GROUP), own: parse("127.0.0.1:1"), is_remote, has_warned: false }
    }

    fn datagram() -> (Vec<u8>, Frame) {
        let frame = Frame::of(standard(0x123).into(), &[1]).expect("a frame");
        (emit(Timestamp::from_micros(0), &frame), frame)
    }

    #[test]
    fn datagrams_of_ones_own_and_of_other_machines_are_no_frames() {
        let (datagram, frame) = datagram();
        let from = |text: &str| text.parse().expect("an address");
        let mut intake = intake(false);
        assert_eq!(intake.take(&datagram, from("127.0.0.1:1")), Ok(None));
        assert_eq!(intake.take(&datagram, from("127.0.0.1:2")), Ok(Some(frame)), "another program");
        let told = intake.take(&datagram, from("192.0.2.1:1")).expect_err("it is told");
        let expected = "udp-multicast://239.74.163.2:43113: ignored a datagram from remote host 192.0.2.1; use --allow-remote \
                        to accept it. Further datagrams are ignored without a warning";
        assert_eq!(told, expected);
        assert_eq!(intake.take(&datagram, from("192.0.2.1:1")), Ok(None));
        assert_eq!(intake.take(b"GET / HTTP/1.1", from("127.0.0.1:2")), Ok(None), "told once, of whatever kind");
        assert_eq!(self::intake(true).take(&datagram, from("192.0.2.1:1")), Ok(Some(frame)));
    }

    /// Returns a gateway with sockets for its input and output.
    async fn group() -> (Group, UdpSocket, UdpSocket) {
        let bind = || UdpSocket::bind("127.0.0.1:0");
        let (incoming, outgoing) = (bind().await.expect("a socket"), bind().await.expect("a socket"));
        let (sender, listener) = (bind().await.expect("a socket"), bind().await.expect("a socket"));
        sender.connect(incoming.local_addr().expect("its address")).await.expect("an address");
        outgoing.connect(listener.local_addr().expect("its address")).await.expect("an address");
        let group = Group { incoming, outgoing, intake: intake(false), is_in_trouble: false };
        (group, sender, listener)
    }

    /// Returns the queue of a gateway that has joined.
    fn joined(inbox: &Inbox) -> ClientQueue {
        let messages = std::iter::from_fn(|| inbox.messages.try_recv().ok()).map(|arrival| arrival.message);
        let to_client = messages
            .filter_map(|message| if let ToWorld::Join(_, to_client) = message { Some(to_client) } else { None });
        let to_client = to_client.last().expect("it has joined");
        to_client.refund(1);
        to_client
    }

    /// Sends datagrams until the gateway's permits are spent.
    async fn flood(sender: &UdpSocket, inbox: &Inbox) {
        let (datagram, _) = datagram();
        for _ in 0..PERMITS {
            sender.send(&datagram).await.expect("room");
            while inbox.messages.try_recv().is_err() {
                tokio::task::yield_now().await;
            }
        }
        sender.send(&datagram).await.expect("room");
        // A gateway that wrongly read the datagram would have done so by then.
        sleep(PAUSE).await;
        assert!(inbox.messages.try_recv().is_err(), "the permits are spent");
    }

    #[tokio::test]
    async fn a_group_whose_frames_wait_for_the_bus_hears_it_all_the_same() {
        let (world, inbox) = WorldSender::new();
        let (group, sender, listener) = group().await;
        tokio::spawn(group.run(world));
        let to_client = joined(&inbox);
        flood(&sender, &inbox).await;
        let (expected, frame) = datagram();
        to_client.post(ToClient::Frame(Timestamp::from_micros(0), frame)).expect("room");
        let mut heard = [0; DATAGRAM_MAX];
        let len =
            timeout(Duration::from_secs(5), listener.recv(&mut heard)).await.expect("it is heard").expect("a datagram");
        assert_eq!(&heard[..len], expected);
        to_client.refund(1);
        while inbox.messages.try_recv().is_err() {
            tokio::task::yield_now().await;
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_group_without_a_route_names_the_way_out() {
        use rustix::io::Errno;
        let told = |errno: Errno, group: &str| with_remedy(errno.into(), group.parse().expect("a group")).to_string();
        let way_out = "no route for the group: 'ip route add 224.0.0.0/4 dev lo' keeps it on this machine";
        for errno in [Errno::NODEV, Errno::NETUNREACH] {
            let missing = told(errno, GROUP);
            assert!(missing.contains(" (os error ") && missing.ends_with(way_out), "{missing}");
            assert!(!told(errno, "[ff15:7079:7468::1]:43113").contains("224.0.0.0"));
        }
        assert!(!told(Errno::ADDRINUSE, GROUP).contains("ip route"));
    }

    #[test]
    fn nonsense_is_told_once() {
        let from: SocketAddr = "127.0.0.1:2".parse().expect("an address");
        let mut intake = intake(false);
        let told = intake.take(b"", from).expect_err("it is told");
        assert!(told.contains(": ignored a datagram that is not a python-can message."), "{told}");
        assert_eq!(intake.take(b"", from), Ok(None));
    }
}
