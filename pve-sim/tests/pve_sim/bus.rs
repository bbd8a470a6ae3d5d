//! The bus that clients join: frames, errors, and arriving and leaving clients.

use std::fs;
use std::io::Read as _;
use std::net::{Shutdown, TcpStream};
use std::process::{Command, Stdio};

use rustix::process::Signal;

use super::simulator::*;

#[test]
fn the_ready_line_names_every_bus_with_the_port_that_was_bound() {
    let first = "socketcand://127.0.0.1:0/pve0";
    let simulator = Simulator::start(&["--bus", first, "--bus", "socketcand://127.0.0.1:0/can1"]);
    let ports = simulator.ports();
    let (one, two) = (ports[0], ports[1]);
    assert!(one != 0 && two != 0);
    let ready = format!("pve-sim ready bus=socketcand://127.0.0.1:{one}/pve0 bus=socketcand://127.0.0.1:{two}/can1");
    assert_eq!(simulator.ready, ready);
    // Both URLs lead to one bus.
    let mut near = simulator.join();
    let mut far = connect(two);
    expect(&mut far, "< hi >");
    say(&mut far, "< open can1 >< send 123 1 ff >< echo >");
    expect(&mut far, "< ok >");
    expect(&mut far, "< echo >");
    await_frame(&mut near, "123#FF");
    let (_, stderr) = simulator.end(Signal::INT);
    let hint = format!("can_logger -i socketcand -c pve0 --bus-kwargs host=127.0.0.1 port={one}\n");
    assert!(stderr.contains(&hint), "{stderr}");
}

#[test]
fn a_valve_answers_and_the_trace_says_what_that_means() {
    let dir = tempfile::tempdir().expect("a folder");
    let log = dir.path().join("frames.log");
    let simulator = Simulator::serve(&["--log", log.to_str().expect("text")]);
    let mut client = simulator.join();
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    let (trace, _) = simulator.end(Signal::TERM);
    let lines: Vec<(&str, &str)> = trace.lines().map(|line| line.split_once("  ").expect(line)).collect();
    let meaning = |frame: &str| {
        let line = lines.iter().find(|(logged, _)| logged.ends_with(&format!(" pve0 {frame}")));
        line.unwrap_or_else(|| panic!("{frame} in\n{trace}")).1
    };
    assert_eq!(meaning("720#00"), "pvea-canopen: boot-up");
    assert_eq!(meaning("620#4018100100000000"), "master → pvea-canopen: SDO read 0x1018:1 (Vendor ID)");
    assert_eq!(meaning(VENDOR), "pvea-canopen: SDO read response 0x1018:1 (Vendor ID) = 0x01000019");
    let logged: String = lines.iter().map(|(logged, _)| format!("{logged}\n")).collect();
    assert_eq!(fs::read_to_string(log).expect("the log"), logged);
}

#[test]
fn both_protocols_on_one_bus() {
    let dir = tempfile::tempdir().expect("a folder");
    let state = dir.path().to_str().expect("text");
    let devices = ["--device", "pvea-isobus@0x83,name=boom", "--device", "pveo-canopen@0x20", "--state", state];
    let simulator = Simulator::serve(&devices);
    let mut client = simulator.join();
    // 250 ms after its claim; by then the other one has booted.
    await_frame(&mut client, "0CFE1383#7D7D30FFFFFFFFFF");
    say(&mut client, READ_VENDOR);
    await_frame(&mut client, VENDOR);
    say(&mut client, "< send 18EA8327 3 0 ee 0 >");
    await_frame(&mut client, "18EEFF83#0100200708FF0220");
    say(&mut client, "< send 1bc78883 5 4 2e 10 1 86 >");
    await_frame(&mut client, "1BC408F1#036E1001");
    let (trace, _) = simulator.end(Signal::TERM);
    for line in [
        "18EA8327#00EE00  0x27 → boom: request address claim",
        "18EEFF83#0100200708FF0220  boom: claims address 0x83, NAME 0x2002FF0807200001",
        "5A0#4318100119000001  pveo-canopen: SDO read response",
        "1BC408F1#036E1001  boom → tool 0xF1: UDS write response 0x1001 (node ID)",
    ] {
        assert!(trace.contains(line), "{line} in\n{trace}");
    }
    // The address was stored.
    let simulator = Simulator::serve(&devices);
    let mut client = simulator.join();
    await_frame(&mut client, "0CFE1686#7D7D30FFFFFFFFFF");
    say(&mut client, "< send 18EAFFFE 3 0 ee 0 >");
    await_frame(&mut client, "18EEFF86#0100200708FF0220");
}

#[test]
fn all_clients_but_the_sender_get_a_frame() {
    let simulator = Simulator::serve(&["--device", "pvea-canopen,blank"]);
    let (mut sender, mut other, mut third) = (simulator.join(), simulator.join(), simulator.join());
    say(&mut sender, "< send 18A 2 1 f >< send ffffffff98ff0ae0 0 >< send 100 0  >< echo >");
    expect(&mut sender, "< echo >");
    for client in [&mut other, &mut third] {
        assert_eq!(frame(client), "18A#010F");
        assert_eq!(frame(client), "18FF0AE0#");
        assert_eq!(frame(client), "100#");
    }
    say(&mut other, "< send 200 1 1 >");
    assert_eq!(frame(&mut sender), "200#01");
}

#[test]
fn a_client_that_dies_disturbs_nobody() {
    let simulator = Simulator::serve(&[]);
    let mut witness = simulator.join();
    for text in ["", "< op", "< open pve0 >< send 18A 8 1 2 3 4", "< open pve0 >< rawmode >< send 18A 0 ><"] {
        let mut dying = simulator.connect();
        say(&mut dying, text);
        drop(dying);
    }
    say(&mut witness, READ_VENDOR);
    await_frame(&mut witness, VENDOR);
}

#[test]
fn what_was_sent_before_the_end_of_a_connection_reaches_the_bus() {
    let simulator = Simulator::serve(&["--device", "pvea-canopen,blank"]);
    let mut witness = simulator.join();
    let mut hasty = simulator.connect();
    let frames: String = (0..200).map(|number| format!("< send 100 1 {number:x} >")).collect();
    say(&mut hasty, &format!("< open pve0 >{frames}"));
    hasty.shutdown(Shutdown::Write).expect("half a connection");
    for number in 0..200 {
        assert_eq!(frame(&mut witness), format!("100#{number:02X}"));
    }
    let mut answers = String::new();
    hasty.read_to_string(&mut answers).expect("the end");
    assert_eq!(answers, "< hi >< ok >");
}

/// A valve at another bit rate destroys the frame of a client, until the valve is error-passive.
#[test]
fn error_frames_are_told_and_not_poured() {
    for (options, wanted) in [(&[][..], false), (&["--error-frames"][..], true)] {
        let mut simulator = Simulator::serve(
            &[&["--bit-rate", "125k", "--device", "pvea-canopen,blank,bit-rate=250k"], options].concat(),
        );
        let mut witness = simulator.join();
        let mut client = simulator.join();
        say(&mut client, "< send 123 1 1 >< echo >");
        expect(&mut client, "< echo >");
        if wanted {
            let first = message(&mut witness);
            assert!(first.starts_with("< error 080 "), "{first}");
            let second = message(&mut witness);
            assert!(second.starts_with("< error 004 "), "{second}");
        }
        let mut other = simulator.join();
        say(&mut other, "< send 7F0 0 >");
        let mut trace = Vec::new();
        while !trace.last().is_some_and(|line: &String| line.contains("7F0")) {
            trace.push(simulator.line());
        }
        assert!(trace[0].contains("20000080#0000000000000000  error frame: stuff error in 123: 01 from the gateway"));
        assert!(trace[1].contains("20000004#0030000000000000  pvea-canopen: error-passive (15 error frames so far)"));
        assert!(trace.len() < 20, "{trace:?}");
        say(&mut witness, "< echo >");
        loop {
            match message(&mut witness) {
                text if text == "< echo >" => break,
                text => assert!(text.starts_with("< frame ") || (wanted && text.starts_with("< error ")), "{text}"),
            }
        }
        simulator.end(Signal::TERM);
    }
}

/// More clients than file descriptors: devices can still store.
#[test]
fn clients_leave_enough_descriptors_to_store() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut shell = Command::new("sh");
    let script = "ulimit -n 64 && exec \"$0\" --no-http --bus socketcand://127.0.0.1:0/pve0 --state \"$1\"";
    shell.args(["-c", script, env!("CARGO_BIN_EXE_pve-sim")]).arg(dir.path());
    let simulator = Simulator::spawn(shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut client = simulator.join();
    let mut crowd: Vec<TcpStream> = Vec::new();
    loop {
        let mut one = simulator.connect();
        match message(&mut one).as_str() {
            "< hi >" => crowd.push(one),
            text => break assert_eq!(text, "< error too many clients >"),
        }
        assert!(crowd.len() < 64);
    }
    assert!(crowd.len() >= 20, "{}", crowd.len());
    say(&mut client, "< send 620 8 22 10 10 1 73 61 76 65 >");
    await_frame(&mut client, "5A0#6010100100000000");
    // Later clients find places again.
    drop(crowd);
    simulator.join();
    simulator.end(Signal::TERM);
}

/// The last client of a queue is refused without waiting for the earlier ones.
#[test]
fn clients_without_a_place_are_refused_side_by_side() {
    const CLIENTS: usize = 128;
    let simulator = Simulator::serve(&[]);
    let mut served: Vec<TcpStream> = (0..CLIENTS).map(|_| simulator.connect()).collect();
    served.iter_mut().for_each(|client| expect(client, "< hi >"));
    let refused: Vec<TcpStream> = (0..2 * PATIENCE.as_secs()).map(|_| simulator.connect()).collect();
    for mut client in refused.into_iter().rev() {
        expect(&mut client, "< error too many clients >");
    }
    drop(served);
    simulator.join();
}

/// The text of SavvyCAN, with Qt 5 and with Qt 6, which treats identifiers and bytes as signed numbers.
#[test]
fn savvycan_shares_the_bus() {
    let simulator = Simulator::serve(&["--device", "pvea-canopen", "--device", "pvea-isobus@0x83"]);
    let mut savvycan = simulator.join();
    for request in ["< send 620 8 40 18 10 1 0 0 0 0 >", "< send 0x620 8 0x40 0x18 0x10 0x1 0x0 0x0 0x0 0x0 >"] {
        say(&mut savvycan, request);
        await_frame(&mut savvycan, VENDOR);
    }
    // 18EAFF27: -67150D9 as a signed number of 32 bits with the mark of 29-bit identifiers
    say(&mut savvycan, "< send -671500d9 3 0 -12 0 >");
    await_frame(&mut savvycan, "18EEFF83#0100200708FF0220");
    say(&mut savvycan, "< send 98EAFF27 3 0 ffffffee 0 >");
    await_frame(&mut savvycan, "18EEFF83#0100200708FF0220");
}
