//! Why the processor starts, and what a panic does: it resets, and the next start raises the internal error.

use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::addr_of_mut;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use embassy_stm32::pac::RCC;
use protocol_core::device::StartCause;

/// What a reset by software was for.
#[derive(Clone, Copy)]
#[repr(u32)]
enum Marker {
    None = 0,
    Panic = 0x5041_4E49,
    PowerCycle = 0x504F_5752,
}

/// Survives a reset, and means nothing after power-up.
#[unsafe(link_section = ".uninit.MARKER")]
static mut MARKER: MaybeUninit<u32> = MaybeUninit::uninit();

/// Why the processor starts. To be asked once.
pub(super) fn cause() -> StartCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|csr| csr.set_rmvf(true));
    let marker = take_marker();
    let commanded = flags.sftrstf() && marker == Marker::PowerCycle as u32;
    let failed = flags.wdgrstf() || flags.sftrstf() && !commanded;
    if failed {
        defmt::error!("reset by {}", if marker == Marker::Panic as u32 { "a panic" } else { "the watchdog" });
    }
    if failed { StartCause::Watchdog } else { StartCause::PowerOn }
}

/// Starts as if power had come back.
pub(super) fn power_cycle() -> ! {
    reset(Marker::PowerCycle)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // Texts that are put together are left out: the code for that would take more flash than many a service.
    let (file, line) = info.location().map_or(("", 0), |location| (location.file(), location.line()));
    defmt::error!("panic at {}:{}: {}", file, line, info.message().as_str().unwrap_or(""));
    reset(Marker::Panic)
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    defmt::error!("hard fault at {:#x}", frame.pc());
    reset(Marker::Panic)
}

fn reset(marker: Marker) -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: interrupts are off, and this is the one processor.
    unsafe { addr_of_mut!(MARKER).write_volatile(MaybeUninit::new(marker as u32)) };
    SCB::sys_reset()
}

fn take_marker() -> u32 {
    let marker = addr_of_mut!(MARKER);
    // SAFETY: called at the start, before anything else could look; RAM holds some number, whatever it is.
    unsafe {
        let value = marker.cast::<u32>().read_volatile();
        marker.write_volatile(MaybeUninit::new(Marker::None as u32));
        value
    }
}
