//! The reset and clock control of `rigless`, with what it leaves out. The clock of a peripheral runs some cycles after
//! its enabling (RM0090 7.3.13: two); a read of the enable register waits for them. A missing external oscillator never
//! becomes ready.

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::rcc::Register;
use rigless::soc::stm32f427::peripherals::rcc::Rcc;
use rigless::time::EventId;

use super::Can1;

/// The bit CAN1EN in APB1ENR.
const CAN1EN: u64 = 1 << 25;
/// The bit HSERDY in CR.
const HSERDY: u64 = 1 << 17;

/// The clock control.
#[derive(Debug)]
pub(super) struct Clocks {
    pub(super) rcc: Rcc,
    can: Can1,
    has_external: bool,
    enabled: bool,
}

impl Clocks {
    pub(super) fn new(can: Can1, has_external: bool) -> Self {
        Self { rcc: Rcc::new(), can, has_external, enabled: false }
    }
}

impl Device for Clocks {
    type Register = Register;

    fn read(&mut self, register: Register, file: &mut RegisterFile, _: &mut DeviceContext<'_>) -> Option<u64> {
        if register == Register::Cr && !self.has_external {
            return Some(file.get(Register::Cr) & !HSERDY);
        }
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
