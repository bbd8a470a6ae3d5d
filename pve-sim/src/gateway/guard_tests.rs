//! Browser connections, byte by byte and at once, against the judges of both protocols over TCP.

use proptest::prelude::*;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};

use super::*;
use crate::gateway::{Dialogue as _, slcan, socketcand};
use crate::inbox::Inbox;

/// Both protocols, each with a text that would send a frame.
const PROTOCOLS: [(Judge, &str); 2] =
    [(socketcand::Session::JUDGE, "< open pve0 >< send 123 1 1 >"), (slcan::Session::JUDGE, "\rO\rt123101\r")];

/// Returns the bytes that a session reads from a connection with these parts, and the warnings for the user.
fn taken(judge: Judge, parts: &[&[u8]]) -> (Vec<u8>, Vec<String>) {
    let (world, Inbox { messages, .. }) = WorldSender::new();
    let warning = Arc::new(ForeignWarning::new("socketcand://".to_owned(), world));
    let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime");
    let taken = runtime.block_on(async {
        let (mut client, server) = duplex(1 << 20);
        let mut guarded = Guarded::new(server, judge, warning);
        let mut taken = Vec::new();
        for part in parts {
            client.write_all(part).await.expect("room");
            let mut bytes = [0; 4096];
            // A session ends with the first error; this test reads on, to catch later bytes.
            if let Ok(len) = guarded.read(&mut bytes).await {
                taken.extend_from_slice(&bytes[..len]);
            }
        }
        drop(client);
        let _ = guarded.read_to_end(&mut taken).await;
        taken
    });
    let warnings = messages.try_iter().map(|arrival| match arrival.message {
        ToWorld::Warn(warning) => warning,
        other => panic!("{other:?}"),
    });
    (taken, warnings.collect())
}

/// Fails if a connection has any effect: a message of socketcand, or a line of slcan.
#[track_caller]
fn assert_harmless(judge: Judge, parts: &[&[u8]]) {
    let (taken, warnings) = taken(judge, parts);
    assert!(!taken.contains(&b'<') && !taken.contains(&b'\r'), "{}", String::from_utf8_lossy(&taken));
    assert_eq!(warnings.len(), 1, "{parts:?}");
}

#[test]
fn nothing_that_a_browser_sends_is_taken() {
    for (judge, text) in PROTOCOLS {
        for begin in [
            "POST / HTTP/1.1\r\nContent-Type: text/plain\r\n\r\n",
            "GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
            "OPTIONS / HTTP/1.1\r\nAccess-Control-Request-Method: O\r\n\r\n",
            // Any token is a method: some begin like lines of slcan.
            "t1230 / HTTP/1.1\r\n\r\n",
            "O / HTTP/1.1\r\n\r\n",
            "S5 /O HTTP/1.1\r\n\r\n",
            "post / HTTP/1.1\r\n\r\n",
            "!#$%&'*+-.^_`|~ / HTTP/1.1\r\n\r\n",
            "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
            "CONNECT pve0:29536 HTTP/1.1\r\n\r\n",
            // A TLS client hello, and a STUN request over TCP.
            "\u{16}\u{3}\u{1}\u{2}",
            "\0\u{14}\0\u{1}\0\0",
        ] {
            let request = format!("{begin}{text}").into_bytes();
            assert_harmless(judge, &[&request]);
            for cut in 1..begin.len() {
                let (head, tail) = request.split_at(cut);
                assert_harmless(judge, &[head, tail]);
            }
            assert_harmless(judge, &request.chunks(1).collect::<Vec<_>>());
        }
    }
}

#[test]
fn whatever_a_client_begins_with_is_taken() {
    let clients: [(Judge, &[&str]); 2] = [
        (socketcand::Session::JUDGE, &["< open pve0 >", "<open pve0>", " \t\r\n< echo >GET / HTTP/1.1\r\n\r\n"]),
        (
            slcan::Session::JUDGE,
            // python-can with and without a bit rate, SavvyCAN, and a command that the adapter refuses.
            &["C\rS5\rO\r", "O\r", "\r\r\rV\r", "\r\n\nC\r\n", "A0\r", "V\rt123 \r", "T1FFFFFFF80102030405060708\r\0"],
        ),
    ];
    for (judge, texts) in clients {
        for text in texts {
            let bytes: Vec<&[u8]> = text.as_bytes().chunks(1).collect();
            assert_eq!(taken(judge, &[text.as_bytes()]), (text.as_bytes().to_vec(), Vec::new()));
            assert_eq!(taken(judge, &bytes), (text.as_bytes().to_vec(), Vec::new()));
        }
    }
}

proptest! {
    #[test]
    fn no_method_and_no_body_is_taken(method in "[!#$%&'*+.^_`|~0-9A-Za-z-]{1,30}", body: Vec<u8>, cut in 0_usize..40) {
        for (judge, text) in PROTOCOLS {
            let mut request = format!("{method} /{text} HTTP/1.1\r\n\r\n{text}").into_bytes();
            request.extend_from_slice(&body);
            let (head, tail) = request.split_at(cut.clamp(1, request.len()));
            assert_harmless(judge, &[head, tail]);
        }
    }
}
