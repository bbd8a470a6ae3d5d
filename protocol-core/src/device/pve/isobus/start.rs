//! Power-up and restart: what they take from the memory (SPEC 5, 6).

use super::super::found::Found;
use super::super::records::{Factory, LayerChange, LocalLayer};
use super::super::setup::Setup;
use super::super::storage::{FaultLogClock, Storage};
use super::command::Commander;
use super::listening::Listening;
use super::storing::{Job, LayerFor};
use super::{PveIsobus, Restarting};
use crate::actuator::{Counters, FaultSet, InternalCause};
use crate::controller::BusErrorMode;
use crate::device::tx_queue::TxQueue;
use crate::device::{Senses, StartCause};
use crate::frame::Frame;
use crate::isobus::address::AddressClaim;
use crate::isobus::diagnostics::Dm1;
use crate::isobus::transport::{BamReceiver, BamSender};
use crate::memory::{Image, RecordKey};
use crate::time::{Instant, NEVER};
use crate::wire::j1939_id::{Address, Pgn};
use crate::wire::name::{Fields, Name};
use crate::wire::valve::{EstimatedFlow, State};

/// What is received in packets.
const BROADCASTS: &[Pgn] = &[Pgn::COMMANDED_ADDRESS];

impl PveIsobus {
    /// Power-up, with what the memory holds.
    #[must_use]
    pub fn power_on(setup: Setup, image: &Image, cause: StartCause, now: Instant) -> Self {
        let factory = Factory::new(setup.kind, setup.serial);
        let local_layer = LocalLayer::new(setup.kind, setup.node_id);
        let claim = AddressClaim::new(name(&factory), address(setup, local_layer));
        let mut device = Self {
            setup,
            factory,
            now,
            listening: Listening::at(address(setup, local_layer)),
            claim_frame: claim.name().claim(address(setup, local_layer)),
            claim,
            answers_claims: false,
            commander: Commander::new(setup.kind.regulation(), Counters::default(), now),
            dm1: Dm1::new(),
            bam: BamSender::new(),
            receiver: BamReceiver::new(BROADCASTS),
            next_avef: NEVER,
            avef: avef(address(setup, local_layer)),
            due_services: NEVER,
            due_besides_avef: NEVER,
            previously_active: FaultSet::EMPTY,
            tx: TxQueue::default(),
            senses: Senses::default(),
            local_layer,
            storage: Storage::new(),
            fault_log: FaultLogClock::new(),
            restarting: Restarting::No,
            deadline: NEVER,
        };
        device.start(image, now);
        if cause == StartCause::Watchdog {
            device.commander.valve.set_internal(InternalCause::Watchdog, true, now);
        }
        super::Device::poll(&mut device, now);
        device.settle(now);
        device
    }

    /// Starts anew with what the memory holds now: the address is claimed.
    pub(super) fn start(&mut self, image: &Image, now: Instant) {
        let found = Found::look(&self.setup, image);
        self.factory = found.factory;
        self.local_layer = found.local_layer;
        self.previously_active = found.fault_log.previously_active;
        self.restarting = Restarting::No;
        self.tx.clear();
        self.bam = BamSender::new();
        self.receiver = BamReceiver::new(BROADCASTS);
        self.dm1 = Dm1::new();
        self.next_avef = NEVER;
        self.storage = Storage::new();
        self.fault_log = FaultLogClock::new();
        self.commander.restart(found.fault_log.counters, now);
        self.fill(&found);
        let valve = &mut self.commander.valve;
        found.tell_faults(valve, now);
        valve.set_internal(InternalCause::Injected, self.senses.internal_fault, now);
        valve.set_bus_off(self.senses.bus == BusErrorMode::BusOff, now);

        let own = address(self.setup, self.local_layer);
        self.listening = Listening::at(own);
        self.avef = avef(own);
        self.claim = AddressClaim::new(name(&self.factory), own);
        self.claim_frame = self.claim.start();
        self.send(self.claim_frame);
    }

    /// Writes what a new memory lacks.
    fn fill(&mut self, found: &Found<'_>) {
        let layer = Job::LocalLayer(LayerChange::default(), LayerFor::Nobody);
        for (key, job) in [(RecordKey::Factory, Job::Factory), (RecordKey::LocalLayer, layer)] {
            // An empty queue has room for two.
            let _ = found.is_absent(key) && self.storage.ask(job);
        }
    }
}

/// The address of a local layer: on ISOBUS there is always one.
fn address(setup: Setup, layer: LocalLayer) -> Address {
    Address::new(layer.node_id.unwrap_or(setup.kind.default_node_id()))
}

/// An AVEF of a valve that stands in neutral.
fn avef(own: Address) -> Frame {
    EstimatedFlow { extend: 0, retract: 0, state: State::Blocked }.frame(own)
}

/// Manufacturer code in the NAME.
const MANUFACTURER: u16 = 57;
/// Function in the NAME: not available.
const FUNCTION: u8 = 255;
/// Vehicle system in the NAME.
const VEHICLE_SYSTEM: u8 = 1;
/// Industry group in the NAME: agricultural and forestry equipment.
const INDUSTRY_GROUP: u8 = 2;
/// The identity number in the NAME is so much of the serial number.
const IDENTITY_MASK: u32 = 0x1F_FFFF;

/// The NAME (SPEC 1): with the manual's serial number, `01 00 20 07 08 FF 02 20`.
fn name(factory: &Factory) -> Name {
    Name::new(&Fields {
        arbitrary_address_capable: false,
        industry_group: INDUSTRY_GROUP,
        vehicle_system_instance: 0,
        vehicle_system: VEHICLE_SYSTEM,
        function: FUNCTION,
        function_instance: factory.function_instance,
        ecu_instance: 0,
        manufacturer_code: MANUFACTURER,
        identity_number: factory.identity.serial & IDENTITY_MASK,
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::kind::Kind;
    use super::*;

    #[test]
    fn the_manuals_name() {
        let name = name(&Factory::new(Kind::PveaIsobus, None));
        assert_eq!(name.to_bytes(), [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20]);
    }
}
