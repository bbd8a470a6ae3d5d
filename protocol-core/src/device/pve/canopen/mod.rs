//! A valve on CANopen: the services of `canopen/` and `uds`, the application and the memory, put together (SPEC 4, 7).
//!
//! ```text
//! mod        the device: what goes in and comes out
//! listening  which frames are for the device
//! services   what each service does with a frame
//! emergency  faults become EMCYs, and the error history
//! start      power-up, reset application, reset communication
//! storing    writes to the memory, and who waits for them
//! ```

mod emergency;
mod listening;
mod services;
mod start;
mod storing;

use listening::{Listening, Service};
use storing::{Job, Ticket};

use super::objects::PveObjects;
use super::records::LocalLayer;
use super::setup::Setup;
use super::storage::{FaultLogClock, Storage};
use crate::actuator::{InternalCause, ValveSenses};
use crate::canopen::emcy::WaitingEmcys;
use crate::canopen::lss::LssSlave;
use crate::canopen::nmt::NmtSlave;
use crate::canopen::sdo_server::SdoServer;
use crate::controller::{BitRate, BusErrorMode, Filter, Filters};
use crate::device::tx_queue::TxQueue;
use crate::device::{Device, Effect, Outputs, Restart, Senses};
use crate::frame::Frame;
use crate::memory::{Image, RecordKey, StoreError};
use crate::time::{Instant, NEVER};
use crate::wire::cob_id::NodeId;
use crate::wire::nmt;

/// A PVEA or PVEO on CANopen.
#[derive(Debug)]
pub struct PveCanopen {
    setup: Setup,
    objects: PveObjects,
    nmt: NmtSlave,
    sdo: SdoServer,
    lss: LssSlave,
    emcys: WaitingEmcys,
    tx: TxQueue,
    listening: Listening,
    boot_up: BootUp,
    senses: Senses,
    /// In force on the bus.
    bit_rate: BitRate,
    /// To be switched to when all is sent.
    switch_to: Option<BitRate>,
    /// A node ID that was configured and not stored: in force until power-off.
    held_node_id: Option<NodeId>,
    /// A bit rate that was activated and not stored: in force until the next start.
    held_bit_rate: Option<BitRate>,
    /// As stored.
    local_layer: LocalLayer,
    storage: Storage<Job>,
    fault_log: FaultLogClock,
    /// The last request of the SDO client that waits for the memory.
    ticket: Ticket,
    restarting: Restarting,
    deadline: Instant,
}

/// How far the boot-up has come. It must be on the bus before anything else: an EMCY would overtake it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BootUp {
    /// To be handed out.
    Due,
    /// Handed out, not yet sent.
    HandedOut,
    /// Sent, or there is none because there is no node ID.
    Done,
}

/// How far a restart has come. Until it is carried out the device takes no part in the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Restarting {
    No,
    /// To be handed out when nothing is being written; under this node ID, if LSS has configured one.
    Due(Restart, Option<NodeId>),
    /// In the platform's hands.
    HandedOut,
}

impl PveCanopen {
    /// Takes a frame that is for the device. Kept apart from the look at the identifier, which most frames end with.
    #[inline(never)]
    fn take(&mut self, service: Service, frame: &Frame, now: Instant) {
        if frame.is_remote() || self.restarting != Restarting::No {
            return;
        }
        let now = self.advance(now);
        self.serve(service, frame, now);
        self.settle(now);
    }

    /// Goes to `now`, or stays at the last instant, and lets what is due by then act first.
    fn advance(&mut self, now: Instant) -> Instant {
        let now = now.max(self.objects.now);
        self.objects.now = now;
        if now >= self.deadline {
            self.run_timers(now);
        }
        now
    }

    fn run_timers(&mut self, now: Instant) {
        self.objects.application.valve.poll(now);
        self.report_faults(now);
        if let Some(bit_rate) = self.lss.poll(now) {
            self.switch_to = Some(bit_rate);
            self.held_bit_rate = Some(bit_rate);
        }
        self.release_emcys();
        if let Some(abort) = self.sdo.poll(now) {
            self.send_sdo(abort);
        }
        if self.objects.heartbeat.poll(now)
            && let Some(node_id) = self.objects.node_id
        {
            self.send_latest(nmt::heartbeat(node_id, self.nmt.state()));
        }
        if now >= self.fault_log.due() {
            self.store_fault_log();
        }
        self.schedule();
    }

    /// After anything was done: tells what became of the faults, and finds out when something is next due.
    fn settle(&mut self, now: Instant) {
        self.report_faults(now);
        self.schedule();
        // What was just set going can be due at once: a heartbeat, a change of the bit rate.
        if now >= self.deadline {
            self.run_timers(now);
        }
    }

    fn schedule(&mut self) {
        self.deadline = if self.restarting == Restarting::No {
            self.objects
                .application
                .valve
                .deadline()
                .min(self.objects.heartbeat.deadline())
                .min(self.sdo.deadline())
                .min(self.lss.deadline())
                .min(self.fault_log.due())
        } else {
            NEVER
        };
    }

    /// Whether nothing may be sent now, and what would have been is lost.
    const fn is_mute(&self) -> bool {
        matches!(self.senses.bus, BusErrorMode::BusOff) || self.lss.is_silent()
    }

    fn send(&mut self, frame: Frame) {
        if !self.is_mute() {
            self.tx.push(frame);
        }
    }

    /// Sends a frame of which only the latest is of use to anybody.
    fn send_latest(&mut self, frame: Frame) {
        if !self.is_mute() {
            self.tx.push_latest(frame);
        }
    }

    fn request_restart(&mut self, scope: Restart, node_id: Option<NodeId>) {
        self.sdo.cancel();
        self.restarting = Restarting::Due(scope, node_id);
        if self.fault_log.is_dirty() {
            self.store_fault_log();
        }
    }
}

impl Device for PveCanopen {
    #[inline]
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool {
        let Some(service) = self.listening.service(frame) else { return false };
        self.take(service, frame, now);
        true
    }

    #[inline]
    fn take_filters(&mut self) -> Option<Filters> {
        self.listening.take_filters()
    }

    fn sense(&mut self, senses: &Senses, now: Instant) {
        let now = self.advance(now);
        let was_mute = self.is_mute();
        self.senses = *senses;
        let valve = &mut self.objects.application.valve;
        let valve_senses =
            ValveSenses { supply_mv: senses.supply_mv, temperature_c: senses.temperature_c, spool: senses.spool };
        valve.sense(&valve_senses, now);
        valve.set_internal(InternalCause::Injected, senses.internal_fault, now);
        valve.set_bus_off(senses.bus == BusErrorMode::BusOff, now);
        if !was_mute && self.is_mute() {
            self.tx.clear();
        }
        if senses.bus == BusErrorMode::BusOff && self.boot_up == BootUp::HandedOut {
            // It was dropped with all that waited in the controller.
            self.boot_up = BootUp::Due;
        }
        self.release_emcys();
        self.settle(now);
    }

    #[inline]
    fn poll(&mut self, now: Instant) {
        if now >= self.deadline {
            self.advance(now);
        }
    }

    fn next_frame(&mut self, _now: Instant) -> Option<Frame> {
        match self.boot_up {
            BootUp::Done => self.tx.pop(),
            BootUp::Due if !self.is_mute() => {
                self.boot_up = BootUp::HandedOut;
                self.objects.node_id.map(|node_id| nmt::heartbeat(node_id, nmt::State::Initialising))
            }
            BootUp::Due | BootUp::HandedOut => None,
        }
    }

    fn give_back(&mut self, frame: Frame) {
        if self.boot_up == BootUp::HandedOut {
            self.boot_up = BootUp::Due;
        } else if !self.is_mute() {
            self.tx.give_back(frame);
        }
    }

    fn take_abort(&mut self) -> Option<Filter> {
        None
    }

    fn all_sent(&mut self, _now: Instant) -> bool {
        if self.boot_up == BootUp::HandedOut {
            self.boot_up = BootUp::Done;
            self.release_emcys();
        }
        !self.tx.is_empty()
    }

    fn next_effect(&mut self, all_sent: bool) -> Option<Effect> {
        if let Some(bit_rate) = self.switch_to.take() {
            self.bit_rate = bit_rate;
            return Some(Effect::SetBitRate(bit_rate));
        }
        if let Some(effect) = self.next_write() {
            return Some(effect);
        }
        match self.restarting {
            Restarting::Due(scope, node_id) if all_sent && self.storage.is_idle() => {
                self.restarting = Restarting::HandedOut;
                self.held_node_id = node_id.or(self.held_node_id);
                Some(Effect::Restart(scope))
            }
            _ => None,
        }
    }

    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant) {
        let now = self.advance(now);
        self.written(key, result.is_ok(), now);
        self.settle(now);
    }

    fn restart(&mut self, scope: Restart, image: &Image, now: Instant) {
        let now = now.max(self.objects.now);
        self.objects.now = now;
        self.start(scope, image, now);
        self.settle(now);
    }

    fn flush(&mut self, now: Instant) {
        self.advance(now);
        if self.fault_log.is_dirty() {
            self.store_fault_log();
            self.schedule();
        }
    }

    fn deadline(&self) -> Instant {
        self.deadline
    }

    fn outputs(&self) -> Outputs {
        let application = &self.objects.application;
        Outputs { solenoids: application.valve.solenoids(), led: application.led(self.objects.node_id.is_some()) }
    }

    fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    fn node_id(&self) -> Option<u8> {
        self.objects.node_id.map(NodeId::get)
    }

    fn frames_dropped(&self) -> u32 {
        self.tx.dropped()
    }
}
