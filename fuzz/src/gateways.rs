//! Streams and datagrams for the gateways.

mod slcan;
mod socketcand;
mod udp_multicast;

use std::sync::Arc;
use std::time::Duration;

use hal_sim::simulation::Simulation;
use hal_sim::{BitRate, Frame};
use pve_sim::gateway::{Dialogue, ForeignWarning, enter};
use tokio::io::split;

use self::slcan::Slcan;
use self::socketcand::Socketcand;
use crate::simulator::{Simulator, Stranger, play};

/// The maximum length of a stream, in bytes. Each piece is one read.
const STREAM_MAX: usize = 4096;

/// The message after which socketcand holds everything back for 20 ms.
const RAW_MODE: &[u8] = b"rawmode";

/// The time for the frames of a stream, per byte. A frame takes more than five bytes, and 540 µs at most.
const BYTE: Duration = Duration::from_micros(108);

/// Plays a client of any bytes. The first byte selects the gateway: `l` slcan, `u` a datagram of udp_multicast, others
/// socketcand. The second byte selects the pieces of the stream.
///
/// A second parser of the bytes gives the expected answers and the only frames on the bus. Afterwards this client and
/// the next one are served.
pub fn gateways(bytes: &[u8]) {
    match bytes {
        [b'u', _, datagram @ ..] => udp_multicast::datagram(datagram),
        [b'l', cut, stream @ ..] => play(converse(Slcan::default(), *cut, stream)),
        [_, cut, stream @ ..] => play(converse(Socketcand::default(), *cut, stream)),
        _ => {}
    }
}

/// A second parser of a protocol.
trait Model {
    /// The end of an incomplete message, and a request for a sign of life.
    const LAST_WORD: &'static [u8];

    /// The bytes of a new client that sends 123#0A, and its expected answer.
    const NEXT: (&'static [u8], &'static str);

    /// Returns the dialogue with a new client.
    fn dialogue() -> impl Dialogue + 'static;

    /// Takes the bytes of one read.
    fn read(&mut self, piece: &[u8]);

    /// Returns whether the connection was closed because of foreign first bytes.
    fn is_foreign(&self) -> bool;

    /// Asserts the answers to the client.
    fn check_answers(&self, heard: &str);

    /// Asserts the frames on the bus.
    fn check_frames(&self, frames: &[Frame]);

    /// Asserts the output to the client for a frame 7FF#01 of another node.
    fn check_heard(&self, heard: &str);
}

/// Cuts a stream into the pieces in which it arrives.
fn pieces(mut stream: &[u8], cut: u8) -> impl Iterator<Item = &[u8]> {
    let mut seed = u32::from(cut);
    std::iter::from_fn(move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let longest =
            if cut == b'0' { stream.len() } else { 1 + (seed >> 24) as usize % (1 + usize::from(cut & 0x3F)) };
        let (piece, rest) = stream.split_at(longest.min(stream.len()));
        stream = rest;
        (!piece.is_empty()).then_some(piece)
    })
}

async fn converse<M: Model>(mut model: M, cut: u8, stream: &[u8]) {
    if stream.len() > STREAM_MAX {
        return;
    }
    let mut simulator = Simulator::new(Simulation::new(BitRate::Kbit250, 1), |driver| driver);
    let warning = Arc::new(ForeignWarning::new("tcp".to_owned(), simulator.world_sender.clone()));
    let join = |simulator: &Simulator| {
        let (stranger, far) = Stranger::new();
        let (reader, writer) = split(far);
        tokio::spawn(enter(reader, writer, simulator.world_sender.clone(), Arc::clone(&warning), M::dialogue()));
        stranger
    };
    let mut stranger = join(&simulator);
    simulator.settle().await;
    for piece in pieces(stream, cut).chain([M::LAST_WORD]) {
        stranger.say(piece).await;
        simulator.settle().await;
        model.read(piece);
    }
    let modes = stream.windows(RAW_MODE.len()).filter(|word| *word == RAW_MODE).count();
    simulator.pass(Duration::from_millis(20) * (1 + modes as u32) + BYTE * stream.len() as u32).await;
    let (heard, has_hung_up) = stranger.heard();
    assert_eq!(has_hung_up, model.is_foreign(), "{}", String::from_utf8_lossy(&heard));
    model.check_answers(&String::from_utf8(heard).expect("text"));
    model.check_frames(&simulator.witnessed());
    simulator.send(&"7FF: 01".parse().expect("a frame"));
    simulator.pass(Duration::from_millis(30)).await;
    model.check_heard(&String::from_utf8(stranger.heard().0).expect("text"));
    stranger.leave().await;
    simulator.pass(Duration::from_millis(10)).await;
    simulator.witnessed();
    let mut next = join(&simulator);
    next.say(M::NEXT.0).await;
    simulator.settle().await;
    simulator.pass(Duration::from_millis(50)).await;
    assert_eq!(String::from_utf8_lossy(&next.heard().0), M::NEXT.1);
    assert_eq!(simulator.witnessed(), ["123: 0A".parse::<Frame>().expect("a frame")], "of the next client");
    let stderr = simulator.end();
    assert_eq!(stderr.matches("closed a connection").count(), usize::from(model.is_foreign()), "{stderr}");
    assert!(stderr.lines().count() <= 2, "{stderr}");
}
