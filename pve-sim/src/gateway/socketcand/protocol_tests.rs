//! The pitfalls of socketcand's text, each with the bytes that clients send.

use protocol_core::frame::{extended, standard};

use super::*;

fn messages(bytes: &[u8]) -> Vec<Result<Request, Refusal>> {
    let mut parser = Parser::default();
    bytes.iter().filter_map(|byte| parser.push(*byte)).collect()
}

fn one(text: &str) -> Result<Request, Refusal> {
    let mut all = messages(text.as_bytes());
    assert_eq!(all.len(), 1, "{text}: {all:?}");
    all.remove(0)
}

fn sent(text: &str) -> Frame {
    match one(text) {
        Ok(Request::Send(frame)) => frame,
        other => panic!("{text}: {other:?}"),
    }
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

fn long(id: u32, data: &[u8]) -> Frame {
    Frame::of(extended(id).into(), data).unwrap()
}

fn emitted(frame: &Frame) -> String {
    let mut out = String::new();
    emit_frame(&mut out, Timestamp::from_micros(1_795_223_549_715_344), frame);
    out
}

#[test]
fn the_handshake() {
    assert_eq!(one("< open pve0 >"), Ok(Request::Open("pve0".to_owned())));
    assert_eq!(one("< rawmode >"), Ok(Request::RawMode));
    assert_eq!(one("< echo >"), Ok(Request::Echo));
    assert_eq!(one("<rawmode>"), Ok(Request::RawMode));
}

#[test]
fn messages_in_one_read_or_in_many() {
    let bytes = b"< open pve0 >< rawmode >\n< send 18A 2 1 f >";
    let whole = messages(bytes);
    assert_eq!(
        whole,
        [Ok(Request::Open("pve0".to_owned())), Ok(Request::RawMode), Ok(Request::Send(frame(0x18A, &[1, 15])))]
    );
    // The parser keeps its state across reads: it is fed byte by byte.
    let mut parser = Parser::default();
    let (before, after) = bytes.split_at(20);
    let mut cut: Vec<_> = before.iter().filter_map(|byte| parser.push(*byte)).collect();
    assert_eq!(cut.len(), 1);
    cut.extend(after.iter().filter_map(|byte| parser.push(*byte)));
    assert_eq!(cut, whole);
}

#[test]
fn garbage_between_messages_is_skipped() {
    assert_eq!(messages(b"< echo >\0\xFF junk > > \r\n< echo >\x80\x81> "), [Ok(Request::Echo), Ok(Request::Echo)]);
    assert_eq!(messages(b""), []);
}

#[test]
fn a_message_without_end_does_not_swallow_the_next() {
    assert_eq!(messages(b"< send 18A 2 < echo >"), [Err(UNTERMINATED), Ok(Request::Echo)]);
}

#[test]
fn over_long_messages_are_refused_once_and_not_kept() {
    let mut parser = Parser::default();
    let mut bytes = b"< ".to_vec();
    bytes.extend(std::iter::repeat_n(b'x', 1_000_000));
    bytes.extend(b">< echo >");
    let all: Vec<_> = bytes.iter().filter_map(|byte| parser.push(*byte)).collect();
    assert_eq!(all, [Err(TOO_LONG), Ok(Request::Echo)]);
    assert!(parser.message.capacity() <= 2 * MESSAGE_MAX);
    // the next message is found even if the long one never ends
    let endless = format!("<{}< echo >", "x".repeat(1000));
    assert_eq!(messages(endless.as_bytes()), [Err(TOO_LONG), Ok(Request::Echo)]);
}

#[test]
fn frames_as_python_can_sends_them() {
    assert_eq!(sent("< send 18A 2 1 f >"), frame(0x18A, &[1, 15]));
    assert_eq!(sent("< send 000 2 1 0 >"), frame(0, &[1, 0]));
    assert_eq!(sent("< send 080 0  >"), frame(0x80, &[]));
    assert_eq!(sent("< send 620 8 40 18 10 1 0 0 0 0 >"), frame(0x620, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]));
    assert_eq!(sent("< send 1BC78805 4 3 22 10 1 >"), long(0x1BC7_8805, &[3, 0x22, 0x10, 1]));
    assert_eq!(sent("< send 00000080 0  >"), long(0x80, &[]));
    assert_eq!(sent("< send 720 1  >"), Frame::remote(standard(0x720).into(), 1));
}

#[test]
fn frames_as_savvycan_sends_them() {
    assert_eq!(sent("< send 620 2 40 ffffffffffffff80 >"), frame(0x620, &[0x40, 0x80]));
    assert_eq!(
        sent("< send ffffffff98ff0ae0 4 1 ffffffffffffff80 ffffffffffffffff 7f >"),
        long(0x18FF_0AE0, &[1, 0x80, 0xFF, 0x7F])
    );
    assert_eq!(sent("< send ffffffff80000100 0 >"), long(0x100, &[]));
    assert_eq!(sent("< send 98ff0ae0 0 >"), long(0x18FF_0AE0, &[]));
    let widest = format!("< send ffffffff9bc78805 8{} >", " ffffffffffffff80".repeat(8));
    assert_eq!(sent(&widest), long(0x1BC7_8805, &[0x80; 8]));
}

/// SavvyCAN built with Qt 6 sends signs, other clients 32 bits or `0x`; the reference daemon accepts them all.
#[test]
fn frames_as_the_reference_daemon_reads_them() {
    assert_eq!(sent("< send -643877e0 2 -20 ffffff80 >"), long(0x1BC7_8820, &[0xE0, 0x80]));
    assert_eq!(sent("< send 0x123 0x2 0x1 0XfF >"), frame(0x123, &[1, 0xFF]));
    assert_eq!(sent("< send 123 2 -1 -80 >"), frame(0x123, &[0xFF, 0x80]));
}

#[test]
fn what_is_wrong_is_refused_and_nothing_is_sent() {
    let cases = [
        ("< fly >", "< error unknown command; accepted: open, rawmode, send, echo >"),
        ("< bcmmode >", "< error unknown command; accepted: open, rawmode, send, echo >"),
        ("<>", "< error unknown command; accepted: open, rawmode, send, echo >"),
        ("< open >", "< error wrong number of arguments >"),
        ("< open a b >", "< error wrong number of arguments >"),
        ("< send 18A >", "< error wrong number of arguments >"),
        ("< send 18G 0 >", "< error bad identifier; accepted: 0 to 1FFFFFFF in hex >"),
        ("< send +18 0 >", "< error bad identifier; accepted: 0 to 1FFFFFFF in hex >"),
        ("< send 20000000 0 >", "< error bad identifier; accepted: 0 to 1FFFFFFF in hex >"),
        ("< send ffffffffffffffff 0 >", "< error bad identifier; accepted: 0 to 1FFFFFFF in hex >"),
        ("< send 1bc7880500000000 0 >", "< error bad identifier; accepted: 0 to 1FFFFFFF in hex >"),
        ("< send ffffffff00000100 0 >", "< error bad identifier; accepted: 0 to 1FFFFFFF in hex >"),
        ("< send 1800 0 >", "< error an identifier above 7FF needs eight digits >"),
        ("< send 800 0 >", "< error an identifier above 7FF needs eight digits >"),
        ("< send 18A 9 1 2 3 4 5 6 7 8 9 >", "< error bad length; accepted: 0 to 8 >"),
        ("< send 18A x >", "< error bad length; accepted: 0 to 8 >"),
        ("< send 18A 2 1 >", "< error length and number of bytes differ >"),
        ("< send 18A 1 1 2 >", "< error length and number of bytes differ >"),
        ("< send 18A 0 1 >", "< error length and number of bytes differ >"),
        ("< send 18A 1 1g >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 100 >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 ffffffffffffff01 >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 -81 >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 ffffff7f >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 --1 >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 0x >", "< error bad data byte; accepted: 00 to FF >"),
        ("< send 18A 1 - >", "< error bad data byte; accepted: 00 to FF >"),
    ];
    for (text, refusal) in cases {
        match one(text) {
            Err(reason) => assert_eq!(emit_refusal(reason), refusal, "{text}"),
            Ok(request) => panic!("{text}: {request:?}"),
        }
    }
}

#[test]
fn frames_to_the_client() {
    assert_eq!(emitted(&frame(0x18A, &[1, 2])), "< frame 18A 1795223549.715344 0102 >");
    assert_eq!(emitted(&frame(0, &[1, 0])), "< frame 000 1795223549.715344 0100 >");
    assert_eq!(emitted(&long(0x1BC0_28F1, &[0xA0])), "< frame 1BC028F1 1795223549.715344 A0 >");
    assert_eq!(emitted(&long(0x80, &[0])), "< frame 00000080 1795223549.715344 00 >");
}

#[test]
fn empty_data_has_two_blanks() {
    assert_eq!(emitted(&frame(0x80, &[])), "< frame 080 1795223549.715344  >");
}

#[test]
fn remote_frames_are_not_passed_on_as_data() {
    assert_eq!(emitted(&Frame::remote(standard(0x720).into(), 1)), "");
}

#[test]
fn error_frames() {
    let mut out = String::new();
    emit_error(&mut out, Timestamp::from_micros(1_000_000_000_000_042), ErrorClass::BusOff);
    assert_eq!(out, "< error 040 1000000000.000042 >");
}
