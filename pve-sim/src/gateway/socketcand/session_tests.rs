//! One client over a stream in memory; a thread plays the world: it replies in order and keeps the sent frames.

use protocol_core::frame::{Frame, standard};
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _, DuplexStream, duplex, split};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio::time::Instant;

use super::*;
use crate::gateway::session::End;
use crate::gateway::tcp::{DRAIN_TIMEOUT, OPEN_TIMEOUT};
use crate::gateway::{ForeignWarning, enter};
use crate::inbox::{Arrival, Inbox, QUEUE, WorldSender};
use hal_sim::log::{ErrorClass, Timestamp};

/// The buffer size of the stream.
const STREAM: usize = 64 * 1024;

fn frame(data: &[u8]) -> Frame {
    Frame::of(standard(0x18A).into(), data).unwrap()
}

fn seen(data: &[u8]) -> ToClient {
    ToClient::Frame(Timestamp::from_micros(1_000_000), frame(data))
}

/// A client's end of a session, and the world's end of all its messages.
struct Setup {
    client: DuplexStream,
    /// The frames that the client sent, once it has left.
    sent: oneshot::Receiver<Vec<Frame>>,
}

/// Serves a client over a stream with this buffer size.
fn serve(room: usize) -> (DuplexStream, Inbox, JoinHandle<End>) {
    let (client, server) = duplex(room);
    let (sender, inbox) = WorldSender::new();
    let (reader, writer) = split(server);
    let warning = Arc::new(ForeignWarning::new("socketcand://".to_owned(), sender.clone()));
    (client, inbox, tokio::spawn(enter(reader, writer, sender, warning, Session::new("pve0".into()))))
}

/// Serves a client. The world posts `on_listen` as soon as the client listens.
fn setup(on_listen: Vec<ToClient>) -> Setup {
    let (client, inbox, _session) = serve(STREAM);
    let (result, sent) = oneshot::channel();
    std::thread::spawn(move || result.send(world(&inbox, &on_listen)));
    Setup { client, sent }
}

fn world(inbox: &Inbox, on_listen: &[ToClient]) -> Vec<Frame> {
    let mut sent = Vec::new();
    let mut to_client = None;
    for Arrival { message, .. } in &inbox.messages {
        match message {
            ToWorld::Join(_, joined) => to_client = Some(joined),
            ToWorld::Leave(_) => to_client = None,
            ToWorld::End => break,
            other => {
                let to_client = to_client.as_ref().expect("a client that is there");
                to_client.refund(1);
                match other {
                    ToWorld::Send(_, frame) => sent.push(frame),
                    ToWorld::Reply(_, reply) => to_client.post(ToClient::Reply(reply)).expect("room"),
                    ToWorld::Listen(_, reply) => {
                        to_client.post(ToClient::Reply(reply)).expect("room");
                        // a dismissed client is informed by its session
                        let _ = on_listen.iter().try_for_each(|message| to_client.post(message.clone()));
                    }
                    _ => {}
                }
            }
        }
    }
    sent
}

/// Reads the next message, with exactly the expected number of bytes.
async fn expect(client: &mut (impl AsyncRead + Unpin), text: &str) {
    let mut bytes = vec![0; text.len()];
    client.read_exact(&mut bytes).await.expect(text);
    assert_eq!(String::from_utf8_lossy(&bytes), text);
}

async fn say(client: &mut (impl AsyncWrite + Unpin), text: &str) {
    client.write_all(text.as_bytes()).await.expect(text);
}

#[tokio::test(start_paused = true)]
async fn frames_are_held_back_after_raw_mode_was_answered() {
    let mut setup =
        setup(vec![seen(&[1, 2]), ToClient::Error(Timestamp::from_micros(2), ErrorClass::BusOff), seen(&[])]);
    say(&mut setup.client, "< open pve0 >< rawmode >").await;
    expect(&mut setup.client, "< hi >< ok >< ok >").await;
    let answered = Instant::now();
    expect(&mut setup.client, "< frame 18A 1.000000 0102 >").await;
    assert!(answered.elapsed() >= HOLD_BACK, "after {:?}", answered.elapsed());
    expect(&mut setup.client, "< error 040 0.000002 >< frame 18A 1.000000  >").await;
}

#[tokio::test]
async fn the_handshake_in_its_order_and_out_of_it() {
    let mut setup = setup(Vec::new());
    expect(&mut setup.client, "< hi >").await;
    for (request, answer) in [
        ("< rawmode >", "< error open the bus first >"),
        ("< send 18A 0 >", "< error open the bus first >"),
        ("< echo >", "< echo >"),
        ("< open can0 >", "< error unknown bus; accepted: pve0 >"),
        ("< open pve0 >", "< ok >"),
        ("< open pve0 >", "< error the bus is already open >"),
        ("< bcmmode >", "< error unknown command; accepted: open, rawmode, send, echo >"),
        ("< send 18A 2 1 f >< echo >", "< echo >"),
        ("< send 18A 2 1 >", "< error length and number of bytes differ >"),
        ("< rawmode >", "< ok >"),
        ("< rawmode >", "< ok >"),
        ("junk< echo >junk", "< echo >"),
    ] {
        say(&mut setup.client, request).await;
        expect(&mut setup.client, answer).await;
    }
    drop(setup.client);
    assert_eq!(setup.sent.await.expect("the world"), [frame(&[1, 15])]);
}

#[tokio::test(start_paused = true)]
async fn a_client_that_never_opens_the_bus_is_let_go() {
    let mut setup = setup(Vec::new());
    let start = Instant::now();
    say(&mut setup.client, "< echo >").await;
    let mut answers = String::new();
    setup.client.read_to_string(&mut answers).await.expect("the end");
    assert!(start.elapsed() >= OPEN_TIMEOUT, "after {:?}", start.elapsed());
}

#[tokio::test(start_paused = true)]
async fn a_client_that_has_opened_the_bus_may_be_quiet() {
    let Setup { mut client, sent } = setup(Vec::new());
    say(&mut client, "< open pve0 >").await;
    // The session takes the request before the time passes, and would time out afterwards.
    for time in [0, 10] {
        tokio::time::advance(time * OPEN_TIMEOUT).await;
        for _ in 0..10 {
            tokio::task::yield_now().await;
        }
    }
    say(&mut client, "< send 18A 1 7 >").await;
    drop(client);
    assert_eq!(sent.await.expect("the world"), [frame(&[7])]);
}

#[tokio::test]
async fn what_was_sent_before_the_end_counts_and_is_answered() {
    let Setup { client, sent } = setup(Vec::new());
    let (mut reader, mut writer) = split(client);
    say(&mut writer, "< open pve0 >< send 18A 1 7 >< echo >").await;
    writer.shutdown().await.expect("the end");
    expect(&mut reader, "< hi >< ok >< echo >").await;
    assert_eq!(reader.read(&mut [0; 8]).await.expect("the end"), 0);
    assert_eq!(sent.await.expect("the world"), [frame(&[7])]);
}

/// Places are few: a client that has closed its half and does not read must not occupy a place.
#[tokio::test(start_paused = true)]
async fn a_client_that_says_its_last_word_and_does_not_read_is_let_go() {
    let (client, inbox, session) = serve(64);
    std::thread::spawn(move || world(&inbox, &[]));
    let (_reader, mut writer) = split(client);
    for _ in 0..100 {
        say(&mut writer, "< echo >").await;
    }
    writer.shutdown().await.expect("the end");
    tokio::time::timeout(2 * DRAIN_TIMEOUT, session).await.expect("the place is free").expect("no panic");
}

#[tokio::test]
async fn a_client_that_dies_in_mid_frame_sends_nothing_of_it() {
    let Setup { mut client, sent } = setup(Vec::new());
    say(&mut client, "< open pve0 >< send 18A 1 7 >< send 18A 2 1 ").await;
    drop(client);
    assert_eq!(sent.await.expect("the world"), [frame(&[7])]);
}

#[tokio::test(start_paused = true)]
async fn a_client_that_does_not_keep_up_is_disconnected() {
    let Setup { client, sent } = setup(vec![seen(&[0; 8]); 2 * QUEUE]);
    let (mut reader, mut writer) = split(client);
    say(&mut writer, "< open pve0 >< rawmode >").await;
    // The world has finished with the client before it has read a byte.
    assert_eq!(sent.await.expect("the world"), []);
    let mut all = Vec::new();
    reader.read_to_end(&mut all).await.expect("the end");
    assert!(all.len() <= STREAM, "{} bytes of what fills the queue twice", all.len());
}

#[tokio::test]
async fn a_client_that_floods_is_not_read_beyond_its_credit() {
    let (client, inbox, _session) = serve(64);
    let (_reader, mut writer) = split(client);
    let flood = tokio::spawn(async move {
        say(&mut writer, "< open pve0 >").await;
        loop {
            say(&mut writer, "< send 18A 0 >").await;
        }
    });
    // Both ends run until one waits for a permit and the other for space: far fewer turns than this limit.
    for _ in 0..100 * crate::inbox::PERMITS {
        tokio::task::yield_now().await;
    }
    flood.abort();
    let sends = inbox.messages.try_iter().filter(|arrival| matches!(arrival.message, ToWorld::Send(..))).count();
    assert_eq!(sends, crate::inbox::PERMITS - 2);
}
