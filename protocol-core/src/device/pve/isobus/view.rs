//! The state of a valve on ISOBUS for people and tools.

use super::PveIsobus;
use crate::actuator::Valve;
use crate::device::Device as _;
use crate::device::view::{ValveView, View, Viewable, valve_faults};
use crate::time::Instant;

impl Viewable for PveIsobus {
    fn view(&self, now: Instant) -> View {
        let auxiliary = &self.body().auxiliary;
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
            faults: valve_faults(valve),
        }
    }

    fn valve(&self) -> Option<&Valve> {
        Some(self.body().valve())
    }
}
