//! Tests of the node and its services with a fictitious product, a lamp, whose rules differ from the valves'.

mod emcy;
mod lamp;
mod lss;
mod node;
mod objects;
mod pdo;
mod pending;

extern crate std;

use std::string::{String, ToString};
use std::vec::Vec;

use lamp::{Lamp, Task};

use super::dictionary::Group;
use super::lss::Configuration;
use super::nmt::Reset;
use super::node::{Demand, Node};
use super::parameters::Stored;
use crate::controller::BitRate;
use crate::frame::Frame;
use crate::time::{Duration, Instant, after};
use crate::wire::lss::LssNodeId;

/// A lamp on a bus that accepts every frame unless `held`.
struct Rig {
    node: Node<Lamp>,
    lamp: Lamp,
    now: Instant,
    held: bool,
}

impl Rig {
    /// Returns a lamp with node ID 5 that has booted.
    fn booted() -> Self {
        let mut rig = Self::started(Some(5), None);
        assert_eq!(rig.sent(), ["705: 00"]);
        rig
    }

    /// Returns a lamp just started with this node ID and these parameters.
    fn started(node_id: Option<u8>, parameters: Option<&[u8]>) -> Self {
        let now = Instant::from_secs(1);
        let mut rig = Self { node: Node::new(), lamp: Lamp::default(), now, held: false };
        rig.start(Reset::Application, node_id, parameters);
        rig
    }

    fn start(&mut self, scope: Reset, node_id: Option<u8>, parameters: Option<&[u8]>) {
        let stored = Configuration { node_id: node_id.and_then(LssNodeId::new), bit_rate: Some(BitRate::Kbit250) };
        self.node.reset(scope, stored);
        let parameters = parameters.and_then(|payload| Stored::decode(lamp::DICTIONARY.entries(), Group::All, payload));
        self.node.boot(scope, [(Group::All, parameters)], &mut self.lamp, self.now);
    }

    fn take(&mut self, text: &str) -> Option<Demand<Task>> {
        let frame: Frame = text.parse().unwrap();
        let service = self.node.service(&frame)?;
        self.node.handle(service, &frame, &mut self.lamp, self.now)
    }

    /// Handles a frame that must demand nothing, and returns the frames sent after it.
    #[track_caller]
    fn exchange(&mut self, text: &str) -> Vec<String> {
        assert_eq!(self.take(text), None, "{text}");
        self.sent()
    }

    fn advance(&mut self, ms: u64) -> Vec<String> {
        let end = after(self.now, Duration::from_millis(ms));
        let mut sent = Vec::new();
        while self.node.deadline() <= end {
            self.now = self.node.deadline();
            self.node.poll(&self.lamp, self.now);
            sent.extend(self.sent());
        }
        self.now = end;
        sent
    }

    /// Sends the pending frames and returns them; sends none while the bus is held.
    fn sent(&mut self) -> Vec<String> {
        let mut sent = Vec::new();
        while !self.held && self.node.has_frame() {
            while let Some(frame) = self.node.next_frame(&self.lamp, self.now) {
                sent.push(frame.to_string());
            }
            self.node.all_sent();
        }
        sent
    }
}
