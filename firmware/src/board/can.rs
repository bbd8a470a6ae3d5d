//! The CAN controller, bxCAN 1: reception by interrupt into a queue, transmission from one mailbox (RM0090 chapter 32).

use core::cell::RefCell;
use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use critical_section::Mutex;
use embassy_stm32::gpio::{AfType, Flex, OutputType, Pull, Speed};
use embassy_stm32::pac::can::regs;
use embassy_stm32::pac::{CAN1, Interrupt, RCC};
use embassy_stm32::peripherals::{PD0, PD1};
use embassy_stm32::{Peri, interrupt};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use firmware::bit_timing::BitTiming;
use firmware::filter_bank::{BANKS, Bank};
use heapless::Deque;
use protocol_core::controller::{BitRate, BusErrorMode, Controller, Filters};
use protocol_core::frame::{Frame, Id, extended, standard};

/// How many frames wait for the device's task: those of 25 ms at 1 Mbit/s.
const QUEUE: usize = 256;

/// The alternate function that connects the pins with CAN 1.
const AF_CAN: u8 = 9;

static RECEIVED: Mutex<RefCell<Deque<Frame, QUEUE>>> = Mutex::new(RefCell::new(Deque::new()));
static OVERRUNS: AtomicU32 = AtomicU32::new(0);

/// Raised when a frame was received, or sent.
pub(super) static ATTENTION: Signal<CriticalSectionRawMutex, ()> = Signal::new();

#[interrupt]
fn CAN1_RX0() {
    receive(0);
}

#[interrupt]
fn CAN1_RX1() {
    receive(1);
}

#[interrupt]
fn CAN1_TX() {
    CAN1.tsr().write(|tsr| (0..3).for_each(|mailbox| tsr.set_rqcp(mailbox, true)));
    ATTENTION.signal(());
}

/// Empties a FIFO. A DLC of 9–15, which CAN allows, means eight bytes.
fn receive(fifo: usize) {
    while CAN1.rfr(fifo).read().fmp() != 0 {
        let mailbox = CAN1.rx(fifo);
        let identifier = mailbox.rir().read().0;
        let len = (mailbox.rdtr().read().0 & 0xF).min(8) as u8;
        let [a, b, c, d] = mailbox.rdlr().read().0.to_le_bytes();
        let [e, f, g, h] = mailbox.rdhr().read().0.to_le_bytes();
        CAN1.rfr(fifo).write(|rfr| rfr.set_rfom(true));
        let id: Id = if identifier & 1 << 2 == 0 {
            standard((identifier >> 21) as u16).into()
        } else {
            extended(identifier >> 3).into()
        };
        let frame = if identifier & 1 << 1 == 0 {
            Frame::with_len(id, [a, b, c, d, e, f, g, h], len)
        } else {
            Frame::remote(id, len)
        };
        let taken = critical_section::with(|cs| RECEIVED.borrow_ref_mut(cs).push_back(frame).is_ok());
        if !taken {
            OVERRUNS.fetch_add(1, Ordering::Relaxed);
        }
    }
    ATTENTION.signal(());
}

/// CAN 1.
pub(super) struct Can1;

impl Can1 {
    /// Connects the pins; the controller takes no part in the bus before [`start`](Self::start).
    pub(super) fn new(rx: Peri<'static, PD0>, tx: Peri<'static, PD1>) -> Self {
        let (mut rx, mut tx) = (Flex::new(rx), Flex::new(tx));
        rx.set_as_af_unchecked(AF_CAN, AfType::input(Pull::Up));
        tx.set_as_af_unchecked(AF_CAN, AfType::output(OutputType::PushPull, Speed::VeryHigh));
        // Dropped, they would be pins again.
        core::mem::forget((rx, tx));
        RCC.apb1enr().modify(|enable| enable.set_can1en(true));
        for line in [Interrupt::CAN1_RX0, Interrupt::CAN1_RX1, Interrupt::CAN1_TX] {
            // SAFETY: the handlers above share nothing with what runs now but through critical sections.
            unsafe { cortex_m::peripheral::NVIC::unmask(line) };
        }
        Self
    }

    /// Begins, or begins anew, at a bit rate: what waits in the mailboxes is dropped. Recovers from bus-off by itself.
    pub(super) fn start(&mut self, bit_rate: BitRate) {
        CAN1.mcr().write(|mcr| mcr.set_reset(true));
        CAN1.mcr().modify(|mcr| {
            mcr.set_sleep(false);
            mcr.set_inrq(true);
            mcr.set_abom(true);
        });
        while !CAN1.msr().read().inak() {}
        CAN1.btr().write_value(regs::Btr(BitTiming::of(bit_rate).register()));
        // All banks hold one filter of 32 bits with a mask, for FIFO 0: what comes in keeps its order.
        CAN1.fmr().modify(|fmr| fmr.set_finit(true));
        CAN1.fs1r().write_value(regs::Fs1r((1 << BANKS) - 1));
        CAN1.fmr().modify(|fmr| fmr.set_finit(false));
        CAN1.ier().write(|ier| {
            ier.set_fmpie(0, true);
            ier.set_fmpie(1, true);
            ier.set_tmeie(true);
        });
        CAN1.mcr().modify(|mcr| mcr.set_inrq(false));
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

    /// Takes back what waits to be sent: after bus-off it would be out of date.
    pub(super) fn abort(&mut self) {
        CAN1.tsr().write(|tsr| tsr.set_abrq(0, true));
    }

    /// How many frames were lost because the device's task did not keep up.
    pub(super) fn overruns(&self) -> u32 {
        OVERRUNS.load(Ordering::Relaxed)
    }
}

impl embedded_can::nb::Can for Can1 {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        if !self.is_idle() {
            return Err(nb::Error::WouldBlock);
        }
        let identifier = match frame.id() {
            Id::Standard(id) => u32::from(id.as_raw()) << 21,
            Id::Extended(id) => id.as_raw() << 3 | 1 << 2,
        };
        let [a, b, c, d, e, f, g, h] = *frame.bytes();
        let mailbox = CAN1.tx(0);
        mailbox.tdtr().write_value(regs::Tdtr(frame.len().into()));
        mailbox.tdlr().write_value(regs::Tdlr(u32::from_le_bytes([a, b, c, d])));
        mailbox.tdhr().write_value(regs::Tdhr(u32::from_le_bytes([e, f, g, h])));
        mailbox.tir().write_value(regs::Tir(identifier | u32::from(frame.is_remote()) << 1 | 1));
        Ok(None)
    }

    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        critical_section::with(|cs| RECEIVED.borrow_ref_mut(cs).pop_front()).ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for Can1 {
    fn is_idle(&self) -> bool {
        CAN1.tsr().read().tme(0)
    }

    fn set_filters(&mut self, filters: &Filters) {
        for number in 0..BANKS {
            let bank = filters.get(number).map(Bank::of);
            // A bank is changed while it is inactive; the others go on meanwhile.
            CAN1.fa1r().modify(|active| active.set_fact(number, false));
            if let Some(Bank { identifier, mask }) = bank {
                CAN1.fb(number).fr1().write_value(regs::Fr1(identifier));
                CAN1.fb(number).fr2().write_value(regs::Fr2(mask));
                CAN1.fa1r().modify(|active| active.set_fact(number, true));
            }
        }
    }
}
