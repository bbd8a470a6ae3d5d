//! Reset and clock control: `rigless`'s, and what it lets pass. A peripheral's clock runs some cycles after it was
//! enabled (RM0090 7.3.13: two): a read of the enable register waits for them.

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::rcc::Register;
use rigless::soc::stm32f427::peripherals::rcc::Rcc;
use rigless::time::EventId;

use super::Can1;

/// CAN1EN in APB1ENR.
const CAN1EN: u64 = 1 << 25;

/// The clock control.
#[derive(Debug)]
pub(super) struct Clocks {
    pub(super) rcc: Rcc,
    can: Can1,
    enabled: bool,
}

impl Clocks {
    pub(super) fn new(can: Can1) -> Self {
        Self { rcc: Rcc::new(), can, enabled: false }
    }
}

impl Device for Clocks {
    type Register = Register;

    fn read(&mut self, register: Register, _: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        if register == Register::Apb1enr {
            self.can.lock().clock_starts = false;
        }
        None
    }

    fn write(&mut self, register: Register, value: u64, file: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if register == Register::Apb1enr {
            let enabled = value & CAN1EN != 0;
            self.can.lock().clock_starts |= enabled && !self.enabled;
            self.enabled = enabled;
        }
        self.rcc.write(register, value, file, context);
    }

    fn on_event(&mut self, event: EventId, file: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.rcc.on_event(event, file, context);
    }

    fn on_request(&mut self, change: RequestChange, file: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.rcc.on_request(change, file, context);
    }
}
