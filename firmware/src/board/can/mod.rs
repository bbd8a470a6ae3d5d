//! The CAN controller, bxCAN 1 (RM0090 chapter 32).
//!
//! Written on the registers: of the driver crates one panics at a DLC above 8 and both send from one mailbox.
//!
//! ```text
//! mod        joining and leaving the bus, error modes, filters
//! receive    by interrupt into a queue
//! mailboxes  transmission in the order of arbitration
//! ```

mod mailboxes;
mod receive;

use core::convert::Infallible;

use embassy_stm32::gpio::{AfType, Flex, OutputType, Pull, Speed};
use embassy_stm32::interrupt::Priority;
use embassy_stm32::pac::can::regs;
use embassy_stm32::pac::{CAN1, Interrupt, RCC};
use embassy_stm32::peripherals::{PD0, PD1};
use embassy_stm32::{Peri, interrupt};
use embassy_time::Duration;
use firmware::bit_timing::BitTiming;
use firmware::filter_bank::{BANKS, Bank};
use heapless::spsc::Consumer;
use protocol_core::controller::{BitRate, BusErrorMode, Controller, Filter, Filters};
use protocol_core::frame::Frame;

use super::attention::{Attention, Caller, call};
use mailboxes::Mailboxes;

/// The alternate function that connects the pins with CAN 1.
const AF_CAN: u8 = 9;

/// How often it is looked whether the controller has left the bus: it waits for the end of a frame.
const LEAVING: Duration = Duration::from_micros(50);

/// No frame takes longer: 160 bits at 10 kbit/s, with the error frame that may end it.
const LONGEST_FRAME: Duration = Duration::from_millis(20);

#[interrupt]
fn CAN1_SCE() {
    CAN1.msr().write(|msr| msr.set_erri(true));
    call(Caller::Errors);
}

/// CAN 1.
pub(super) struct Can1 {
    received: Consumer<'static, Frame>,
    mailboxes: Mailboxes,
}

impl Can1 {
    /// Connects the pins; the controller takes no part in the bus before [`join`](Self::join). Its interrupts have this
    /// priority.
    pub(super) fn new(rx: Peri<'static, PD0>, tx: Peri<'static, PD1>, priority: Priority) -> Self {
        let (mut rx, mut tx) = (Flex::new(rx), Flex::new(tx));
        rx.set_as_af_unchecked(AF_CAN, AfType::input(Pull::Up));
        tx.set_as_af_unchecked(AF_CAN, AfType::output(OutputType::PushPull, Speed::VeryHigh));
        // Dropped, they would be pins again.
        core::mem::forget((rx, tx));
        RCC.apb1enr().modify(|enable| enable.set_can1en(true));
        // All banks hold one filter of 32 bits with a mask, for FIFO 0: what comes in keeps its order.
        CAN1.fmr().modify(|fmr| fmr.set_finit(true));
        CAN1.fs1r().write_value(regs::Fs1r((1 << BANKS) - 1));
        CAN1.fmr().modify(|fmr| fmr.set_finit(false));
        CAN1.ier().write(|ier| {
            ier.set_fmpie(0, true);
            ier.set_fmpie(1, true);
            ier.set_tmeie(true);
            ier.set_epvie(true);
            ier.set_bofie(true);
            ier.set_errie(true);
        });
        let received = receive::queue();
        for line in [Interrupt::CAN1_RX0, Interrupt::CAN1_RX1, Interrupt::CAN1_TX, Interrupt::CAN1_SCE] {
            use embassy_stm32::interrupt::InterruptExt as _;
            line.set_priority(priority);
            // SAFETY: what the handlers use is there, and shared by queues and atomics only.
            unsafe { line.enable() };
        }
        Self { received, mailboxes: Mailboxes::new() }
    }

    /// Takes part in the bus at a bit rate, from the next 11 recessive bits on. Recovers from bus-off by itself.
    pub(super) async fn join(&mut self, bit_rate: BitRate, attention: &mut Attention) {
        self.leave(attention).await;
        CAN1.btr().write_value(regs::Btr(BitTiming::of(bit_rate).register()));
        CAN1.mcr().modify(|mcr| mcr.set_inrq(false));
    }

    /// Takes no part in the bus, from the end of the frame on it on. What waits to be sent is dropped.
    pub(super) async fn leave(&mut self, attention: &mut Attention) {
        self.drop_waiting();
        if !initialised(attention).await {
            // On a bus that is stuck no frame ever ends.
            CAN1.mcr().write(|mcr| mcr.set_reset(true));
            initialised(attention).await;
        }
    }

    /// Drops what waits to be sent: after bus-off it would be out of date.
    pub(super) fn drop_waiting(&mut self) {
        self.mailboxes.clear();
    }

    /// To be called after each [pump](protocol_core::pump::pump).
    pub(super) fn resume(&mut self) {
        self.mailboxes.resume();
    }

    /// How the controller stands to the bus.
    pub(super) fn mode(&self) -> BusErrorMode {
        let errors = CAN1.esr().read();
        if errors.boff() {
            BusErrorMode::BusOff
        } else if errors.epvf() {
            BusErrorMode::ErrorPassive
        } else {
            BusErrorMode::ErrorActive
        }
    }

    /// How many frames were lost because the device's task did not keep up.
    pub(super) fn overruns(&self) -> u32 {
        receive::overruns()
    }
}

/// Asks for initialisation mode, and waits for it for as long as a frame can take. Whether it has come.
async fn initialised(attention: &mut Attention) -> bool {
    CAN1.mcr().modify(|mcr| {
        mcr.set_sleep(false);
        mcr.set_inrq(true);
        mcr.set_abom(true);
    });
    for _ in 0..LONGEST_FRAME.as_micros() / LEAVING.as_micros() {
        if CAN1.msr().read().inak() {
            return true;
        }
        attention.pause(LEAVING).await;
    }
    false
}

impl embedded_can::nb::Can for Can1 {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        self.mailboxes.put(frame).map_err(|_| nb::Error::WouldBlock)
    }

    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        self.received.dequeue().ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for Can1 {
    fn is_idle(&self) -> bool {
        self.mailboxes.are_empty()
    }

    fn abort(&mut self, which: Filter) {
        self.mailboxes.abort(which);
    }

    fn set_filters(&mut self, filters: &Filters) {
        for number in 0..BANKS {
            let bank = CAN1.fb(number);
            let held = CAN1.fa1r().read().fact(number);
            let held = held.then(|| Bank { identifier: bank.fr1().read().0, mask: bank.fr2().read().0 });
            let wanted = filters.get(number).map(Bank::of);
            if wanted == held {
                continue;
            }
            // A bank is changed while it is inactive; the others go on meanwhile.
            CAN1.fa1r().modify(|active| active.set_fact(number, false));
            if let Some(Bank { identifier, mask }) = wanted {
                bank.fr1().write_value(regs::Fr1(identifier));
                bank.fr2().write_value(regs::Fr2(mask));
                CAN1.fa1r().modify(|active| active.set_fact(number, true));
            }
        }
    }
}
