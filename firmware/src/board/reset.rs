//! Why the processor starts, and what a panic does: it resets, and the next start raises the internal error.

use core::arch::asm;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::addr_of_mut;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac::RCC;
use protocol_core::device::StartCause;

/// Tells the next start that this one ended in a panic. Any other reset by software, the console's or a debugger's, is
/// as if power had come back.
const PANIC: u32 = 0x5041_4E49;

/// Survives a reset, and means nothing after power-up.
#[unsafe(link_section = ".uninit.MARKER")]
static mut MARKER: MaybeUninit<u32> = MaybeUninit::uninit();

/// Returns why the processor starts. To be asked once.
pub(super) fn cause() -> StartCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|csr| csr.set_rmvf(true));
    let panicked = mark(0) == PANIC && flags.sftrstf();
    if panicked {
        defmt::error!("reset by a panic");
    } else if flags.wdgrstf() {
        defmt::error!("reset by the watchdog");
    }
    if panicked || flags.wdgrstf() { StartCause::Watchdog } else { StartCause::PowerOn }
}

/// Starts as if power had come back.
pub(super) fn power_cycle() -> ! {
    SCB::sys_reset()
}

/// Tells that there was a panic, not where: the texts and places of all panics would take 10 KiB of flash. A debugger
/// that stops here (`probe-rs`, a breakpoint at `rust_begin_unwind`) shows the stack.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    fail(|| defmt::error!("panic"))
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    fail(|| defmt::error!("hard fault at {:#x}", frame.pc()))
}

/// Resets the processor. A failure of the log comes here once more, and is not logged.
fn fail(log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    if mark(PANIC) != PANIC {
        log();
    }
    SCB::sys_reset()
}

/// Replaces the marker; returns the last one, which is any number after power-up.
fn mark(value: u32) -> u32 {
    let marker = addr_of_mut!(MARKER);
    let last;
    // SAFETY: called at the start, before anything else could look, or with interrupts off. RAM that was never written
    // is no number to the compiler: the empty instruction makes it one.
    unsafe {
        asm!("/* {} */", inlateout(reg) marker.read_volatile() => last, options(pure, nomem, nostack, preserves_flags));
        marker.write_volatile(MaybeUninit::new(value));
    }
    last
}
