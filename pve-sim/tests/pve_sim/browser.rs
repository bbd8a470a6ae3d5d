//! Web pages: any page can make a browser send data to any port of this machine.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use rustix::process::Signal;

use super::simulator::*;

/// The beginnings of a browser's data: requests with a method of the page's choice, and a TLS client hello.
const BEGINNINGS: [&str; 5] = [
    "POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\n\r\n",
    "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n\r\n",
    "O / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    "t10110 / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    "\u{16}\u{3}\u{1}\u{2}\0\u{1}\0",
];

/// Sends a text in segments of this size until the connection is closed; returns the received text.
fn visit(mut client: TcpStream, text: &str, segment: usize) -> String {
    client.set_nodelay(true).expect("an option");
    for part in text.as_bytes().chunks(segment) {
        if client.write_all(part).is_err() {
            break;
        }
    }
    let mut told = Vec::new();
    let mut bytes = [0; 256];
    loop {
        match client.read(&mut bytes) {
            Ok(0) => break,
            Ok(len) => told.extend_from_slice(&bytes[..len]),
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => break,
            Err(error) => panic!("it is not closed: {error}"),
        }
    }
    String::from_utf8(told).expect("text")
}

#[test]
fn a_web_page_sends_nothing_to_the_bus() {
    let buses = ["--bus", "socketcand://127.0.0.1:0/pve0", "--bus", "slcan://127.0.0.1:0"];
    let simulator = Simulator::start(&[&buses[..], &["--device", "pvea-canopen,blank"]].concat());
    let slcan = simulator.ready.split_once("bus=slcan://127.0.0.1:").expect("a bus").1.parse().expect("a port");
    let ports = [simulator.ports()[0], slcan];
    let texts = ["< open pve0 >< rawmode >< send 101 1 1 >", "\rC\rS5\rO\rt101101\r"];
    let mut witness = simulator.join();
    for (port, text) in ports.into_iter().zip(texts) {
        for begin in BEGINNINGS {
            for segment in [1, 7, 4096] {
                let told = visit(connect(port), &format!("{begin}{text}"), segment);
                assert!(told.is_empty() || told == "< hi >", "{begin}: {told}");
            }
        }
        // The same text from a client.
        let mut client = connect(port);
        client.write_all(text.replacen("101", "102", 1).as_bytes()).expect("room");
        assert_eq!(frame(&mut witness), "102#01");
    }
    let (trace, said) = simulator.end(Signal::TERM);
    assert!(!trace.contains(" 101#"), "{trace}");
    let told: Vec<&str> = said.lines().filter(|line| line.contains("closed a connection")).collect();
    assert_eq!(told.len(), 2, "once for each bus: {said}");
    assert!(told[0].contains("socketcand://127.0.0.1:") && told[1].contains("slcan://127.0.0.1:"), "{said}");
}
