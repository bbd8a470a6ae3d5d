//! Power-up, reset application and reset communication: what each takes from the memory (SPEC 4.3, 4.5, 6).

use super::super::application::Application;
use super::super::dictionary::TABLE;
use super::super::kind::Kind;
use super::super::objects::PveObjects;
use super::super::records::{Factory, LayerChange, LocalLayer, decode_fault_log, decode_flag, version};
use super::super::storage::{FaultLogClock, Job, LayerFor, Storage};
use super::{BootUp, PveCanopen, Restarting};
use crate::actuator::{Counters, InternalCause};
use crate::canopen::emcy::{ErrorHistory, WaitingEmcys};
use crate::canopen::lss::LssSlave;
use crate::canopen::nmt::NmtSlave;
use crate::canopen::parameters::Stored;
use crate::canopen::sdo_server::SdoServer;
use crate::controller::BusErrorMode;
use crate::device::tx_queue::TxQueue;
use crate::device::{Restart, Senses, StartCause};
use crate::memory::{Image, RecordKey};
use crate::time::{Instant, NEVER};
use crate::wire::cob_id::NodeId;
use crate::wire::emcy::Emcy;

/// What a valve is made as. Node ID and serial number fill a new memory; one that holds them decides by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// The product.
    pub kind: Kind,
    /// The node ID of a new memory; `None` for a valve that leaves the factory blank.
    pub node_id: Option<NodeId>,
    /// The serial number of a new memory; `None` for the manual's.
    pub serial: Option<u32>,
}

impl Setup {
    /// A valve of this kind with the default node ID and serial number.
    #[must_use]
    pub fn new(kind: Kind) -> Self {
        Self { kind, node_id: LocalLayer::default_node_id(), serial: None }
    }
}

/// The records as they were found: checked, and with the defaults in the place of what is not there.
struct Found<'a> {
    factory: Factory,
    local_layer: LocalLayer,
    parameters: Option<Stored<'a>>,
    restore: bool,
    counters: Counters,
    absent: [bool; RecordKey::ALL.len()],
    corrupt: [bool; RecordKey::ALL.len()],
}

impl<'a> Found<'a> {
    fn look(setup: &Setup, image: &'a Image) -> Self {
        let mut absent = [false; RecordKey::ALL.len()];
        let mut corrupt = [false; RecordKey::ALL.len()];
        let mut payload = |key: RecordKey| {
            let found = image.payload(key, version(key));
            mark(&mut absent, key, found == Ok(None));
            mark(&mut corrupt, key, found.is_err());
            found.ok().flatten()
        };
        let factory = payload(RecordKey::Factory);
        let local_layer = payload(RecordKey::LocalLayer);
        let parameters = payload(RecordKey::Parameters);
        let restore = payload(RecordKey::RestoreFlag);
        let fault_log = payload(RecordKey::FaultLog);
        let factory = check(factory, Factory::decode, &mut corrupt, RecordKey::Factory);
        let local_layer = check(local_layer, LocalLayer::decode, &mut corrupt, RecordKey::LocalLayer);
        // A layer that was damaged had a node ID: only one that was never written can be blank.
        let node_id = if corrupt.get(RecordKey::LocalLayer.position()) == Some(&true) {
            setup.node_id.or_else(LocalLayer::default_node_id)
        } else {
            setup.node_id
        };
        Self {
            factory: factory.unwrap_or_else(|| Factory::new(setup.kind, setup.serial)),
            local_layer: local_layer.unwrap_or_else(|| LocalLayer::new(node_id)),
            parameters: check(
                parameters,
                |payload| Stored::decode(TABLE, payload),
                &mut corrupt,
                RecordKey::Parameters,
            ),
            restore: check(restore, decode_flag, &mut corrupt, RecordKey::RestoreFlag).unwrap_or(false),
            counters: check(fault_log, decode_fault_log, &mut corrupt, RecordKey::FaultLog).unwrap_or_default(),
            absent,
            corrupt,
        }
    }

    fn is_absent(&self, key: RecordKey) -> bool {
        self.absent.get(key.position()) == Some(&true)
    }
}

fn mark(flags: &mut [bool], key: RecordKey, value: bool) {
    if let Some(flag) = flags.get_mut(key.position()) {
        *flag |= value;
    }
}

/// The meaning of a payload; one that has none is corrupt.
fn check<'a, T>(
    payload: Option<&'a [u8]>,
    decode: impl FnOnce(&'a [u8]) -> Option<T>,
    corrupt: &mut [bool],
    key: RecordKey,
) -> Option<T> {
    let decoded = decode(payload?);
    mark(corrupt, key, decoded.is_none());
    decoded
}

impl PveCanopen {
    /// Power-up, with what the memory holds.
    #[must_use]
    pub fn power_on(setup: Setup, image: &Image, cause: StartCause, now: Instant) -> Self {
        let factory = Factory::new(setup.kind, setup.serial);
        let application = Application::new(setup.kind, Counters::default(), now);
        let local_layer = LocalLayer::new(setup.node_id);
        let mut device = Self {
            setup,
            objects: PveObjects::new(setup.kind, factory, application, now),
            nmt: NmtSlave::default(),
            sdo: SdoServer::default(),
            lss: LssSlave::default(),
            emcys: WaitingEmcys::default(),
            tx: TxQueue::default(),
            boot_up: BootUp::Done,
            senses: Senses::default(),
            bit_rate: local_layer.bit_rate,
            switch_to: None,
            held_node_id: None,
            held_bit_rate: None,
            local_layer,
            storage: Storage::default(),
            fault_log: FaultLogClock::default(),
            ticket: 0,
            restarting: Restarting::No,
            deadline: NEVER,
        };
        device.start(Restart::Application, image, now);
        if cause == StartCause::Watchdog {
            device.objects.application.valve.set_internal(InternalCause::Watchdog, true, now);
        }
        device.settle(now);
        device
    }

    /// Starts anew with what the memory holds now.
    pub(super) fn start(&mut self, scope: Restart, image: &Image, now: Instant) {
        let setup = self.setup;
        let found = Found::look(&setup, image);
        let communication_only = scope == Restart::Communication;
        if communication_only {
            self.objects.application.shut_down(now);
            // What fell due while the restart waited is counted and entered now, and told below with all that is active.
            self.report_faults(now);
        }
        self.local_layer = found.local_layer;
        self.objects.node_id = self.held_node_id.or(found.local_layer.node_id);
        self.restarting = Restarting::No;
        self.nmt = NmtSlave::default();
        self.sdo = SdoServer::default();
        self.lss = LssSlave::default();
        self.emcys = WaitingEmcys::default();
        self.tx.clear();
        self.switch_to = None;

        if communication_only {
            self.objects.load(found.parameters, true);
        } else {
            self.bit_rate = found.local_layer.bit_rate;
            self.held_bit_rate = None;
            self.storage = Storage::default();
            self.fault_log = FaultLogClock::default();
            self.objects.set_factory(found.factory);
            self.objects.history = ErrorHistory::default();
            self.objects.application.restart(found.counters, now);
            self.objects.load(found.parameters.filter(|_| !found.restore), false);
            self.fill(&found);
            self.set_memory_faults(image, &found, now);
            let valve = &mut self.objects.application.valve;
            valve.set_internal(InternalCause::Injected, self.senses.internal_fault, now);
            valve.set_bus_off(self.senses.bus == BusErrorMode::BusOff, now);
        }
        self.boot_up = BootUp::Done;
        // Without a node ID the device stays in initialisation: LSS alone.
        if self.objects.node_id.is_some() {
            self.boot_up = BootUp::Due;
            self.nmt.boot();
            self.objects.heartbeat.boot(now);
            self.send_emcy(Emcy::default());
            if communication_only {
                self.repeat_faults();
            }
        }
    }

    /// Writes what a new memory lacks, and the defaults where "load" asked for them.
    fn fill(&mut self, found: &Found<'_>) {
        let layer = Job::LocalLayer(LayerChange::default(), LayerFor::Nobody);
        let jobs = [
            (found.is_absent(RecordKey::Factory), Job::Factory),
            (found.is_absent(RecordKey::LocalLayer), layer),
            (found.restore, Job::Restore),
        ];
        for (needed, job) in jobs {
            // An empty queue has room for three.
            let _ = needed && self.storage.ask(job);
        }
    }

    fn set_memory_faults(&mut self, image: &Image, found: &Found<'_>, now: Instant) {
        let valve = &mut self.objects.application.valve;
        valve.set_internal(InternalCause::Memory, image.is_damaged(), now);
        for (record, corrupt) in (0..).zip(found.corrupt) {
            valve.set_internal(InternalCause::Record(record), corrupt, now);
        }
    }
}
