//! The application of a valve on CANopen. It combines the node of `canopen/` with the objects of the valve (SPEC 4, 7).
//!
//! ```text
//! mod        the application: node and valve
//! emergency  EMCYs and error history
//! storing    writes to the memory
//! load       restore flag
//! ```

mod emergency;
mod load;
mod storing;

use load::Load;

use super::Setup;
use super::dictionary::{DICTIONARY, Task};
use super::found::Found;
use super::identification::Identification;
use super::objects::ValveObjects;
use super::records::{LocalLayer, VERSION, decode_flag};
use super::sensing::Causes;
use crate::actuator::{Counters, InternalCause, Valve};
use crate::canopen::dictionary::Group;
use crate::canopen::lss::Configuration;
use crate::canopen::nmt::Reset;
use crate::canopen::node::{Demand, Node, Service};
use crate::canopen::parameters::Stored;
use crate::controller::{BitRate, Filter, Filters};
use crate::device::runtime::{Application, Base, Runtime};
use crate::device::writes::{Requester, Write};
use crate::device::{Inputs, Outputs, Restart, ValveOutputs};
use crate::frame::Frame;
use crate::memory::{Memory, RecordKey};
use crate::time::Instant;
use crate::uds::Reaction;
use crate::wire::cob_id::NodeId;
use crate::wire::lss::LssNodeId;

/// A PVEA or PVEO on CANopen.
pub type PveCanopen = Runtime<CanopenValve>;

/// The application of a valve on CANopen.
#[derive(Clone, Debug)]
pub struct CanopenValve {
    setup: Setup,
    pub(super) objects: ValveObjects,
    pub(super) node: Node<ValveObjects>,
    /// The stored node ID and bit rate.
    local_layer: LocalLayer,
    load: Load,
    /// The node ID and bit rate that the write in progress changes.
    layer_in_flight: Configuration,
    /// The counters that the write in progress clears. A failed write restores them.
    cleared: Counters,
    causes: Causes,
}

impl CanopenValve {
    /// Returns the protocol-independent valve.
    #[must_use]
    pub const fn valve(&self) -> &Valve {
        &self.objects.control.valve
    }

    fn execute(&mut self, demand: Demand<Task>, base: &mut Base) {
        match demand {
            Demand::Task(task) => self.begin_task(task, base),
            Demand::StoreConfiguration => base.writes.request(Write::new(RecordKey::LocalLayer, Requester::Lss)),
            Demand::Reset(reset) => base.request_restart(reset.into()),
        }
    }

    fn serve_uds(&mut self, frame: &Frame, base: &mut Base) {
        let Some(node_id) = self.node.node_id() else { return };
        let identification = Identification {
            kind: self.setup.kind,
            factory: self.objects.factory(),
            local_layer: self.local_layer,
            busy: base.writes.iter().any(|write| write.requester == Requester::Uds),
        };
        match identification.serve_node(node_id.get(), frame) {
            Reaction::Nothing => {}
            Reaction::Answer(answer) => self.node.answer(answer),
            Reaction::StoreNodeId(raw) => {
                base.writes.request(Write::new(RecordKey::LocalLayer, Requester::Uds).with(raw));
            }
        }
    }
}

impl Application for CanopenValve {
    type Setup = Setup;
    type Service = Service;

    const FAULT_LOG: bool = true;
    const RECORD_VERSION: u8 = VERSION;
    const WRITES: &'static [Write] = &storing::WRITES;

    fn new(setup: Setup) -> Self {
        Self {
            setup,
            objects: ValveObjects::new(setup.kind),
            node: Node::new(),
            local_layer: LocalLayer::UNREAD,
            load: Load::new(),
            layer_in_flight: Configuration::NONE,
            cleared: Counters::default(),
            causes: Causes::NONE,
        }
    }

    #[inline]
    fn service(&self, frame: &Frame) -> Option<Service> {
        self.node.service(frame)
    }

    fn handle(&mut self, service: Service, frame: &Frame, base: &mut Base) {
        if service == Service::OtherProtocol {
            return self.serve_uds(frame, base);
        }
        if let Some(demand) = self.node.handle(service, frame, &mut self.objects, base.now()) {
            self.execute(demand, base);
        }
    }

    /// Handles an NMT reset while a restart is pending. A wider scope replaces the pending scope.
    fn handle_restarting(&mut self, _: Service, frame: &Frame, base: &mut Base) {
        if let Some(reset) = self.node.reset_demanded(frame) {
            base.request_restart(reset.into());
        }
    }

    fn poll(&mut self, base: &mut Base) {
        self.objects.control.valve.poll(base.now());
        self.node.poll(&self.objects, base.now());
        self.retry_load(base);
    }

    #[inline]
    fn apply_changes(&mut self, base: &mut Base) {
        if self.objects.control.valve.has_changes() {
            self.report_changes(base);
        }
    }

    #[inline]
    fn deadline(&self) -> Instant {
        self.objects.control.valve.deadline().min(self.node.deadline()).min(self.load.retry_at())
    }

    fn sense(&mut self, inputs: &Inputs, base: &mut Base) {
        let bus_off = self.causes.sense(&mut self.objects.control.valve, inputs, base.now());
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
        self.node.next_frame(&self.objects, now)
    }

    fn give_back(&mut self, frame: Frame) {
        self.node.give_back(frame);
    }

    #[inline]
    fn all_sent(&mut self, _: &mut Base) -> bool {
        self.node.all_sent();
        false
    }

    fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, _: &mut Base) -> bool {
        self.node.sent_except(is_held);
        false
    }

    #[inline]
    fn has_frame(&self) -> bool {
        self.node.has_frame()
    }

    #[inline]
    fn take_bit_rate(&mut self) -> Option<BitRate> {
        self.node.take_bit_rate()
    }

    /// Starts with the contents of the memory (SPEC 4.3, 4.5, 6). Reset communication leads to FAULT_HOLD, keeps the
    /// product's own objects, and reports active faults again.
    fn start(&mut self, scope: Restart, memory: &dyn Memory, base: &mut Base) {
        let now = base.now();
        let mut found = Found::read(&self.setup, memory);
        let parameters =
            found.payload(RecordKey::Parameters, |payload| Stored::decode(DICTIONARY.entries(), Group::All, payload));
        let load_is_set = found.payload(RecordKey::RestoreFlag, decode_flag).unwrap_or(false);
        self.local_layer = found.local_layer;
        let stored = Configuration {
            node_id: found.local_layer.node_id.and_then(LssNodeId::new),
            bit_rate: Some(found.local_layer.bit_rate),
        };
        let reset = match scope {
            Restart::Communication => {
                self.objects.control.shut_down(now);
                // A fault that became due while the restart was pending must be counted before it is reported again.
                self.apply_changes(base);
                Reset::Communication
            }
            Restart::Application => {
                self.objects.set_factory(found.factory);
                self.objects.control.restart(found.fault_log.counters, now);
                Reset::Application
            }
        };
        let node_id = self.node.reset(reset, stored);
        if scope == Restart::Application {
            // The defaults depend on the node ID. Without a node ID the "load" waits for a start with a node ID.
            self.load = Load::found(load_is_set && node_id.is_some());
        }
        let parameters = parameters.filter(|_| !self.load.replaces_stored());
        self.node.boot(reset, [(Group::All, parameters)], &mut self.objects, now);
        self.report_start(scope, base);
        found.raise_faults(&mut self.objects.control.valve, now);
        base.fill(&found.reading);
        self.continue_load(base);
    }

    fn watchdog_reset(&mut self, base: &mut Base) {
        self.objects.control.valve.set_internal(InternalCause::Watchdog, true, base.now());
    }

    fn outputs(&self) -> Outputs {
        let control = &self.objects.control;
        let led = control.led(self.node.node_id().is_some());
        Outputs::Valve(ValveOutputs { solenoids: control.valve.solenoids(), led })
    }

    fn bit_rate(&self) -> BitRate {
        self.node.bit_rate()
    }

    fn node_id(&self) -> Option<u8> {
        self.node.node_id().map(NodeId::get)
    }

    fn frames_dropped(&self) -> u32 {
        self.node.frames_dropped()
    }
}
