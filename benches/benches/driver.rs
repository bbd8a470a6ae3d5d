//! The cost of an exchange in instructions of the host, from the bytes of a client to the bytes of the answer: parser,
//! driver, bus, valve, trace and the way back. Sockets, the printing thread and waiting are left out.
//!
//! The limits are budgets, at most a fifth above the measured values.

#![allow(missing_docs, reason = "the macros of gungraun make modules without any")]

use std::io;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use gungraun::prelude::*;
use gungraun::{Callgrind, EventKind};
use hal_sim::Memory;
use hal_sim::devices::NamedDevice;
use hal_sim::simulation::Simulation;
use protocol_core::controller::BitRate;
use protocol_core::device::pve::{Kind, Setup};
use pve_sim::gateway::socketcand::{Parser, Request, emit_frame};
use pve_sim::inbox::{Arrival, ClientEnd, ClientId, ClientQueue, Reply, ToClient, ToWorld};
use pve_sim::run::{Driver, Platform};

/// A wall clock that advances only while the driver waits, and the messages of the clients.
struct TestPlatform {
    now: Instant,
    messages: Receiver<Arrival>,
}

impl Platform for TestPlatform {
    fn now(&mut self) -> Instant {
        self.now
    }

    fn is_ending(&self) -> bool {
        false
    }

    fn take(&mut self) -> Option<Arrival> {
        self.messages.try_recv().ok()
    }

    fn wait(&mut self, until: Option<Instant>, _: Duration) -> Option<Arrival> {
        self.now = self.now.max(until?);
        self.take()
    }
}

/// A simulator of valves at node IDs 1, 2, 3 …, with one listening client.
struct Scene {
    driver: Driver<TestPlatform>,
    start: Instant,
    messages: Sender<Arrival>,
    client: ClientId,
    client_end: ClientEnd,
    parser: Parser,
    out: String,
}

impl Scene {
    /// Returns a simulator whose valves have booted and allocate nothing more.
    fn idle(valves: u8) -> Box<Self> {
        let mut simulation = Simulation::new(BitRate::Kbit250, 0);
        for id in 1..=valves {
            let setup = Setup { node_id: Some(id), serial: Some(id.into()), ..Setup::new(Kind::PveaCanopen) };
            simulation.add(&NamedDevice::new(&format!("valve-{id}"), setup), Memory::in_ram());
        }
        let (start, (messages, receiver)) = (Instant::now(), channel());
        let outside = TestPlatform { now: start, messages: receiver };
        let driver = Driver::embedded(simulation, outside, 1.0, io::sink(), io::sink()).expect("a thread");
        let (client, (to_client, client_end)) = (ClientId::next(), ClientQueue::new());
        let (parser, out) = (Parser::default(), String::with_capacity(256));
        let mut scene = Box::new(Self { driver, start, messages, client, client_end, parser, out });
        scene.tell(ToWorld::Join(client, to_client));
        scene.tell(ToWorld::Listen(client, Reply::new("")));
        // All valves have started by then.
        for _ in 0..1_000 {
            scene.driver.turn();
        }
        while scene.client_end.queue.try_recv().is_ok() {}
        for _ in 0..3 {
            scene.exchange();
        }
        scene
    }

    fn tell(&self, message: ToWorld) {
        self.messages.send(Arrival { at: self.start, message }).expect("a driver");
    }

    /// Runs the simulator until the client receives a message.
    fn hear(&mut self) -> ToClient {
        loop {
            if let Ok(message) = self.client_end.queue.try_recv() {
                return message;
            }
            self.driver.turn();
        }
    }

    /// Reads an object of valve 1 for the client.
    fn exchange(&mut self) {
        for byte in "< send 601 8 40 18 10 1 0 0 0 0 >".bytes() {
            if let Some(Ok(Request::Send(frame))) = self.parser.push(byte) {
                self.tell(ToWorld::Send(self.client, frame));
            }
        }
        let ToClient::Frame(at, frame) = self.hear() else { panic!("no frame") };
        self.out.clear();
        emit_frame(&mut self.out, at, &frame);
        assert!(self.out.contains("581"), "{}", self.out);
    }
}

fn budget(instructions: u64) -> LibraryBenchmarkConfig {
    let mut callgrind = Callgrind::default();
    callgrind.hard_limits([(EventKind::Ir, instructions)]);
    let mut config = LibraryBenchmarkConfig::default();
    config.tool(callgrind);
    config
}

// An SDO upload, at speed 1.
#[library_benchmark]
#[bench::valves_1(args = (Scene::idle(1)), config = budget(33_500))]
#[bench::valves_20(args = (Scene::idle(20)), config = budget(33_500))]
fn exchange(mut scene: Box<Scene>) -> Box<Scene> {
    scene.exchange();
    scene
}

library_benchmark_group!(name = driver, benchmarks = exchange);

main!(library_benchmark_groups = driver);
