//! The stand-in device on an STM32 board (NUCLEO-F429ZI).
//!
//! For now the bare crate: it starts, links the core and sleeps. Controller, flash, LEDs and console follow.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board {
    use core::panic::PanicInfo;

    use cortex_m::asm;
    use cortex_m::peripheral::SCB;
    use cortex_m_rt::entry;
    use protocol_core as _;

    #[entry]
    fn main() -> ! {
        loop {
            asm::wfi();
        }
    }

    /// A device that hangs is worse than one that starts anew.
    #[panic_handler]
    fn reset(_: &PanicInfo<'_>) -> ! {
        SCB::sys_reset()
    }
}

/// The host builds, lints and tests the whole workspace: there the image is an empty program.
#[cfg(not(target_os = "none"))]
fn main() {}
