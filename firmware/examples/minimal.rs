//! The smallest firmware: one CANopen valve, which is pumped each millisecond. A port starts from this file.
//!
//! A port replaces [`Controller`] by its driver and [`NoMemory`] by its flash. Here words in RAM represent the
//! registers of the controller, and `tests/firmware-in-the-loop/run --test firmware minimal` simulates the bus behind
//! them.
//!
//! A port also replaces [`TICK_CYCLES`] by its clock, and `memory.x` at the top of the repository. It omits the package
//! `firmware`, whose memory functions are for a Cortex-M4. At every change of the controller's error mode, it calls
//! `sense`.
//!
//! The loop counts its periods. If a period lasts longer than [`TICK`], for example during an erase of the flash, the
//! time of the valve falls behind. A port with such a flash reads a timer instead.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {}

#[cfg(target_os = "none")]
mod image {
    use core::convert::Infallible;
    use core::mem::MaybeUninit;
    use core::panic::PanicInfo;
    use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

    use cortex_m::peripheral::{SCB, syst::SystClkSource};
    use cortex_m_rt::{entry, exception};
    // These functions copy memory.
    use firmware as _;
    use protocol_core::controller::{BitRate, Filter, Filters};
    use protocol_core::device::pve::{Kind, PveCanopen, Setup};
    use protocol_core::device::{Device as _, Effect, Inputs, StartCause};
    use protocol_core::frame::{Frame, extended, standard};
    use protocol_core::memory::{Corrupt, Memory, Record, RecordKey, StoreError};
    use protocol_core::pump::pump;
    use protocol_core::time::{Duration, Instant, after};

    unsafe extern "C" {
        fn DefaultHandler();
    }

    /// The interrupt table, which the start-up code needs. The loop uses no interrupts, and the table of the entire
    /// chip takes 364 bytes. A port with interrupts uses its PAC instead.
    #[unsafe(no_mangle)]
    #[unsafe(link_section = ".vector_table.interrupts")]
    static __INTERRUPTS: [unsafe extern "C" fn(); 1] = [DefaultHandler];

    /// The period of the loop, and the same in cycles of the processor, which starts at 16 MHz.
    const TICK: Duration = Duration::from_millis(1);
    const TICK_CYCLES: u32 = 16_000;

    /// The registers of the CAN controller.
    static REGISTERS: Registers =
        Registers { received: Mailbox::empty(), to_send: Mailbox::empty(), bit_rate: AtomicU32::new(0) };

    #[repr(C)]
    struct Registers {
        received: Mailbox,
        to_send: Mailbox,
        /// The bit rate in bits per second.
        bit_rate: AtomicU32,
    }

    /// A mailbox: the identifier of its frame as a [`Frame::key`] with the bit `FULL`, length and data.
    #[repr(C)]
    struct Mailbox {
        key: AtomicU32,
        len: AtomicU32,
        data: [AtomicU32; 2],
    }

    impl Mailbox {
        const FULL: u32 = 1 << 31;
        const EXTENDED: u32 = 1 << 29;

        const fn empty() -> Self {
            Self { key: AtomicU32::new(0), len: AtomicU32::new(0), data: [AtomicU32::new(0), AtomicU32::new(0)] }
        }

        fn is_full(&self) -> bool {
            self.key.load(Relaxed) & Self::FULL != 0
        }

        fn take(&self) -> Option<Frame> {
            let key = self.key.load(Relaxed);
            let id = if key & Self::EXTENDED == 0 { standard(key as u16).into() } else { extended(key).into() };
            let [low, high] = self.data.each_ref().map(|word| u64::from(word.load(Relaxed)));
            let frame = Frame::with_len(id, (high << 32 | low).to_le_bytes(), self.len.load(Relaxed) as u8);
            let was_full = self.is_full();
            self.key.store(0, Relaxed);
            was_full.then_some(frame)
        }

        fn put(&self, frame: &Frame) {
            let data = u64::from_le_bytes(*frame.bytes());
            self.len.store(frame.len().into(), Relaxed);
            self.data[0].store(data as u32, Relaxed);
            self.data[1].store((data >> 32) as u32, Relaxed);
            self.key.store(frame.key() | Self::FULL, Relaxed);
        }
    }

    /// The driver of the CAN controller. It receives every frame, and holds one frame to send.
    struct Controller;

    impl Controller {
        fn set_bit_rate(&mut self, bit_rate: BitRate) {
            REGISTERS.to_send.key.store(0, Relaxed);
            REGISTERS.bit_rate.store(bit_rate.bits_per_second(), Relaxed);
        }
    }

    impl embedded_can::nb::Can for Controller {
        type Frame = Frame;
        type Error = Infallible;

        fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
            if REGISTERS.to_send.is_full() {
                return Err(nb::Error::WouldBlock);
            }
            REGISTERS.to_send.put(frame);
            Ok(None)
        }

        fn receive(&mut self) -> nb::Result<Frame, Infallible> {
            REGISTERS.received.take().ok_or(nb::Error::WouldBlock)
        }
    }

    impl protocol_core::controller::Controller for Controller {
        fn holds(&self, which: Filter) -> bool {
            let held = REGISTERS.to_send.key.load(Relaxed);
            REGISTERS.to_send.is_full() && (held ^ which.key) & which.mask & !Mailbox::FULL == 0
        }

        fn abort(&mut self, which: Filter) {
            if self.holds(which) {
                REGISTERS.to_send.key.store(0, Relaxed);
            }
        }

        fn set_filters(&mut self, _: &Filters) {}
    }

    /// The memory of a board without memory. It accepts every record and stores no record, so that each start is the
    /// start of a new device.
    struct NoMemory;

    impl Memory for NoMemory {
        fn sealed(&self, _: RecordKey) -> Result<Option<&[u8]>, Corrupt> {
            Ok(None)
        }
    }

    impl NoMemory {
        fn store(&mut self, _: RecordKey, _: &Record) -> Result<(), StoreError> {
            Ok(())
        }
    }

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        SCB::sys_reset()
    }

    /// Wakes the loop.
    #[exception]
    fn SysTick() {}

    // `inline(never)`, because this function and `run` take much of the stack.
    #[inline(never)]
    fn make(place: &mut MaybeUninit<PveCanopen>) -> &mut PveCanopen {
        place.write(PveCanopen::new(Setup::new(Kind::PveaCanopen)))
    }

    #[entry]
    fn main() -> ! {
        // `entry` makes the static a reference of this function.
        static mut VALVE: MaybeUninit<PveCanopen> = MaybeUninit::uninit();
        run(make(VALVE))
    }

    #[inline(never)]
    fn run(valve: &mut PveCanopen) -> ! {
        let (mut can, mut memory, mut now) = (Controller, NoMemory, Instant::from_ticks(0));
        valve.start_up(&memory, StartCause::PowerOn, now);
        can.set_bit_rate(valve.bit_rate());
        valve.sense(&Inputs::default(), now);
        if let Some(peripherals) = cortex_m::Peripherals::take() {
            let mut timer = peripherals.SYST;
            timer.set_clock_source(SystClkSource::Core);
            timer.set_reload(TICK_CYCLES - 1);
            timer.clear_current();
            timer.enable_counter();
            timer.enable_interrupt();
        }
        loop {
            while let Some(effect) = pump(valve, &mut can, now) {
                match effect {
                    Effect::Store(key, record) => valve.stored(key, memory.store(key, &record), now),
                    Effect::SetBitRate(bit_rate) => can.set_bit_rate(bit_rate),
                    Effect::Restart(scope) => {
                        valve.restart(scope, &memory, now);
                        can.set_bit_rate(valve.bit_rate());
                    }
                }
            }
            cortex_m::asm::wfi();
            now = after(now, TICK);
        }
    }
}
