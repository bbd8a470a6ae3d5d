//! One client over a stream in memory. The test plays the world.

use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _, DuplexStream, duplex, split};
use tokio::task::JoinHandle;
use tokio::time::Instant;

use super::*;
use crate::gateway::session::End;
use crate::gateway::tcp::{DRAIN_TIMEOUT, OPEN_TIMEOUT};
use crate::gateway::{ForeignWarning, enter};
use crate::inbox::{ClientQueue, Inbox, PERMITS, QUEUE, WorldSender};
use hal_sim::log::Timestamp;
use protocol_core::frame::{Frame, standard};

/// Serves a client over a stream with this buffer size.
fn serve(room: usize) -> (DuplexStream, Inbox, JoinHandle<End>) {
    let (client, server) = duplex(room);
    let (reader, writer) = split(server);
    let (inbox, session) = serve_halves(reader, writer);
    (client, inbox, session)
}

fn serve_halves(
    reader: impl AsyncRead + Unpin + Send + 'static,
    writer: impl AsyncWrite + Unpin + Send + 'static,
) -> (Inbox, JoinHandle<End>) {
    let (world, inbox) = WorldSender::new();
    let warning = Arc::new(ForeignWarning::new("slcan://".to_owned(), world.clone()));
    (inbox, tokio::spawn(enter(reader, writer, world, warning, Session::new("slcan://".into()))))
}

/// Returns the queue of the client that has joined.
fn joined(inbox: &Inbox) -> ClientQueue {
    match inbox.messages.try_recv().expect("a message").message {
        ToWorld::Join(_, to_client) => to_client,
        other => panic!("{other:?}"),
    }
}

/// Runs the session until it waits.
async fn pass() {
    for _ in 0..10 {
        tokio::task::yield_now().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_client_that_never_opens_the_channel_is_let_go() {
    let start = Instant::now();
    let (mut client, _inbox, session) = serve(64);
    client.write_all(b"V\rS5\rC\r").await.expect("room");
    assert_eq!(session.await.expect("no panic"), End::Left);
    assert!(start.elapsed() >= OPEN_TIMEOUT, "after {:?}", start.elapsed());
}

/// Even after it has closed the channel.
#[tokio::test(start_paused = true)]
async fn a_client_that_has_opened_the_channel_may_be_quiet() {
    let (mut client, _inbox, session) = serve(64);
    client.write_all(b"O\rC\r").await.expect("room");
    pass().await;
    tokio::time::advance(10 * OPEN_TIMEOUT).await;
    pass().await;
    assert!(!session.is_finished());
    drop(client);
    assert_eq!(session.await.expect("no panic"), End::Left);
}

#[tokio::test(start_paused = true)]
async fn a_client_that_does_not_read_is_dismissed() {
    let (_client, inbox, session) = serve(64);
    pass().await;
    let to_client = joined(&inbox);
    let frame = ToClient::Frame(Timestamp::from_micros(0), Frame::of(standard(0x123).into(), &[]).expect("a frame"));
    let mut room = 0;
    while to_client.post(frame.clone()).is_ok() {
        room += 1;
        assert!(room <= 2 * QUEUE);
        pass().await;
    }
    assert_eq!(session.await.expect("no panic"), End::Dismissed);
}

/// It gets no time to read its last answers: it has stopped reading.
#[tokio::test(start_paused = true)]
async fn a_client_that_takes_nothing_more_is_heard_to_its_last_word() {
    let (mut client, reader) = duplex(64);
    let (_, writer) = duplex(64);
    let (inbox, session) = serve_halves(reader, writer);
    client.write_all(b"O\r").await.expect("room");
    pass().await;
    joined(&inbox).post(ToClient::Reply(Reply::new("\r"))).expect("room");
    pass().await;
    let start = Instant::now();
    client.write_all(b"t1230\r").await.expect("it is heard");
    drop(client);
    assert_eq!(session.await.expect("no panic"), End::Left);
    assert!(start.elapsed() < DRAIN_TIMEOUT, "after {:?}", start.elapsed());
    assert!(inbox.messages.try_iter().any(|arrival| matches!(arrival.message, ToWorld::Send(..))));
}

#[tokio::test]
async fn a_client_that_floods_is_not_read_beyond_its_credit() {
    let (mut client, inbox, _session) = serve(64);
    let flood = tokio::spawn(async move {
        client.write_all(b"O\r").await.expect("room");
        while client.write_all(b"t1230\r").await.is_ok() {}
    });
    // Both ends run until one waits for a permit and the other for space: far fewer turns than this limit.
    for _ in 0..100 * PERMITS {
        tokio::task::yield_now().await;
    }
    flood.abort();
    let messages: Vec<ToWorld> = inbox.messages.try_iter().map(|arrival| arrival.message).collect();
    let sends = messages.iter().filter(|message| matches!(message, ToWorld::Send(..))).count();
    // A frame and its answer; the channel was opened before.
    assert_eq!(sends, PERMITS / 2);
    assert_eq!(messages.len(), 1 + PERMITS, "who joins pays nothing");
}

#[tokio::test]
async fn the_flags_tell_of_an_error_once() {
    let (mut client, inbox, _session) = serve(64);
    client.write_all(b"O\r").await.expect("room");
    pass().await;
    let to_client = joined(&inbox);
    for (error, answer) in [(false, "F00\r"), (true, "F80\r"), (false, "F00\r")] {
        if error {
            let error = ToClient::Error(Timestamp::from_micros(0), hal_sim::log::ErrorClass::BusError);
            to_client.post(error).expect("room");
            pass().await;
        }
        client.write_all(b"F\r").await.expect("room");
        pass().await;
        let reply = inbox.messages.try_iter().last().expect("an answer").message;
        assert!(matches!(&reply, ToWorld::Reply(_, reply) if reply.text == answer), "{reply:?}");
    }
}

/// In one write, while a frame waits for the client: the frame came before the channel was closed.
#[tokio::test]
async fn a_frame_comes_as_it_was_asked_for_when_it_came() {
    let (mut client, inbox, _session) = serve(4096);
    pass().await;
    let to_client = joined(&inbox);
    let answer = async || {
        pass().await;
        while let Ok(arrival) = inbox.messages.try_recv() {
            if let ToWorld::Reply(_, reply) | ToWorld::Listen(_, reply) | ToWorld::Unlisten(_, reply) = arrival.message
            {
                to_client.post(ToClient::Reply(reply)).expect("room");
            }
            pass().await;
        }
    };
    let frame = |at, id| {
        let frame = Frame::of(standard(id).into(), &[]).expect("a frame");
        to_client.post(ToClient::Frame(Timestamp::from_micros(at), frame)).expect("room");
    };
    client.write_all(b"O\r").await.expect("room");
    answer().await;
    client.write_all(b"C\rZ1\rO\r").await.expect("room");
    pass().await;
    frame(1_000, 0x456);
    answer().await;
    frame(2_000, 0x123);
    frame(3_000, 0x456);
    pass().await;
    let mut told = vec![0; 4096];
    let len = client.read(&mut told).await.expect("bytes");
    assert_eq!(String::from_utf8_lossy(&told[..len]), "\rt4560\r\r\r\rt12300002\rt45600003\r");
}
