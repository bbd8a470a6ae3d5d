//! The views of the valves.

use heapless::Vec;

use super::{PveCanopen, PveIsobus};
use crate::actuator::{Fault, Valve};
use crate::device::Device as _;
use crate::device::view::{FAULTS, FaultView, ValveView, View, Viewable};
use crate::time::Instant;
use crate::wire::pdo_mapping::MappingEntry;

impl Viewable for PveCanopen {
    fn view(&self, now: Instant) -> View {
        let application = self.application();
        let control = &application.objects.control;
        let valve = &control.valve;
        View {
            node_id: self.node_id(),
            bit_rate: self.bit_rate(),
            nmt: Some(application.node.nmt_state()),
            position: valve.position(now).raw(),
            valve: Some(ValveView {
                dsm: Some(control.state()),
                command: None,
                set_point: control.set_point(),
                solenoids: valve.solenoids(),
                led: control.led(self.node_id().is_some()),
            }),
            faults: faults(valve),
        }
    }

    fn tpdo(&self) -> Option<(u32, &[MappingEntry])> {
        self.application().node.tpdo()
    }

    fn is_switching_bit_rate(&self) -> bool {
        self.application().node.is_switching_bit_rate()
    }

    fn valve(&self) -> Option<&Valve> {
        Some(self.application().valve())
    }
}

impl Viewable for PveIsobus {
    fn view(&self, now: Instant) -> View {
        let auxiliary = &self.application().auxiliary;
        let valve = &auxiliary.valve;
        View {
            node_id: self.node_id(),
            bit_rate: self.bit_rate(),
            nmt: None,
            position: valve.position(now).raw(),
            valve: Some(ValveView {
                dsm: None,
                command: Some(auxiliary.state()),
                set_point: auxiliary.set_point(),
                solenoids: valve.solenoids(),
                led: auxiliary.led(self.node_id().is_none()),
            }),
            faults: faults(valve),
        }
    }

    fn valve(&self) -> Option<&Valve> {
        Some(self.application().valve())
    }
}

fn faults(valve: &Valve) -> Vec<FaultView, FAULTS> {
    let view = |fault: Fault| FaultView {
        name: fault.name(),
        active: valve.is_active(fault),
        count: valve.counters().get(fault),
    };
    Fault::ALL.into_iter().map(view).collect()
}
