//! The CAN controller, bxCAN 1 (RM0090 chapter 32), with the driver crate `bxcan`.
//!
//! The registers are accessed directly only for functions that `bxcan` 0.8 lacks: error modes and their interrupts,
//! changes of filters during operation, initialisation without busy-waiting, and the cases that the child modules name.
//!
//! ```text
//! mod       joining and leaving the bus, error modes, filters
//! receive   reception by interrupt into a queue
//! transmit  transmission in the order of arbitration
//! frames    conversion between frames of the core and of `bxcan`
//! ```

mod frames;
mod receive;
mod transmit;

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use bxcan::filter::Mask32;
use bxcan::{Fifo, FilterOwner, Instance, Interrupts, RegisterBlock};
use embassy_stm32::gpio::{AfType, Flex, OutputType, Pin, Pull, Speed};
use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::pac::can::regs;
use embassy_stm32::pac::{CAN1, Interrupt};
use embassy_stm32::{Peri, interrupt, peripherals, rcc};
use firmware::bit_timing::BitTiming;
use firmware::filter_bank::{BANKS, Bank, next_change};
use heapless::spsc::Consumer;
use protocol_core::controller::{BitRate, BusErrorMode, Controller, Filter, Filters};
use protocol_core::frame::Frame;

use super::wake_up::{Event, notify};
pub(super) use receive::OVERRUNS;
pub(super) use transmit::retry;

/// The alternate function of the pins for CAN 1.
const AF_CAN: u8 = 9;

/// The number of error interrupts since the start.
pub(super) static ERROR_INTERRUPTS: AtomicU32 = AtomicU32::new(0);

/// The registers of CAN 1, for `bxcan`.
struct Registers;

// SAFETY: the pointer is that of CAN 1, whose clock is on before a `Registers` exists. `bxcan` claims all registers; in
// addition this module and its children access
// - MCR, while `bxcan` is not called: only the task that configures the controller accesses it;
// - MSR, ESR and TSR, by reading, or by a single write of ones to flags;
// - IER, in the error interrupt or with interrupts off, after `bxcan` has written it for the last time;
// - RF0R, RF1R, the FIFO outputs and the mailbox identifiers, by reading;
// - single filter banks, after `bxcan` has configured them for the last time.
// Each half of `bxcan` has one user: the receive interrupts, the transmit interrupt together with the device's task
// under a critical section, and `Can1` for the configuration.
unsafe impl Instance for Registers {
    const REGISTERS: *mut RegisterBlock = CAN1.as_ptr().cast();
}

// SAFETY: CAN 1 owns all banks except those assigned to CAN 2, which is not used.
unsafe impl FilterOwner for Registers {
    const NUM_FILTER_BANKS: u8 = BANKS as u8;
}

#[interrupt]
fn CAN1_SCE() {
    ERROR_INTERRUPTS.fetch_add(1, Ordering::Relaxed);
    interrupt_unless_reached();
    CAN1.msr().write(|msr| msr.set_erri(true));
    notify(Event::Errors);
}

/// Enables the interrupts for error modes that are not reached, and disables the interrupts for reached modes. An
/// interrupt for a reached mode would occur again at every error. The device task polls for recovery.
fn interrupt_unless_reached() {
    let reached = CAN1.esr().read();
    CAN1.ier().modify(|ier| {
        ier.set_epvie(!reached.epvf());
        ier.set_bofie(!reached.boff());
    });
}

/// The controller CAN 1.
pub(super) struct Can1 {
    config: bxcan::Can<Registers>,
    received: Consumer<'static, Frame>,
}

impl Can1 {
    /// Connects two pins to CAN 1 and sets the priority of its interrupts. The controller does not join the bus before
    /// [`join`](Self::join).
    pub(super) fn new(rx: Peri<'static, impl Pin>, tx: Peri<'static, impl Pin>, priority: Priority) -> Self {
        let (mut rx, mut tx) = (Flex::new(rx), Flex::new(tx));
        rx.set_as_af_unchecked(AF_CAN, AfType::input(Pull::Up));
        // Edges of 10 ns (DS9405, DS10693) are 1 % of the shortest bit, and cause less noise than faster edges.
        tx.set_as_af_unchecked(AF_CAN, AfType::output(OutputType::PushPull, Speed::Medium));
        // Dropping the pins would disconnect them.
        core::mem::forget((rx, tx));
        rcc::enable_and_reset::<peripherals::CAN1>();
        let mut config = bxcan::Can::builder(Registers).leave_disabled();
        let mut filters = config.modify_filters();
        for bank in 0..Registers::NUM_FILTER_BANKS {
            // A bank is a 32-bit filter with a mask, for FIFO 0 only, so that received frames keep their order.
            filters.enable_bank(bank, Fifo::Fifo0, Mask32::accept_all()).disable_bank(bank);
        }
        drop(filters);
        config.enable_interrupts(
            Interrupts::TRANSMIT_MAILBOX_EMPTY
                | Interrupts::FIFO0_MESSAGE_PENDING
                | Interrupts::FIFO1_MESSAGE_PENDING
                | Interrupts::ERROR,
        );
        interrupt_unless_reached();
        // A split `Can` cannot be configured, so there are two.
        let (tx, rx0, rx1) = bxcan::Can::builder(Registers).leave_disabled().split();
        transmit::start(tx);
        let received = receive::start(rx0, rx1);
        for line in [Interrupt::CAN1_RX0, Interrupt::CAN1_RX1, Interrupt::CAN1_TX, Interrupt::CAN1_SCE] {
            line.set_priority(priority);
            // SAFETY: the halves used by the handlers are installed.
            unsafe { line.enable() };
        }
        Self { config, received }
    }

    /// Drops the pending transmit frames and requests the initialisation mode. The controller enters it after the
    /// current frame.
    pub(super) fn leave(&mut self) {
        self.abort(Filter::ALL);
        // `bxcan` would busy-wait for the end of the frame.
        CAN1.mcr().modify(|mcr| {
            mcr.set_sleep(false);
            mcr.set_inrq(true);
        });
    }

    /// Returns whether the controller has left the bus.
    pub(super) fn has_left(&self) -> bool {
        CAN1.msr().read().inak()
    }

    /// Resets the controller, for a bus on which no frame ends. The controller then leaves the bus.
    pub(super) fn reset(&mut self) {
        CAN1.mcr().write(|mcr| mcr.set_reset(true));
        self.leave();
    }

    /// Joins the bus at a bit rate, after 11 recessive bits. Recovery from bus-off is automatic. The controller must
    /// [have left](Self::has_left) the bus before.
    pub(super) fn join(&mut self, bit_rate: BitRate) {
        self.config.modify_config().set_bit_timing(BitTiming::of(bit_rate).register()).leave_disabled();
        // The controller joins in the background.
        let _ = self.config.enable_non_blocking();
    }

    /// Returns the error mode, and enables the interrupts for worse modes.
    pub(super) fn mode(&mut self) -> BusErrorMode {
        critical_section::with(|_| interrupt_unless_reached());
        // The read follows the enabling of the interrupts, so that no mode is missed in between.
        match CAN1.esr().read() {
            errors if errors.boff() => BusErrorMode::BusOff,
            errors if errors.epvf() => BusErrorMode::ErrorPassive,
            _ => BusErrorMode::ErrorActive,
        }
    }
}

impl embedded_can::nb::Can for Can1 {
    type Frame = Frame;
    type Error = Infallible;

    fn transmit(&mut self, frame: &Frame) -> nb::Result<Option<Frame>, Infallible> {
        transmit::with(|transmission| transmission.put(frame)).unwrap_or(Err(nb::Error::WouldBlock))
    }

    fn receive(&mut self) -> nb::Result<Frame, Infallible> {
        self.received.dequeue().ok_or(nb::Error::WouldBlock)
    }
}

impl Controller for Can1 {
    fn holds(&self, which: Filter) -> bool {
        transmit::with(|transmission| transmission.holds(which)).unwrap_or(false)
    }

    fn abort(&mut self, which: Filter) {
        transmit::with(|transmission| transmission.abort(which));
    }

    /// Changes the banks one by one, without `bxcan`, which would stop the reception during the change.
    fn set_filters(&mut self, filters: &Filters) {
        while let Some((number, wanted)) = next_change(&core::array::from_fn(bank), filters) {
            CAN1.fa1r().modify(|active| active.set_fact(number, false));
            if let Some(Bank { identifier, mask }) = wanted {
                CAN1.fb(number).fr1().write_value(regs::Fr1(identifier));
                CAN1.fb(number).fr2().write_value(regs::Fr2(mask));
                CAN1.fa1r().modify(|active| active.set_fact(number, true));
            }
        }
    }
}

/// Returns the contents of a filter bank; `None` for an inactive bank.
fn bank(number: usize) -> Option<Bank> {
    let registers = CAN1.fb(number);
    let is_active = CAN1.fa1r().read().fact(number);
    is_active.then(|| Bank { identifier: registers.fr1().read().0, mask: registers.fr2().read().0 })
}
