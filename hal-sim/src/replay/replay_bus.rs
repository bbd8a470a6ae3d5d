//! The simulated devices on a bus, in virtual time, with one client that sends the log frames of all other nodes.

use std::collections::BTreeSet;

use protocol_core::device::Device;
use protocol_core::frame::Frame;
use protocol_core::time::{Instant, after};

use super::ReplayOptions;
use super::attribution;
use super::fields::fields_of;
use super::frame_matcher::Verdict;
use super::identifier::destination_of_write;
use super::item::Item;
use super::position::{GRID, PositionTolerance};
use super::report::{Difference, What};
use super::timeline::{Timeline, length};
use crate::Memory;
use crate::devices::link_in;
use crate::explain::{Explainer, Node};
use crate::log::Timestamp;
use crate::world::{ClientPortId, Event, EventKind, NodeId, World};

pub(super) struct ReplayBus {
    world: World,
    others: ClientPortId,
    /// The pending power-ups; the earliest power-up is last.
    to_come: Vec<(Instant, NodeId)>,
    nodes: Vec<NodeId>,
    explainer: Explainer,
    /// The frames from the simulated devices that have not been taken yet, oldest first.
    pub(super) sent: Vec<Item>,
    pub(super) positions: PositionTolerance,
    /// The destination of the last UDS write in the log.
    written: Option<u8>,
}

impl ReplayBus {
    pub(super) fn new(options: &ReplayOptions, timeline: &Timeline) -> Self {
        let first = options.devices.first();
        let rate = first.and_then(|device| device.setup.bit_rate.or(device.setup.kind.bit_rates().first().copied()));
        let mut world = World::new(rate.unwrap_or(protocol_core::controller::BitRate::Kbit250), options.seed);
        world.record_events(true);
        let mut nodes = Vec::new();
        for device in &options.devices {
            nodes.push(device.add_to(&mut world, Memory::in_ram()));
        }
        // Added after the devices: if a device and the client send the same frame simultaneously, the device counts as
        // the sender.
        let others = world.add_gateway("the log");
        link_in(&mut world, &options.links);
        let mut to_come: Vec<_> = timeline.power_ups.iter().map(|power_up| power_up.at).zip(nodes.clone()).collect();
        to_come.sort_by(|one, other| other.cmp(one));
        let known = options.devices.iter().map(|device| Node {
            name: device.name.clone(),
            kind: device.setup.kind,
            node_id: device.setup.node_id,
        });
        Self {
            explainer: Explainer::new(known.collect()),
            positions: PositionTolerance::new(
                options.devices.iter().map(|device| device.setup.kind),
                options.tolerance,
            ),
            world,
            others,
            to_come,
            nodes,
            sent: Vec::new(),
            written: None,
        }
    }

    pub(super) const fn now(&self) -> Instant {
        self.world.now()
    }

    /// Advances to the time at which `frame` must start in order to end at `end`. Events at that time are not yet
    /// processed.
    pub(super) fn run_to_start(&mut self, frame: &Frame, end: Instant) {
        let takes = length(frame, self.world.bit_rate().bits_per_second());
        self.run_before(Instant::from_ticks(end.as_ticks().saturating_sub(takes.as_ticks())));
    }

    /// Advances to `end` and processes all events before it. No effect if `end` has passed.
    pub(super) fn run_before(&mut self, end: Instant) {
        loop {
            let power_up = self.to_come.last().map(|(at, _)| *at).filter(|at| *at <= end);
            let next = end.min(self.world.next_event());
            let next = self.next_sample(next);
            let next = power_up.map_or(next, |at| next.min(at));
            self.world.run_before(next);
            self.positions.sample(&mut self.world, &self.nodes);
            let now = self.world.now();
            if power_up.is_some_and(|at| at <= now) {
                let node = self.to_come.pop().map(|(_, node)| node);
                node.into_iter().for_each(|node| self.world.power(node, true));
            } else if now >= end {
                break;
            } else if self.world.next_event() <= now {
                self.world.step();
            }
            self.look();
        }
    }

    /// Returns the time of the next position sample; `end` if no position changes before `end`.
    fn next_sample(&self, end: Instant) -> Instant {
        let sample = after(self.world.now(), GRID);
        if sample >= end {
            return end;
        }
        let moves = self.nodes.iter().map(|node| self.world.next_position(*node, end)).min();
        sample.max(moves.unwrap_or(end))
    }

    /// Records the bus events and samples the positions.
    fn look(&mut self) {
        self.positions.sample(&mut self.world, &self.nodes);
        let events: Vec<Event> = self.world.take_events().collect();
        for Event { at, who, what } in events {
            let EventKind::Frame { frame, .. } = what else { continue };
            let Some(place) = self.explainer.nodes.iter().position(|known| *known.name == *who) else { continue };
            let tpdo = self.nodes.get(place).and_then(|node| self.world.tpdo(*node));
            let fields = fields_of(&frame, self.explainer.nodes[place].kind, tpdo);
            self.sent.push(Item { at, frame, number: None, device: Some(place), fields });
        }
        // The client follows the bit rate of the first device, so that the replay can continue.
        let rate = self.nodes.first().and_then(|node| self.world.device(*node)).map(Device::bit_rate);
        if let Some(rate) = rate.filter(|rate| *rate != self.world.bit_rate()) {
            self.world.set_bit_rate(rate);
        }
    }

    pub(super) fn send(&mut self, frame: Frame) {
        self.written = destination_of_write(&frame).or(self.written);
        self.world.send(self.others, frame);
    }

    /// Returns whether a log frame belongs to a replayed device.
    pub(super) fn is_own(&mut self, frame: &Frame, keys: &BTreeSet<u32>, timeline: &Timeline) -> bool {
        self.update_ids();
        attribution::is_own(frame, &self.explainer.nodes, keys, self.written, timeline)
    }

    /// Updates the node IDs of powered devices. Unpowered devices keep the node ID of their setup.
    fn update_ids(&mut self) {
        for (known, node) in self.explainer.nodes.iter_mut().zip(&self.nodes) {
            if let Some(device) = self.world.device(*node) {
                known.node_id = device.node_id();
            }
        }
    }

    /// Creates a difference with explanations. `at` is its log time.
    pub(super) fn difference(&mut self, what: What, verdict: &Verdict, at: Timestamp) -> Difference {
        self.update_ids();
        let say = |item: &Item| {
            let sender = item.device.and_then(|place| self.explainer.nodes.get(place));
            (item.frame, self.explainer.explain(&item.frame, sender.map(|node| node.name.as_str())))
        };
        let Verdict { logged, sent, .. } = verdict;
        Difference {
            at,
            number: logged.as_ref().and_then(|item| item.number),
            what,
            logged: logged.as_ref().map(say),
            sent: sent.as_ref().map(say),
        }
    }
}
