//! A CANopen valve on the processor, without operating system and driver. It measures the core alone: flash, RAM,
//! stack, and instructions for a frame. The controller is a mailbox in RAM.
//!
//! `tests/firmware-in-the-loop/run --test firmware core_alone` counts the instructions from the entry of a function
//! `row_of_…` to the entry of `row_is_done`.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {}

#[cfg(target_os = "none")]
mod image {
    use core::convert::Infallible;
    use core::panic::PanicInfo;

    use cortex_m_rt::entry;
    // These functions copy memory.
    use firmware as _;
    use protocol_core::controller::{Controller, Filter, Filters};
    use protocol_core::device::pve::{Kind, PveCanopen, Setup};
    use protocol_core::device::{Device as _, Effect, Inputs, StartCause};
    use protocol_core::frame::{Frame, standard};
    use protocol_core::memory::Image;
    use protocol_core::pump::{pump, receive};
    use protocol_core::time::{Duration, Instant};
    use static_cell::StaticCell;
    // The start-up code needs the interrupt table.
    use stm32_metapac as _;

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        cortex_m::peripheral::SCB::sys_reset()
    }

    /// A controller that holds one received frame and accepts every frame to send.
    #[derive(Default)]
    struct Mailbox {
        received: Option<Frame>,
        taken: Option<Frame>,
    }

    impl embedded_can::nb::Can for Mailbox {
        type Frame = Frame;
        type Error = Infallible;

        fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
            self.taken = Some(*frame);
            Ok(None)
        }

        fn receive(&mut self) -> nb::Result<Frame, Infallible> {
            self.received.take().ok_or(nb::Error::WouldBlock)
        }
    }

    impl Controller for Mailbox {
        fn holds(&self, which: Filter) -> bool {
            self.taken.is_some_and(|frame| which.passes(&frame))
        }

        fn abort(&mut self, _: Filter) {}

        fn set_filters(&mut self, _: &Filters) {}
    }

    /// The valve, and its controller.
    struct Node {
        valve: &'static mut PveCanopen,
        can: Mailbox,
        now: Instant,
    }

    /// Returns a frame of at most eight bytes.
    fn frame(id: u16, data: &[u8]) -> Frame {
        let mut bytes = [0; 8];
        bytes.iter_mut().zip(data).for_each(|(byte, given)| *byte = *given);
        Frame::with_len(standard(id).into(), bytes, data.len() as u8)
    }

    /// Runs the counted row of a frame for the valve: reception, due timers, and the answers into the controller.
    #[inline(never)]
    #[unsafe(no_mangle)]
    fn row_of_pump(node: &mut Node) -> Option<Effect> {
        pump(node.valve, &mut node.can, node.now)
    }

    /// Runs the counted row of a frame for another node.
    #[inline(never)]
    #[unsafe(no_mangle)]
    fn row_of_receive(node: &mut Node) -> Option<Effect> {
        receive(node.valve, &mut node.can, node.now);
        None
    }

    /// Runs the counted row of a poll without a due timer.
    #[inline(never)]
    #[unsafe(no_mangle)]
    fn row_of_poll(node: &mut Node) -> Option<Effect> {
        node.valve.poll(node.now);
        None
    }

    /// Ends the counted row.
    #[inline(never)]
    #[unsafe(no_mangle)]
    fn row_is_done(node: &mut Node) {
        node.can.taken = None;
    }

    impl Node {
        /// Pumps until the valve has nothing more to do, and empties its controller.
        fn settle(&mut self, received: Option<Frame>) {
            self.can.received = received;
            for _ in 0..8 {
                if let Some(Effect::Store(key, _)) = row_of_pump(self) {
                    self.valve.stored(key, Ok(()), self.now);
                }
                self.can.taken = None;
            }
        }

        /// Counts a row, whose frame comes a millisecond after the frame of the previous row.
        fn count(&mut self, row: fn(&mut Self) -> Option<Effect>, received: Option<Frame>) {
            self.now += Duration::from_millis(1);
            self.settle(None);
            self.can.received = received;
            row(self);
            row_is_done(self);
            self.settle(None);
        }
    }

    // `inline(never)`, so that the stack of these functions is free again after their return.

    #[inline(never)]
    fn place() -> &'static mut PveCanopen {
        static VALVE: StaticCell<PveCanopen> = StaticCell::new();
        VALVE.init_with(|| PveCanopen::new(Setup::new(Kind::PveaCanopen)))
    }

    #[inline(never)]
    fn start_up(valve: &mut PveCanopen, now: Instant) {
        valve.start_up(&Image::empty(), StartCause::PowerOn, now);
    }

    #[entry]
    fn main() -> ! {
        let now = Instant::from_secs(1);
        let mut node = Node { valve: place(), can: Mailbox::default(), now };
        start_up(node.valve, now);
        node.valve.sense(&Inputs::default(), now);
        node.settle(None);
        node.now += Duration::from_millis(510);
        // The heartbeat time is one second, the node is operational, and the valve is ACTIVE with a set-point.
        node.settle(Some(frame(0x620, &[0x2B, 0x17, 0x10, 0, 0xE8, 3, 0, 0])));
        node.settle(Some(frame(0, &[1, 0])));
        node.count(row_of_pump, Some(frame(0x620, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0])));
        node.count(row_of_pump, Some(frame(0x620, &[0x2B, 0x40, 0x60, 0, 1, 0, 0, 0])));
        node.count(row_of_receive, Some(frame(0x1A1, &[0x0F, 0, 0, 0])));
        node.count(row_of_poll, None);
        node.count(row_of_pump, None);
        for _ in 0..4 {
            node.now += Duration::from_millis(1);
            node.settle(Some(frame(0x220, &[0x0F, 0, 0, 0x10])));
        }
        node.count(row_of_pump, Some(frame(0x220, &[0x0F, 0, 0, 0x10])));
        node.count(row_of_pump, Some(frame(0x220, &[0x0F, 0, 0, 0x20])));
        loop {
            cortex_m::asm::wfi();
        }
    }
}
