//! Power-up, reset application and reset communication: what each takes from the memory (SPEC 4.3, 4.5, 6).

use super::super::application::Application;
use super::super::dictionary::TABLE;
use super::super::found::Found;
use super::super::objects::PveObjects;
use super::super::records::{Factory, LayerChange, LocalLayer, decode_flag};
use super::super::setup::Setup;
use super::super::storage::{FaultLogClock, Storage};
use super::listening::Listening;
use super::storing::{Job, LayerFor};
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

impl PveCanopen {
    /// Power-up, with what the memory holds.
    #[must_use]
    pub fn power_on(setup: Setup, image: &Image, cause: StartCause, now: Instant) -> Self {
        let factory = Factory::new(setup.kind, setup.serial);
        let application = Application::new(setup.kind, Counters::default(), now);
        let local_layer = LocalLayer::new(setup.kind, setup.node_id);
        let objects = PveObjects::new(setup.kind, factory, application, now);
        let mut device = Self {
            setup,
            listening: Listening::of(&objects),
            objects,
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
            storage: Storage::new(),
            fault_log: FaultLogClock::new(),
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
        let mut found = Found::look(&setup, image);
        let parameters = found.payload(RecordKey::Parameters, |payload| Stored::decode(TABLE, payload));
        let restore = found.payload(RecordKey::RestoreFlag, decode_flag).unwrap_or(false);
        let communication_only = scope == Restart::Communication;
        if communication_only {
            self.objects.application.shut_down(now);
            // What fell due while the restart waited is counted and entered now, and told below with all that is active.
            self.report_faults(now);
        }
        self.local_layer = found.local_layer;
        self.objects.node_id = self.held_node_id.or(found.local_layer.node_id.and_then(NodeId::new));
        self.restarting = Restarting::No;
        self.nmt = NmtSlave::default();
        self.sdo = SdoServer::default();
        self.lss = LssSlave::default();
        self.emcys = WaitingEmcys::default();
        self.tx.clear();
        self.switch_to = None;

        if communication_only {
            self.objects.load(parameters, true);
        } else {
            self.bit_rate = found.local_layer.bit_rate;
            self.held_bit_rate = None;
            self.storage = Storage::new();
            self.fault_log = FaultLogClock::new();
            self.objects.set_factory(found.factory);
            self.objects.history = ErrorHistory::default();
            self.objects.application.restart(found.fault_log.counters, now);
            self.objects.load(parameters.filter(|_| !restore), false);
            self.fill(&found, restore);
            let valve = &mut self.objects.application.valve;
            found.tell_faults(valve, now);
            valve.set_internal(InternalCause::Injected, self.senses.internal_fault, now);
            valve.set_bus_off(self.senses.bus == BusErrorMode::BusOff, now);
        }
        self.listening = Listening::of(&self.objects);
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
    fn fill(&mut self, found: &Found<'_>, restore: bool) {
        let layer = Job::LocalLayer(LayerChange::default(), LayerFor::Nobody);
        let jobs = [
            (found.is_absent(RecordKey::Factory), Job::Factory),
            (found.is_absent(RecordKey::LocalLayer), layer),
            (restore, Job::Restore),
        ];
        for (needed, job) in jobs {
            // An empty queue has room for three.
            let _ = needed && self.storage.ask(job);
        }
    }
}
