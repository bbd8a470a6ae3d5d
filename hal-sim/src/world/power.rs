//! Power-on, power-off, and the effects of a start or restart on the hardware of a device.
//!
//! The mechanics outlast the electronics: the spool of a valve is kept from the end of a program to the next start.

use protocol_core::device::{Restart, StartCause};
use protocol_core::time::{Duration, Instant, after, since};

use super::electronics::{Electronics, is_answer};
use super::node::{Node, Power};
use super::{NodeId, World};
use crate::bus::SlowAnswers;

/// The time window in which devices on a common supply start (A).
pub const SUPPLY_JITTER: Duration = Duration::from_millis(5);

impl World {
    /// Powers on a device that is off, or cuts its power immediately. A power cut tears a write in progress.
    pub fn power(&mut self, node: NodeId, on: bool) {
        if on {
            self.power_with(node, StartCause::PowerOn);
        } else {
            self.nodes[node.0].electronics.is_browned_out = false;
            self.cut_power(node);
        }
    }

    /// Powers on a device with a given start cause. A running device restarts, as after a processor reset; with
    /// [`StartCause::PowerOn`], a running device is unaffected.
    pub fn power_with(&mut self, node: NodeId, cause: StartCause) {
        let boot = self.electronics(node).boot;
        match self.nodes[node.0].power {
            Power::On(_) if cause == StartCause::PowerOn => return,
            Power::Coming(..) if cause == StartCause::PowerOn && boot > Duration::from_ticks(0) => return,
            Power::On(_) => self.cut_power(node),
            Power::Coming(..) | Power::Off => {}
        }
        if self.nodes[node.0].is_undervoltage() {
            self.nodes[node.0].electronics.is_browned_out = true;
        } else if boot > Duration::from_ticks(0) {
            self.come(node, after(self.now, boot), cause);
        } else {
            self.boot(node, cause);
        }
    }

    /// Powers on all devices that are off, each after a random delay up to `jitter`: [`SUPPLY_JITTER`] as on real
    /// machines, or zero for a simultaneous start.
    pub fn power_all(&mut self, jitter: Duration) {
        for node in self.devices() {
            if let Power::Off = self.nodes[node.0].power {
                let start = after(self.now, self.jitter(jitter));
                let state = &mut self.nodes[node.0];
                state.electronics.is_browned_out = state.is_undervoltage();
                if !state.electronics.is_browned_out {
                    self.come(node, after(start, self.electronics(node).boot), StartCause::PowerOn);
                }
            }
        }
    }

    fn come(&mut self, node: NodeId, start: Instant, cause: StartCause) {
        self.nodes[node.0].power = Power::Coming(start, cause);
        self.agenda.set(node.0, start);
    }

    /// Returns whether a device is running.
    #[must_use]
    pub fn is_powered(&self, node: NodeId) -> bool {
        self.on(node).is_some()
    }

    /// Returns whether the processor of a device can be reset: the device runs or starts.
    pub(crate) fn can_reset(&self, node: NodeId) -> bool {
        !matches!(self.nodes[node.0].power, Power::Off)
    }

    /// Reads the memory, creates the device and connects its controller.
    pub(super) fn boot(&mut self, id: NodeId, cause: StartCause) {
        self.follow_links(id);
        let now = self.now;
        let node = &mut self.nodes[id.0];
        node.memory.power_up();
        let image = node.memory.read_image();
        if node.memory.flash().is_dead() {
            // A planned power cut occurred while the memory completed an interrupted operation.
            self.cut_power(id);
            return;
        }
        let device = (node.factory)(&image, cause, now);
        let rate = device.bit_rate();
        node.power = Power::On(device);
        node.frames_dropped = 0;
        node.electronics.started = now;
        let (port, forced) = (node.port, node.forced_bus_off);
        self.set_device_rate(id, rate);
        self.bus.connect(port, now);
        if forced {
            self.bus.force_bus_off(port, true, now);
        }
        let node = &mut self.nodes[id.0];
        node.inputs.bus = self.bus.port(port).mode();
        node.rough.start(now);
        node.take_over_spool(now);
        node.sense(now);
        self.service(id);
    }

    pub(super) fn cut_power(&mut self, id: NodeId) {
        self.follow_links(id);
        let now = self.now;
        self.rate_changes += 1;
        let node = &mut self.nodes[id.0];
        if let Power::On(device) = std::mem::replace(&mut node.power, Power::Off) {
            node.released = device.valve().cloned();
        }
        node.release(now);
        if let Some(write) = node.write.take() {
            let (passed, whole) = (since(now, write.began), since(write.done, write.began));
            node.memory.store_cut(write.key, &write.record, passed.as_ticks(), whole.as_ticks());
        }
        self.bus.disconnect(node.port, now);
        self.agenda.set(id.0, node.due());
    }

    /// Executes an [`Effect::Restart`](protocol_core::device::Effect::Restart).
    pub(super) fn restart(&mut self, id: NodeId, scope: Restart) {
        let now = self.now;
        let Node { port, memory, power, .. } = &mut self.nodes[id.0];
        let Power::On(device) = power else { return };
        let image = memory.read_image();
        self.bus.drop_own(*port, now);
        device.restart(scope, &image, now);
        let rate = device.bit_rate();
        self.set_device_rate(id, rate);
    }

    /// Sets the electronics of a device. A new start delay applies from the next start.
    pub fn set_electronics(&mut self, node: NodeId, electronics: Electronics) {
        self.fit_electronics(node, electronics);
        self.watch_supply(node);
        self.service(node);
    }

    /// Sets the electronics of a device, without an effect on its power.
    pub(super) fn fit_electronics(&mut self, node: NodeId, electronics: Electronics) {
        let earlier = std::mem::replace(&mut self.nodes[node.0].electronics.settings, electronics);
        let port = self.nodes[node.0].port;
        if electronics.answer != earlier.answer {
            let (from, to) = electronics.answer;
            let random = fastrand::Rng::with_seed(self.random.u64(..));
            let slow = SlowAnswers { is_answer, from, to, random };
            self.bus.delay_answers(port, Some(slow).filter(|_| to > Duration::from_ticks(0)));
        }
        if electronics.cycle != earlier.cycle {
            self.bus.queue_frames(port, electronics.cycle > Duration::from_ticks(0));
        }
    }

    /// Returns the electronics of a device.
    #[must_use]
    pub fn electronics(&self, node: NodeId) -> Electronics {
        self.nodes[node.0].electronics.settings
    }

    /// Switches a device off when its supply falls below the undervoltage limit, and on again when the supply recovers.
    pub(super) fn watch_supply(&mut self, node: NodeId) {
        let is_low = self.nodes[node.0].is_undervoltage();
        let state = &mut self.nodes[node.0];
        match (&state.power, is_low) {
            (Power::On(_) | Power::Coming(..), true) => {
                state.electronics.is_browned_out = true;
                self.cut_power(node);
            }
            (Power::Off, false) if std::mem::take(&mut state.electronics.is_browned_out) => self.power(node, true),
            _ => {}
        }
    }
}

impl Node {
    /// Returns whether the supply is below the device's undervoltage limit.
    pub(super) fn is_undervoltage(&self) -> bool {
        let supply = self.inputs.valve().map(|valve| valve.supply_mv);
        self.electronics.settings.brown_out_mv.zip(supply).is_some_and(|(limit, supply)| supply < limit)
    }
}

#[cfg(test)]
#[path = "power_tests.rs"]
mod tests;
