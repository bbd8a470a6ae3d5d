//! The angle sensors HAT 1000 and HAT 3000 (SPEC 9).
//!
//! ```text
//! mod         the application: node and sensor
//! dictionary  object dictionary
//! objects     values of the objects, and rules
//! errors      errors that EMCYs report
//! records     payloads of the records
//! storing     writes to the memory
//! ```

mod dictionary;
mod errors;
pub(super) mod objects;
pub(super) mod records;
mod storing;

pub use super::kind::hat::Kind;
pub use dictionary::entry;
pub use errors::Error;

use dictionary::{DICTIONARY, Task};
use errors::Errors;
use objects::HatObjects;
use records::{LAYER, VERSION, decode_serial, identity, new_layer};

use super::reading::Reading;
use super::runtime::{Application, Base, Runtime};
use super::writes::{Requester, Write};
use super::{Inputs, Outputs, ProductInputs, Restart};
use crate::canopen::dictionary::Group;
use crate::canopen::lss::{Configuration, Layer};
use crate::canopen::nmt::Reset;
use crate::canopen::node::{Demand, ErrorClass, Node, Service};
use crate::canopen::parameters::Stored;
use crate::controller::{BitRate, BusErrorMode, Filter, Filters};
use crate::frame::Frame;
use crate::memory::{Memory, RecordKey};
use crate::time::Instant;
use crate::wire::cob_id::NodeId;

/// The setup of a sensor.
pub type Setup = super::Setup<Kind>;

/// A HAT 1000 or HAT 3000.
pub type Hat = Runtime<HatSensor>;

/// The application of a sensor.
#[derive(Clone, Debug)]
pub struct HatSensor {
    setup: Setup,
    pub(super) objects: HatObjects,
    pub(super) node: Node<HatObjects>,
    /// The stored node ID and bit rate.
    layer: Layer,
    /// The node ID and bit rate that the write in progress changes.
    layer_in_flight: Configuration,
    /// The task for which an SDO client waits.
    task: Option<Task>,
    /// Whether a write of the task has failed. The client gets its answer after the last write.
    task_failed: bool,
    /// The bits of the damaged records, each at the position of its record, and [`WHOLE_MEMORY`].
    damaged: u8,
    /// The errors whose last report was entered into the history.
    entered: Errors,
    internal_fault: bool,
    bus: BusErrorMode,
}

/// The bit of [`HatSensor::damaged`] for a memory that is damaged as a whole. The bit stays set until the next start.
const WHOLE_MEMORY: u8 = 1 << 7;
const _: () = assert!(RecordKey::ALL.len() <= 7);

impl HatSensor {
    /// Sets or clears an error, and reports the change.
    fn set_error(&mut self, error: Error, active: bool, base: &Base) {
        if !self.objects.errors.set(error, active) {
            return;
        }
        if !active {
            return self.node.send_emcy(self.objects.errors.end());
        }
        self.report(error);
        if error == Error::Controller {
            self.node.apply_error_behaviour(ErrorClass::Product, &mut self.objects, base.now());
        }
    }

    /// Enters an error into the history and queues its EMCY.
    fn report(&mut self, error: Error) {
        let (_, field, _) = error.codes();
        let entered = self.node.report_error(self.objects.errors.message(error), field);
        self.entered.set(error, entered);
    }

    /// Updates the error mode of the CAN controller. Bus-off replaces error-passive and is reported after recovery.
    fn set_bus(&mut self, bus: BusErrorMode, base: &Base) {
        self.bus = bus;
        let bus_off = bus == BusErrorMode::BusOff;
        self.node.set_bus_off(bus_off);
        if bus_off {
            let (code, _, register) = Error::Passive.codes();
            self.node.withdraw_error(code, register);
            self.objects.errors.set(Error::Passive, false);
            if self.objects.errors.set(Error::BusOff, true) {
                self.node.apply_error_behaviour(ErrorClass::Communication, &mut self.objects, base.now());
            }
            return;
        }
        if self.objects.errors.has(Error::BusOff) {
            self.report(Error::BusOff);
            self.set_error(Error::BusOff, false, base);
        }
        self.set_error(Error::Passive, bus == BusErrorMode::ErrorPassive, base);
    }

    fn set_damaged(&mut self, damaged: u8, base: &Base) {
        self.damaged = damaged;
        self.set_error(Error::SetUp, damaged != 0, base);
    }

    fn execute(&mut self, demand: Demand<Task>, base: &mut Base) {
        match demand {
            Demand::Task(task) => self.begin_task(task, base),
            Demand::StoreConfiguration => {
                self.objects.demanded_since = Configuration::NONE;
                base.writes.request(Write::new(RecordKey::LocalLayer, Requester::Lss));
            }
            Demand::Reset(reset) => base.request_restart(reset.into()),
        }
    }

    /// Returns the stored node ID and bit rate, or else the values for a new memory. If the record is damaged and a new
    /// memory has no node ID, returns the defaults that "load" restores. Damage therefore never removes the node ID.
    fn layer_of(&self, reading: &mut Reading<'_>) -> Layer {
        let new = new_layer(&self.setup);
        match reading.record(RecordKey::LocalLayer, VERSION, Layer::decode) {
            Some(layer) => layer,
            None if reading.is_corrupt(RecordKey::LocalLayer) && new.node_id.0.is_none() => LAYER,
            None => new,
        }
    }
}

/// Returns a group with its stored parameters. `None` stands for the defaults, for example after "load", which stores
/// an empty record.
fn parameters<'a>(reading: &mut Reading<'a>, key: RecordKey, group: Group) -> (Group, Option<Stored<'a>>) {
    let decode = |payload: &'a [u8]| match payload {
        [] => Some(None),
        payload => Stored::decode(DICTIONARY.entries(), group, payload).map(Some),
    };
    (group, reading.record(key, VERSION, decode).flatten())
}

impl Application for HatSensor {
    type Setup = Setup;
    type Service = Service;

    const FAULT_LOG: bool = false;
    const RECORD_VERSION: u8 = VERSION;
    const WRITES: &'static [Write] = &storing::WRITES;

    fn new(setup: Setup) -> Self {
        let layer = new_layer(&setup);
        Self {
            setup,
            objects: HatObjects::new(setup.kind, identity(setup.kind, setup.serial), layer),
            node: Node::new(),
            layer,
            layer_in_flight: Configuration::NONE,
            task: None,
            task_failed: false,
            damaged: 0,
            entered: Errors::NONE,
            internal_fault: false,
            bus: BusErrorMode::ErrorActive,
        }
    }

    #[inline]
    fn service(&self, frame: &Frame) -> Option<Service> {
        self.node.service(frame)
    }

    fn handle(&mut self, service: Service, frame: &Frame, base: &mut Base) {
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
        self.node.poll(&self.objects, base.now());
    }

    #[inline]
    fn apply_changes(&mut self, base: &mut Base) {
        self.node.start_itself(&mut self.objects, base.now());
        self.objects.in_force.bit_rate = self.node.bit_rate();
    }

    #[inline]
    fn deadline(&self) -> Instant {
        self.node.deadline()
    }

    fn sense(&mut self, inputs: &Inputs, base: &mut Base) {
        if let ProductInputs::Encoder(shaft) = inputs.product {
            self.objects.shaft = shaft;
        }
        self.internal_fault = inputs.internal_fault;
        self.set_error(Error::Controller, inputs.internal_fault, base);
        self.set_bus(inputs.bus, base);
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
        true
    }

    fn sent_except(&mut self, is_held: &dyn Fn(Filter) -> bool, _: &mut Base) -> bool {
        self.node.sent_except(is_held);
        true
    }

    #[inline]
    fn has_frame(&self) -> bool {
        self.node.has_frame()
    }

    #[inline]
    fn take_bit_rate(&mut self) -> Option<BitRate> {
        self.node.take_bit_rate()
    }

    /// Starts with the contents of the memory. Both scopes load both groups of parameters; only reset application
    /// applies the bit rate. Errors that outlast reset communication are reported again, and entered into the history
    /// if they have no entry.
    fn start(&mut self, scope: Restart, memory: &dyn Memory, base: &mut Base) {
        let mut reading = Reading::new(memory);
        self.layer = self.layer_of(&mut reading);
        let stored = self.layer.configuration();
        let serial = reading.record(RecordKey::Factory, VERSION, decode_serial);
        self.objects.identity = identity(self.setup.kind, serial.or(self.setup.serial));
        let node_id = match scope {
            Restart::Communication => self.node.reset(Reset::Communication, stored),
            Restart::Application => {
                self.objects.errors = Errors::NONE;
                self.node.reset(Reset::Application, stored)
            }
        };
        self.objects.demanded = self.layer;
        self.objects.in_force.node_id.0 = node_id;
        let parameters = [
            parameters(&mut reading, RecordKey::Parameters, Group::Communication),
            parameters(&mut reading, RecordKey::Application, Group::Application),
        ];
        self.node.boot(Reset::Application, parameters, &mut self.objects, base.now());

        let left = self.objects.errors;
        for error in Error::ALL.into_iter().filter(|error| *error != Error::BusOff && left.has(*error)) {
            if self.entered.has(error) {
                self.node.send_emcy(left.message(error));
            } else {
                self.report(error);
            }
        }
        let corrupt = RecordKey::ALL.into_iter().filter(|key| reading.is_corrupt(*key));
        // The memory reports damage only once, so known damage is kept.
        let known = if scope == Restart::Communication { self.damaged & WHOLE_MEMORY } else { 0 };
        let whole = if reading.is_damaged() { WHOLE_MEMORY } else { known };
        self.set_damaged(corrupt.fold(whole, |damaged, key| damaged | storing::bit(key)), base);
        if scope == Restart::Application {
            self.set_error(Error::Controller, self.internal_fault, base);
            self.set_bus(self.bus, base);
        }
        base.fill(&reading);
    }

    /// Reports a watchdog reset as a controller error, and the end of that error unless an internal fault is injected.
    fn watchdog_reset(&mut self, base: &mut Base) {
        self.set_error(Error::Controller, true, base);
        self.set_error(Error::Controller, self.internal_fault, base);
    }

    fn outputs(&self) -> Outputs {
        Outputs::Encoder
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
