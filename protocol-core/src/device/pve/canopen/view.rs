//! The state of a valve on CANopen for people and tools.

use super::PveCanopen;
use crate::actuator::Valve;
use crate::device::Device as _;
use crate::device::view::{ValveView, View, Viewable, valve_faults};
use crate::time::Instant;

impl Viewable for PveCanopen {
    fn view(&self, now: Instant) -> View {
        let body = self.body();
        let application = &body.objects.application;
        let valve = &application.valve;
        View {
            node_id: self.node_id(),
            bit_rate: self.bit_rate(),
            nmt: Some(body.node.nmt_state()),
            position: valve.position(now).raw(),
            valve: Some(ValveView {
                dsm: Some(application.state()),
                command: None,
                set_point: application.set_point(),
                solenoids: valve.solenoids(),
                led: application.led(self.node_id().is_some()),
            }),
            faults: valve_faults(valve),
        }
    }

    fn valve(&self) -> Option<&Valve> {
        Some(self.body().valve())
    }
}
