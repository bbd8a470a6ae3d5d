//! The cause of a start, and the handling of panics. A panic resets the processor, and the next start raises the
//! internal error.

use core::arch::asm;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::addr_of_mut;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac::RCC;
use protocol_core::device::StartCause;

/// The value of the marker after a panic. Without it, a software reset (by the console or a debugger) counts as
/// power-up.
const PANIC: u32 = 0x5041_4E49;

/// The marker, which a reset does not change. After power-up its value is undefined.
#[unsafe(link_section = ".uninit.MARKER")]
static mut MARKER: MaybeUninit<u32> = MaybeUninit::uninit();

/// Returns the cause of the start. This function may be called only once.
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

/// Restarts the processor as after power-up.
pub(super) fn power_cycle() -> ! {
    SCB::sys_reset()
}

/// Logs that a panic occurred. Message and location are not logged, because the texts of all panics take 10 KiB of
/// flash. A debugger that stops here (`probe-rs`, a breakpoint at `rust_begin_unwind`) shows the stack.
#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    fail(|| defmt::error!("panic"))
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    fail(|| defmt::error!("hard fault at {:#x}", frame.pc()))
}

/// Resets the processor. If `log` panics, the panic handler calls this function again, which then does not log.
fn fail(log: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    if mark(PANIC) != PANIC {
        log();
    }
    SCB::sys_reset()
}

/// Replaces the marker. Returns the previous value, which is arbitrary after power-up.
fn mark(value: u32) -> u32 {
    let marker = addr_of_mut!(MARKER);
    let last;
    // SAFETY: called before any other access at the start, or with interrupts off. Uninitialised RAM has no value for
    // the compiler; the empty instruction gives it one.
    unsafe {
        asm!("/* {} */", inlateout(reg) marker.read_volatile() => last, options(pure, nomem, nostack, preserves_flags));
        marker.write_volatile(MaybeUninit::new(value));
    }
    last
}
