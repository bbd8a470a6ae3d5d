//! The application of a valve on ISOBUS. It combines the node of `isobus/` with an auxiliary valve (SPEC 5, 7).
//!
//! ```text
//! mod      the application: node and valve
//! product  groups, NAME and address
//! storing  writes to the memory
//! ```

mod product;
mod storing;

use heapless::Vec;

use product::{RULES, address, name};
use storing::Clearing;

use super::Setup;
use super::auxiliary_valve::AuxiliaryValve;
use super::fault_codes::codes;
use super::found::Found;
use super::identification::Identification;
use super::records::{Factory, LocalLayer, VERSION};
use super::sensing::Causes;
use crate::actuator::{Fault, FaultSet, InternalCause, Valve};
use crate::controller::{BitRate, Filter, Filters};
use crate::device::runtime::{Application, Base, Runtime};
use crate::device::writes::{Requester, Write};
use crate::device::{Inputs, Outputs, Restart, ValveOutputs};
use crate::frame::Frame;
use crate::isobus::node::{Indication, Node, Service};
use crate::memory::{Memory, RecordKey};
use crate::time::Instant;
use crate::uds::Reaction;
use crate::wire::dm::payload_len;
use crate::wire::j1939_id::Address;
use crate::wire::valve::Command;

/// The length of the longest DM2, in which all faults were previously active.
const DM2_MAX: usize = payload_len(Fault::ALL.len());

/// The number of DM3s that can wait for the memory (A).
const CLEARINGS: usize = 8;

/// A PVEA or PVEO on ISOBUS.
pub type PveIsobus = Runtime<IsobusValve>;

/// The application of a valve on ISOBUS.
#[derive(Clone, Debug)]
pub struct IsobusValve {
    setup: Setup,
    factory: Factory,
    /// The stored address and bit rate.
    local_layer: LocalLayer,
    node: Node<DM2_MAX>,
    pub(super) auxiliary: AuxiliaryValve,
    clearing: Vec<Clearing, CLEARINGS>,
    /// The faults that a waiting DM3 will clear. A fault that occurs again leaves the set.
    clearable: FaultSet,
    causes: Causes,
}

impl IsobusValve {
    /// Returns the protocol-independent valve.
    #[must_use]
    pub const fn valve(&self) -> &Valve {
        &self.auxiliary.valve
    }

    /// Ends a watchdog reset, which is momentary, once DM1 has reported its fault. Returns true, because the deadline
    /// may have changed.
    fn end_reported(&mut self, base: &Base) -> bool {
        let valve = &mut self.auxiliary.valve;
        if valve.is_active(Fault::Internal)
            && self.node.reported().is_some_and(|trouble| trouble.dtc == codes(Fault::Internal).dtc)
        {
            valve.set_internal(InternalCause::Watchdog, false, base.now());
        }
        true
    }

    /// Reports the fault changes to DM1 and to the fault log. A waiting DM3 will not clear a fault that has occurred
    /// again.
    fn report_changes(&mut self, base: &mut Base) {
        let now = base.now();
        let changes = self.auxiliary.take_changes(now);
        self.clearable = self.clearable.difference(changes.activated);
        let active = self.auxiliary.valve.faults();
        let trouble = |fault| self.auxiliary.trouble(fault);
        if !changes.activated.is_empty() {
            // A fault that cleared at once is reported as well.
            self.node.set_active(active.union(changes.cleared).highest().map(trouble), now);
        }
        self.node.set_active(active.highest().map(trouble), now);
        if self.auxiliary.valve.take_counters_changed() {
            base.fault_log.changed(now);
        }
    }

    /// Requests the write of a commanded address that the product permits. The valve restarts once the address is
    /// stored.
    fn store_address(&self, address: Address, base: &mut Base) {
        if self.setup.kind.node_ids().contains(&address.get()) {
            let write = Write::new(RecordKey::LocalLayer, Requester::CommandedAddress);
            base.writes.request(write.with(address.get()));
        }
    }

    fn serve_uds(&mut self, frame: &Frame, base: &mut Base) {
        let Some(own) = self.node.voice() else { return };
        let identification = Identification {
            kind: self.setup.kind,
            factory: &self.factory,
            local_layer: self.local_layer,
            busy: base.writes.iter().any(|write| write.requester == Requester::Uds),
        };
        match identification.serve_node(own.get(), frame) {
            Reaction::Nothing => {}
            Reaction::Answer(frame) => self.node.answer(frame),
            Reaction::StoreNodeId(address) => {
                base.writes.request(Write::new(RecordKey::LocalLayer, Requester::Uds).with(address));
            }
        }
    }
}

impl Application for IsobusValve {
    type Setup = Setup;
    type Service = Service;

    const FAULT_LOG: bool = true;
    const RECORD_VERSION: u8 = VERSION;
    const WRITES: &'static [Write] = &storing::WRITES;

    fn new(setup: Setup) -> Self {
        let factory = Factory::new(setup.kind, setup.serial);
        let local_layer = LocalLayer::new(setup);
        let own = address(&setup, local_layer);
        Self {
            setup,
            factory,
            local_layer,
            node: Node::new(&RULES, name(&factory), own),
            auxiliary: AuxiliaryValve::new(setup.kind.actuator_type(), Instant::MIN),
            clearing: Vec::new(),
            clearable: FaultSet::EMPTY,
            causes: Causes::NONE,
        }
    }

    #[inline]
    fn service(&self, frame: &Frame) -> Option<Service> {
        self.node.service(frame)
    }

    fn handle(&mut self, service: Service, frame: &Frame, base: &mut Base) {
        match self.node.handle(service, frame, base.now()) {
            Indication::Nothing => {}
            Indication::Command => {
                if let Ok(command) = Command::parse(frame.data()) {
                    self.auxiliary.execute(command, base.now());
                }
            }
            Indication::OtherProtocol => self.serve_uds(frame, base),
            Indication::ClearPreviouslyActive(request) => self.clear_previously_active(request, base),
            Indication::CommandedAddress(address) => self.store_address(address, base),
            Indication::AddressLost => self.auxiliary.block(base.now()),
        }
    }

    /// Handles address claims while a restart is pending, to defend or lose the address (A). The valve is already off.
    fn handle_restarting(&mut self, service: Service, frame: &Frame, base: &mut Base) {
        if service == Service::Claim {
            self.node.handle(service, frame, base.now());
        }
    }

    fn poll(&mut self, base: &mut Base) {
        self.auxiliary.valve.poll(base.now());
        self.node.run_timers(base.now());
    }

    #[inline]
    fn apply_changes(&mut self, base: &mut Base) {
        if self.auxiliary.valve.has_changes() {
            self.report_changes(base);
        }
    }

    #[inline]
    fn deadline(&self) -> Instant {
        self.node.deadline().min(self.auxiliary.valve.deadline())
    }

    fn sense(&mut self, inputs: &Inputs, base: &mut Base) {
        let bus_off = self.causes.sense(&mut self.auxiliary.valve, inputs, base.now());
        self.node.set_bus_off(bus_off);
    }

    #[inline]
    fn take_filters(&mut self) -> Option<Filters> {
        self.node.take_filters()
    }

    #[inline]
    fn take_abort(&mut self) -> Option<Filter> {
        self.node.take_abort()
    }

    #[inline]
    fn next_frame(&mut self, now: Instant) -> Option<Frame> {
        self.node.next_frame(now, &self.auxiliary)
    }

    fn give_back(&mut self, frame: Frame) {
        self.node.give_back(frame);
    }

    fn all_sent(&mut self, base: &mut Base) -> bool {
        self.node.all_sent(base.now());
        self.end_reported(base)
    }

    fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, base: &mut Base) -> bool {
        self.node.sent_except(is_held, base.now());
        self.end_reported(base)
    }

    #[inline]
    fn has_frame(&self) -> bool {
        self.node.has_frame()
    }

    fn take_bit_rate(&mut self) -> Option<BitRate> {
        None
    }

    /// Starts with the contents of the memory, and claims the address.
    fn start(&mut self, _: Restart, memory: &dyn Memory, base: &mut Base) {
        let now = base.now();
        let found = Found::read(&self.setup, memory);
        self.factory = found.factory;
        self.local_layer = found.local_layer;
        self.clearing.clear();
        self.clearable = FaultSet::EMPTY;
        self.auxiliary.restart(found.fault_log.counters, now);
        let valve = &mut self.auxiliary.valve;
        found.raise_faults(valve, now);
        self.causes.apply(valve, now);
        let own = address(&self.setup, self.local_layer);
        self.node.restart(name(&self.factory), own);
        base.fill(&found.reading);
    }

    fn watchdog_reset(&mut self, base: &mut Base) {
        self.auxiliary.valve.set_internal(InternalCause::Watchdog, true, base.now());
    }

    fn outputs(&self) -> Outputs {
        let led = self.auxiliary.led(self.node.address().is_none());
        Outputs::Valve(ValveOutputs { solenoids: self.auxiliary.valve.solenoids(), led })
    }

    fn bit_rate(&self) -> BitRate {
        self.local_layer.bit_rate
    }

    /// Returns the address in force; `None` after its loss.
    fn node_id(&self) -> Option<u8> {
        self.node.address().map(Address::get)
    }

    fn frames_dropped(&self) -> u32 {
        self.node.dropped()
    }
}
