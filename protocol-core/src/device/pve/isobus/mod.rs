//! A valve on ISOBUS: the services of `isobus/` and `uds`, the valve and the memory, put together (SPEC 5, 7).
//!
//! ```text
//! mod          the device: what goes in and comes out
//! listening    which frames are for the device
//! command      what an AVC does to the valve; shutdown and recovery
//! services     what each service does with a frame
//! diagnostics  faults become DM1 and DM2
//! start        power-up, and restart
//! storing      writes to the memory, and who waits for them
//! ```

mod command;
mod diagnostics;
mod listening;
mod services;
mod start;
mod storing;

use command::Commander;
use listening::{Listening, Service};
use storing::Job;

use super::records::{Factory, LocalLayer};
use super::setup::Setup;
use super::storage::{FaultLogClock, Storage};
use crate::actuator::{FaultSet, InternalCause, ValveSenses};
use crate::controller::{BitRate, BusErrorMode, Filter, Filters};
use crate::device::tx_queue::TxQueue;
use crate::device::{Device, Effect, Outputs, Restart, Senses};
use crate::frame::Frame;
use crate::isobus::address::{AddressClaim, Outcome};
use crate::isobus::diagnostics::Dm1;
use crate::isobus::transport::{BamReceiver, BamSender};
use crate::memory::{Image, RecordKey, StoreError};
use crate::time::{Duration, Instant, NEVER, after};
use crate::wire::dm::payload_len;
use crate::wire::name::COMMANDED_ADDRESS_LEN;
use crate::wire::valve::Command;

/// AVEF goes out so often.
const AVEF_PERIOD: Duration = Duration::from_millis(100);

/// How many senders of a commanded address are heard at once.
const SENDERS: usize = 16;

/// The longest DM2: every fault was active before.
const DM2_MAX: usize = payload_len(crate::actuator::Fault::ALL.len());

/// A PVEA or PVEO on ISOBUS.
#[derive(Debug)]
pub struct PveIsobus {
    setup: Setup,
    factory: Factory,
    now: Instant,
    listening: Listening,
    claim: AddressClaim,
    /// The claim as it goes out, made once: requests for it come often, from everybody who joins the bus.
    claim_frame: Frame,
    /// Whether it goes out when it is asked for: the address is held, and the bus can be used.
    answers_claims: bool,
    commander: Commander,
    dm1: Dm1,
    bam: BamSender<DM2_MAX>,
    receiver: BamReceiver<SENDERS, COMMANDED_ADDRESS_LEN>,
    next_avef: Instant,
    /// The last AVEF, or one like it: for its identifier.
    avef: Frame,
    /// When anything but the valve and AVEF is due.
    due_services: Instant,
    /// When anything but AVEF is due.
    due_besides_avef: Instant,
    previously_active: FaultSet,
    tx: TxQueue,
    senses: Senses,
    /// As stored.
    local_layer: LocalLayer,
    storage: Storage<Job>,
    fault_log: FaultLogClock,
    restarting: Restarting,
    deadline: Instant,
}

/// How far a restart has come. Until it is carried out the device takes no part in the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Restarting {
    No,
    /// To be handed out when nothing is being written.
    Due,
    /// In the platform's hands.
    HandedOut,
}

impl PveIsobus {
    /// Takes an AVC: most of what is for the device. A remote frame is none, for want of data.
    #[inline(never)]
    fn take_avc(&mut self, frame: &Frame, now: Instant) {
        if self.restarting != Restarting::No {
            return;
        }
        let now = self.advance(now);
        if self.claim.is_lost() {
            return;
        }
        let Ok(command) = Command::parse(frame.data()) else { return };
        let ended = self.commander.obey(command, now);
        if !ended.is_empty() {
            self.log_as_previously_active(ended, now);
            self.settle(now);
        } else if self.commander.valve.has_changes() {
            self.settle(now);
        } else {
            self.schedule_valve();
        }
    }

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
        let now = now.max(self.now);
        self.now = now;
        if now >= self.deadline {
            self.run_timers(now);
        }
        now
    }

    fn run_timers(&mut self, now: Instant) {
        self.commander.valve.poll(now);
        self.report_faults(now);
        match self.claim.poll(now) {
            Outcome::Claimed => self.next_avef = now,
            Outcome::Send(frame) => self.send(frame),
            Outcome::Nothing | Outcome::Lost => {}
        }
        if self.claim.may_send() {
            self.send_cyclic(now);
        }
        if now >= self.fault_log.due() {
            self.store_fault_log();
        }
        self.schedule();
    }

    /// Sends AVEF, which is due.
    #[inline]
    fn send_avef(&mut self, now: Instant) {
        if !self.is_mute() {
            self.tx.push_latest(self.avef(now));
        }
        let planned = after(self.next_avef, AVEF_PERIOD);
        // After a pause longer than a period there is no burst of what was missed.
        self.next_avef = if planned > now { planned } else { after(now, AVEF_PERIOD) };
    }

    #[inline]
    fn avef(&self, now: Instant) -> Frame {
        self.avef.with_data(self.commander.estimated_flow(now).emit())
    }

    /// What is sent in a cycle, and goes out only under an address.
    fn send_cyclic(&mut self, now: Instant) {
        let Some(own) = self.claim.address() else { return };
        if now >= self.next_avef {
            self.send_avef(now);
        }
        self.send_dm1(now);
        if let Some(frame) = self.bam.poll(own, now) {
            self.send(frame);
        }
    }

    /// After anything was done: tells what became of the faults, and finds out when something is next due.
    fn settle(&mut self, now: Instant) {
        self.report_faults(now);
        self.schedule();
        if now >= self.deadline {
            self.run_timers(now);
        }
    }

    fn schedule(&mut self) {
        let running = self.restarting == Restarting::No;
        self.answers_claims = running && self.claim.address().is_some() && !self.is_mute();
        if !running {
            (self.due_services, self.due_besides_avef, self.deadline) = (NEVER, NEVER, NEVER);
            return;
        }
        self.due_services = self.claim.deadline().min(self.fault_log.due());
        if self.claim.may_send() {
            self.due_services = self.due_services.min(self.dm1.deadline()).min(self.bam.deadline());
        }
        self.schedule_valve();
    }

    /// The same when the valve alone can be due at another time than before.
    #[inline]
    fn schedule_valve(&mut self) {
        self.due_besides_avef = self.due_services.min(self.commander.valve.deadline());
        self.deadline = self.due_besides_avef.min(self.next_avef);
    }

    /// Whether the bus cannot be used: what would have been sent is lost.
    fn is_mute(&self) -> bool {
        self.senses.bus == BusErrorMode::BusOff
    }

    fn send(&mut self, frame: Frame) {
        if !self.is_mute() {
            self.tx.push(frame);
        }
    }

    /// Nothing more goes out, nor what waits to.
    fn fall_silent(&mut self) {
        self.tx.clear();
        self.bam.cancel();
    }

    fn request_restart(&mut self) {
        self.restarting = Restarting::Due;
        if self.fault_log.is_dirty() {
            self.store_fault_log();
        }
    }
}

impl Device for PveIsobus {
    #[inline]
    fn handle(&mut self, frame: &Frame, now: Instant) -> bool {
        match self.listening.service(frame) {
            None => return false,
            Some(Service::Avc) => self.take_avc(frame, now),
            // No time has to pass for this answer, and it is asked for often.
            Some(Service::ClaimRequest) if self.answers_claims => self.tx.push(self.claim_frame),
            Some(service) => self.take(service, frame, now),
        }
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
        let valve = &mut self.commander.valve;
        let valve_senses =
            ValveSenses { supply_mv: senses.supply_mv, temperature_c: senses.temperature_c, spool: senses.spool };
        valve.sense(&valve_senses, now);
        valve.set_internal(InternalCause::Injected, senses.internal_fault, now);
        valve.set_bus_off(senses.bus == BusErrorMode::BusOff, now);
        if self.is_mute() {
            self.fall_silent();
        } else if was_mute && self.claim.is_begun() {
            // The claim that could not be sent.
            self.tx.push(self.claim_frame);
        }
        self.settle(now);
    }

    #[inline]
    fn poll(&mut self, now: Instant) {
        if now < self.deadline {
            return;
        }
        if now < self.due_besides_avef {
            // Nothing but AVEF, ten times a second. What is due is not before the last instant.
            self.now = now;
            self.send_avef(now);
            self.deadline = self.due_besides_avef.min(self.next_avef);
        } else {
            self.advance(now);
        }
    }

    #[inline]
    fn next_frame(&mut self, _now: Instant) -> Option<Frame> {
        self.tx.pop()
    }

    fn give_back(&mut self, frame: Frame) {
        if !self.is_mute() {
            self.tx.give_back(frame);
        }
    }

    fn take_abort(&mut self) -> Option<Filter> {
        None
    }

    fn all_sent(&mut self, now: Instant) -> bool {
        if (self.claim.is_begun() || self.bam.is_handed_out()) && !self.is_mute() {
            // The wait for objections and the distance of packets count from here.
            let now = now.max(self.now);
            self.claim.sent(now);
            self.bam.sent(now);
            self.schedule();
        }
        !self.tx.is_empty()
    }

    fn next_effect(&mut self, all_sent: bool) -> Option<Effect> {
        if let Some(effect) = self.next_write() {
            return Some(effect);
        }
        if all_sent && self.restarting == Restarting::Due && self.storage.is_idle() {
            self.restarting = Restarting::HandedOut;
            return Some(Effect::Restart(Restart::Application));
        }
        None
    }

    fn stored(&mut self, key: RecordKey, result: Result<(), StoreError>, now: Instant) {
        let now = self.advance(now);
        self.written(key, result.is_ok(), now);
        self.settle(now);
    }

    fn restart(&mut self, _scope: Restart, image: &Image, now: Instant) {
        let now = now.max(self.now);
        self.now = now;
        self.start(image, now);
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
        let solenoids = self.commander.valve.solenoids();
        Outputs { solenoids, led: self.commander.led(self.claim.is_lost()) }
    }

    fn bit_rate(&self) -> BitRate {
        self.local_layer.bit_rate
    }

    /// The address in force; `None` when it was lost.
    fn node_id(&self) -> Option<u8> {
        self.claim.address().map(crate::wire::j1939_id::Address::get)
    }

    fn frames_dropped(&self) -> u32 {
        self.tx.dropped()
    }
}
