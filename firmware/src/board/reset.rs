//! Why the processor starts, and what a panic does: it resets, and the next start raises the internal error.

use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use embassy_stm32::pac::RCC;
use protocol_core::device::StartCause;

/// Why the processor starts. A software reset is a panic's: nothing else asks for one.
pub(super) fn cause() -> StartCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|csr| csr.set_rmvf(true));
    if flags.wdgrstf() || flags.sftrstf() { StartCause::Watchdog } else { StartCause::PowerOn }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    defmt::error!("{}", defmt::Display2Format(info));
    SCB::sys_reset()
}
