//! The advance of virtual time, and the processing of events.

use std::sync::Arc;

use protocol_core::controller::BusErrorMode;
use protocol_core::device::Effect;
use protocol_core::memory::{Record, RecordKey};
use protocol_core::pump::note_sent;
use protocol_core::time::{Duration, Instant, NEVER, after};

use crate::bus::DeviceCan;

use super::node::{Node, Power, Write, due, write_time};
use super::{ClientPortId, NodeId, World};

/// The maximum time that an orderly shutdown gives the devices to send their pending frames (A).
pub const FLUSH_PATIENCE: Duration = Duration::from_secs(1);

const TICK: Duration = Duration::from_ticks(1);

impl World {
    /// Returns the time of the next event, now or later; [`NEVER`] if there is none.
    #[inline]
    #[must_use]
    pub fn next_event(&self) -> Instant {
        self.bus.next_event().min(self.agenda.next()).max(self.now)
    }

    /// Advances to the next event and processes everything due at that time. If no event is scheduled, time does not
    /// advance.
    pub fn step(&mut self) {
        self.take_from_clients();
        let next = self.next_event();
        if next != NEVER {
            self.happen(next);
        }
        self.give_to_clients();
    }

    /// Advances by `time` and processes all events up to and including the end.
    pub fn run_for(&mut self, time: Duration) {
        self.run_until(after(self.now, time));
    }

    /// Advances to `end` and processes all events up to and including `end`.
    pub fn run_until(&mut self, end: Instant) {
        self.take_from_clients();
        loop {
            let next = self.next_event();
            if next > end || next == NEVER {
                break;
            }
            self.happen(next);
        }
        self.now = self.now.max(end);
        self.give_to_clients();
    }

    /// Advances to `end` and processes all events before `end`. Frames [sent](Self::send) afterwards take part in the
    /// arbitration at `end`.
    pub fn run_before(&mut self, end: Instant) {
        while self.next_event() < end {
            self.step();
        }
        self.now = self.now.max(end);
    }

    /// Performs an orderly shutdown: runs until all devices have stored their pending records.
    ///
    /// A device stores only after all its frames are sent. Frames still pending after [`FLUSH_PATIENCE`] are dropped.
    pub fn flush_all(&mut self) {
        let now = self.now;
        // During the shutdown, slow applications do not wait for their next cycle.
        let cycles: Vec<Duration> =
            self.nodes.iter_mut().map(|node| std::mem::take(&mut node.electronics.settings.cycle)).collect();
        for id in self.devices() {
            self.follow_links(id);
            if let Power::On(device) = &mut self.nodes[id.0].power {
                device.flush(now);
                self.service(id);
            }
        }
        let patience = after(now, FLUSH_PATIENCE);
        while !self.devices().all(|id| self.is_settled(id)) && self.next_event() <= patience {
            self.step();
        }
        for id in self.devices() {
            self.settle(id);
        }
        for (node, cycle) in self.nodes.iter_mut().zip(cycles) {
            node.electronics.settings.cycle = cycle;
        }
    }

    /// Advances to an instant and processes everything due at that time.
    fn happen(&mut self, now: Instant) {
        self.now = now;
        self.bus.finish(now);
        if self.bus.is_fault_due(now) {
            self.serve_faults();
        }
        if !self.inserters.is_empty() {
            self.dismiss_inserters();
        }
        self.service_touched();
        while let Some(number) = self.agenda.due_by(now) {
            self.poll_device(NodeId(number));
        }
        self.bus.begin(now);
        self.service_touched();
    }

    /// Hands over delayed frames and sends inserted frames. Each fault that inserts frames has its own controller.
    #[cold]
    fn serve_faults(&mut self) {
        let is_busy = |(_, port): &&(Arc<str>, ClientPortId)| self.pending(*port) > 0;
        let busy: Vec<Arc<str>> = self.inserters.iter().filter(is_busy).map(|(name, _)| Arc::clone(name)).collect();
        for (fault, frame) in self.bus.serve_faults(self.now, &busy) {
            let known = self.inserters.iter().find(|(name, _)| *name == fault).map(|(_, port)| *port);
            let port = known.unwrap_or_else(|| {
                let port = self.add_deaf_client(Arc::clone(&fault));
                self.bus.only_send(port.0);
                self.inserters.push((fault, port));
                port
            });
            self.send(port, frame);
        }
    }

    /// Removes the controllers of faults that have inserted their last frame.
    #[cold]
    pub(super) fn dismiss_inserters(&mut self) {
        let inserters = std::mem::take(&mut self.inserters);
        let is_done = |(name, port): &(Arc<str>, ClientPortId)| !self.bus.inserts(name) && self.pending(*port) == 0;
        let (done, kept): (Vec<_>, Vec<_>) = inserters.into_iter().partition(is_done);
        self.inserters = kept;
        done.into_iter().for_each(|(_, port)| self.remove_client_port(port));
    }

    fn service_touched(&mut self) {
        if self.bus.is_any_touched() {
            self.service_all_touched();
        }
    }

    /// Serves the devices with changed ports. Not inlined, which saves 60 instructions for a frame that affects no
    /// device.
    #[inline(never)]
    fn service_all_touched(&mut self) {
        let mut touched = std::mem::take(&mut self.touched);
        self.bus.swap_touched(&mut touched);
        for port in &touched {
            if let Some(id) = self.owners[port.0] {
                self.service(id);
            }
        }
        touched.clear();
        self.touched = touched;
    }

    /// Processes the due work of a device, excluding bus events.
    fn poll_device(&mut self, id: NodeId) {
        let now = self.now;
        if let Power::Coming(_, cause) = self.nodes[id.0].power {
            self.boot(id, cause);
            return;
        }
        self.finish_write(id, now);
        if self.nodes[id.0].rough.next <= now {
            self.tremble(id);
        }
        self.service(id);
    }

    fn finish_write(&mut self, id: NodeId, by: Instant) {
        self.follow_links(id);
        let now = self.now;
        let Node { write, memory, power, .. } = &mut self.nodes[id.0];
        if let Some(Write { key, record, .. }) = write.take_if(|write| write.done <= by) {
            let result = memory.store(key, &record);
            if memory.flash().is_dead() {
                // A power cut was planned for the memory word just written.
                self.cut_power(id);
            } else if let Power::On(device) = power {
                device.stored(key, result, now);
            }
        }
    }

    /// Serves a device: pumps its frames, executes its effects and updates its due time.
    pub(super) fn service(&mut self, id: NodeId) {
        if self.defer(id) {
            return;
        }
        self.follow_links(id);
        while let Some(effect) = self.pump(id) {
            self.carry_out(id, effect);
        }
    }

    /// Defers the service of a device with a slow cycle to its next cycle. Returns whether the service was deferred.
    fn defer(&mut self, id: NodeId) -> bool {
        let Node { power, electronics, write, .. } = &self.nodes[id.0];
        let cycle = electronics.cycle_from(self.now);
        if cycle <= self.now || !matches!(power, Power::On(_)) {
            return false;
        }
        self.agenda.set(id.0, write.as_ref().map_or(cycle, |write| write.done.min(cycle)));
        true
    }

    /// Pumps a device and returns its pending effect. Without an effect, schedules the next service.
    fn pump(&mut self, id: NodeId) -> Option<Effect> {
        let Self { nodes, bus, agenda, now, .. } = self;
        let now = *now;
        let Node { port, power, inputs, write, frames_dropped, electronics, rough, .. } = &mut nodes[id.0];
        let (port_id, Power::On(device)) = (*port, power) else { return None };
        let port = bus.port_mut(port_id);
        let (mode, was_bus_off) = (port.mode(), port.take_bus_off());
        let has_new_inputs = std::mem::take(&mut electronics.has_new_inputs) || rough.is_rough_shaft(inputs);
        let has_news = has_new_inputs || was_bus_off || mode != inputs.bus;
        if has_news || electronics.is_slow() {
            note_sent(&mut **device, &DeviceCan::new(bus, port_id, now), now);
        }
        if has_news {
            // A slow application notices a bus-off that has begun and ended between two cycles.
            let missed = (was_bus_off && mode != BusErrorMode::BusOff).then_some(BusErrorMode::BusOff);
            for mode in missed.into_iter().chain([mode]) {
                if mode == BusErrorMode::BusOff && inputs.bus != mode {
                    bus.drop_pending(port_id, now);
                }
                inputs.bus = mode;
                device.sense(&rough.sensed(inputs, now), now);
            }
        }
        let effect = device.pump(&mut DeviceCan::new(bus, port_id, now), now);
        if effect.is_some() {
            return effect;
        }
        let dropped = device.frames_dropped();
        if dropped > *frames_dropped {
            bus.note_dropped(port_id, dropped - *frames_dropped, now);
        }
        *frames_dropped = dropped;
        bus.refresh_used(port_id, now);
        let due = due(&**device, write.as_ref(), electronics).min(rough.next);
        // A device that is due again immediately is served at the next tick, or in its next cycle; otherwise time would
        // not advance.
        agenda.set(id.0, if due <= now { electronics.cycle_from(after(now, TICK)) } else { due });
        None
    }

    fn carry_out(&mut self, id: NodeId, effect: Effect) {
        match effect {
            Effect::Store(key, record) => self.begin_write(id, key, record),
            Effect::SetBitRate(rate) => self.set_device_rate(id, rate),
            Effect::Restart(scope) => self.restart(id, scope),
        }
    }

    fn begin_write(&mut self, id: NodeId, key: RecordKey, record: Record) {
        // The core requests one write at a time. A second write would first complete the pending write.
        self.finish_write(id, NEVER);
        self.nodes[id.0].write = Some(Write::begin(key, record, self.now, write_time(key)));
    }

    /// Returns whether a device has sent all frames and stored all records.
    fn is_settled(&self, id: NodeId) -> bool {
        let node = &self.nodes[id.0];
        !matches!(node.power, Power::On(_)) || (node.write.is_none() && self.bus.port(node.port).pending() == 0)
    }

    /// Makes a device store its pending records, and drops its pending frames.
    fn settle(&mut self, id: NodeId) {
        while !self.is_settled(id) {
            self.bus.drop_pending(self.nodes[id.0].port, self.now);
            if let Some(write) = &self.nodes[id.0].write {
                let done = write.done;
                self.run_until(done);
            }
            self.service(id);
        }
    }
}
