//! The throughput of clients of `pve-sim`, by the wall clock: `cargo bench --package pve-sim --bench clients`, on an
//! otherwise idle machine. Prints figures without limits, because they depend on the machine.

#![allow(missing_docs, reason = "a program")]

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// The duration of each measurement.
const SCENE: Duration = Duration::from_secs(5);

/// A running simulator whose trace is discarded.
struct Simulator {
    process: Child,
    port: u16,
}

impl Simulator {
    fn start(arguments: &[String]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pve-sim"));
        command.args(["--no-http", "--bus", "socketcand://127.0.0.1:0/pve0"]).args(arguments);
        let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("pve-sim starts");
        let mut stdout = BufReader::new(process.stdout.take().expect("a pipe"));
        let mut ready = String::new();
        stdout.read_line(&mut ready).expect("the ready line");
        let port = ready.rsplit(':').next().and_then(|rest| rest.split('/').next()).expect("a port");
        let port = port.parse().expect("a port");
        thread::spawn(move || std::io::copy(&mut stdout, &mut std::io::sink()));
        Self { process, port }
    }

    /// Returns a client that receives all frames.
    fn join(&self) -> Client {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).expect("a connection");
        stream.set_nodelay(true).expect("an option");
        let mut client = Client { stream, heard: Vec::new() };
        client.hear();
        client.say("< open pve0 >");
        client.hear();
        client.say("< rawmode >");
        client.hear();
        client
    }

    /// Returns the used processor time, in clock ticks of 10 ms.
    fn ticks(&self) -> u64 {
        let stat = fs::read_to_string(format!("/proc/{}/stat", self.process.id())).unwrap_or_default();
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap_or_default().split(' ').collect();
        fields.iter().skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum()
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

struct Client {
    stream: TcpStream,
    heard: Vec<u8>,
}

impl Client {
    fn say(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).expect("a connection");
    }

    /// Reads the next message.
    fn hear(&mut self) -> String {
        loop {
            if let Some(end) = self.heard.iter().position(|byte| *byte == b'>') {
                let message: Vec<u8> = self.heard.drain(..=end).collect();
                return String::from_utf8(message).expect("text");
            }
            let mut bytes = [0; 4096];
            let len = self.stream.read(&mut bytes).expect("a connection");
            assert!(len > 0, "the connection ended");
            self.heard.extend_from_slice(&bytes[..len]);
        }
    }
}

fn arguments(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

/// Reads one object of one valve, back to back.
fn reads(speed: &str) {
    let simulator = Simulator::start(&arguments(&format!("--speed {speed}")));
    let mut client = simulator.join();
    let mut times = Vec::new();
    let start = Instant::now();
    while start.elapsed() < SCENE {
        let asked = Instant::now();
        client.say("< send 620 8 40 0 10 0 0 0 0 0 >");
        while !client.hear().starts_with("< frame 5A0") {}
        times.push(asked.elapsed());
    }
    let rate = times.len() as f64 / start.elapsed().as_secs_f64();
    times.sort();
    let (middle, late) = (times[times.len() / 2], times[times.len() * 99 / 100]);
    println!(
        "SDO reads back to back, --speed {speed}: {rate:.0} a second; median {middle:.0?}, 99 % within {late:.0?}"
    );
}

/// Polls many valves in turn.
fn poll() {
    let devices: String = (1..=127).map(|id| format!("--device pvea-canopen@{id} ")).collect();
    let simulator = Simulator::start(&arguments(&devices));
    let mut client = simulator.join();
    let (mut reads, start) = (0, Instant::now());
    while start.elapsed() < SCENE {
        for id in 1..=127 {
            client.say(&format!("< send {:X} 8 40 0 10 0 0 0 0 0 >", 0x600 + id));
            let answer = format!("< frame {:X} ", 0x580 + id);
            while !client.hear().starts_with(&answer) {}
            reads += 1;
        }
    }
    println!("127 valves read in turn, --speed 1: {:.0} a second", f64::from(reads) / start.elapsed().as_secs_f64());
}

/// Measures twenty valves whose heartbeats fill the bus, with listening clients.
fn listeners(count: usize) {
    let devices: String = (1..=20).map(|id| format!("--device pvea-canopen@{id} ")).collect();
    let simulator = Simulator::start(&arguments(&format!("{devices} --speed 5")));
    let mut clients: Vec<Client> = (0..count).map(|_| simulator.join()).collect();
    for id in 1..=20 {
        clients[0].say(&format!("< send {:X} 8 2b 17 10 0 a 0 0 0 >", 0x600 + id));
    }
    let (first, others) = clients.split_first_mut().expect("a client");
    thread::scope(|scope| {
        for client in &mut *others {
            let mut stream = client.stream.try_clone().expect("a connection");
            scope.spawn(move || drop(std::io::copy(&mut stream, &mut std::io::sink())));
        }
        let (ticks, start) = (simulator.ticks(), Instant::now());
        let mut frames = 0_u64;
        while start.elapsed() < SCENE {
            first.hear();
            frames += 1;
        }
        let micros = (simulator.ticks() - ticks) * 10_000;
        let each = micros as f64 / frames as f64;
        println!(
            "{count} listeners, {frames} frames in {SCENE:?} at --speed 5: {each:.1} µs of processor time a frame"
        );
        for client in others {
            let _ = client.stream.shutdown(std::net::Shutdown::Both);
        }
    });
}

fn main() {
    reads("1");
    reads("100");
    poll();
    listeners(1);
    listeners(20);
}
