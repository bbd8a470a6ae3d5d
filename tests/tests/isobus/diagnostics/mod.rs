//! DM1, DM2 and DM3: what is told of the faults, when, in which order, and what is cleared (SPEC 2, 3, 5).

mod dm1;
mod dm2;
mod dm3;

use protocol_core::actuator::{Position, SpoolFault};
use protocol_core::controller::BusErrorMode;
use protocol_core::time::Duration;
use tests::isobus::{
    BLOCK, DM1_CLEAR, DM1_REQUEST, DM2_NONE, DM2_REQUEST, DM3_DONE, DM3_REQUEST, EXTEND, FLOAT, INTERNAL, TEMPERATURE,
    TIME_GUARDING,
};
use tests::{Inputs, Rig};

const SUPPLY_HIGH: &str = "18FECA83: 04 FF 73 02 03 01 FF FF";
const SUPPLY_LOW: &str = "18FECA83: 04 FF 73 02 04 01 FF FF";

/// A change of the inputs that causes a fault, and the fault's delay in milliseconds.
type Cause = (fn(&mut Inputs), u64);

const CAUSES_INTERNAL: Cause = (|inputs| inputs.internal_fault = true, 0);
const CAUSES_TEMPERATURE: Cause = (|inputs| inputs.temperature_c = 121, 250);
const CAUSES_SUPPLY_HIGH: Cause = (|inputs| inputs.supply_mv = 36_001, 2000);
const CAUSES_SUPPLY_LOW: Cause = (|inputs| inputs.supply_mv = 8_999, 2000);

/// The faults that come from outside, and their DM1.
const SENSED: [(Cause, &str); 4] = [
    (CAUSES_INTERNAL, INTERNAL),
    (CAUSES_TEMPERATURE, TEMPERATURE),
    (CAUSES_SUPPLY_HIGH, SUPPLY_HIGH),
    (CAUSES_SUPPLY_LOW, SUPPLY_LOW),
];

/// Brings a fault about, and ends it and its shutdown; what was sent is taken.
fn undergo(valve: &mut Rig, (change, delay): Cause) {
    valve.sense(change);
    valve.advance_cyclic(delay, BLOCK);
    valve.sense(|inputs| *inputs = Inputs::default());
    valve.recover();
    valve.take();
}

/// Has this answer to a request for DM2, packets included.
#[track_caller]
fn expect_dm2(valve: &mut Rig, frames: &[&str]) {
    valve.take();
    valve.send(DM2_REQUEST);
    valve.advance_cyclic_news(1000, BLOCK, frames);
}

/// Internal error, temperature, supply high and low, brought about in another order.
fn four_previously_active() -> Rig {
    let mut valve = Rig::claimed();
    for cause in [CAUSES_SUPPLY_LOW, CAUSES_INTERNAL, CAUSES_SUPPLY_HIGH, CAUSES_TEMPERATURE] {
        undergo(&mut valve, cause);
    }
    valve
}

trait ExchangeNews {
    fn exchange_news(&mut self, request: &str, answers: &[&str]);
}

impl ExchangeNews for Rig {
    /// Sends a frame; the valve must send these, beside its estimated flow, and nothing more.
    #[track_caller]
    fn exchange_news(&mut self, request: &str, answers: &[&str]) {
        self.expect_news(&[]);
        self.send(request);
        assert_eq!(self.take_news(), answers, "answers to {request}");
    }
}
