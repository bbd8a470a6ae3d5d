//! The stand-in device on an STM32 board (NUCLEO-F429ZI).
//!
//! For now the bare crate: it starts a valve, which links the whole core for the board, and sleeps. CAN controller,
//! flash, LED and console follow.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board {
    use core::hint::black_box;
    use core::panic::PanicInfo;

    use cortex_m::asm;
    use cortex_m::peripheral::SCB;
    use cortex_m_rt::entry;
    use protocol_core::device::pve::{Kind, PveCanopen, Setup};
    use protocol_core::device::{Device, StartCause};
    use protocol_core::memory::Image;
    use protocol_core::time::Instant;

    #[entry]
    fn main() -> ! {
        let setup = Setup::new(Kind::PveaCanopen);
        let mut valve = PveCanopen::power_on(setup, &Image::empty(), StartCause::PowerOn, Instant::MIN);
        // There is no controller to pump it through yet: keep the linker from dropping what nobody calls.
        let device: &mut dyn Device = &mut valve;
        black_box(device);
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
