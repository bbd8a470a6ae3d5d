//! The reception of frames by interrupt, into a queue (RM0090 32.7.3).

use core::mem::MaybeUninit;
use core::ptr::addr_of_mut;
use core::sync::atomic::{AtomicU32, Ordering};

use bxcan::{OverrunError, Rx0, Rx1};
use embassy_stm32::interrupt;
use embassy_stm32::pac::CAN1;
use heapless::spsc::{Consumer, Producer, Queue};
use protocol_core::frame::Frame;
use static_cell::ConstStaticCell;

use super::Registers;
use super::frames::Payload;
use crate::board::wake_up::{Event, notify};

/// The capacity of the queue: the frames of 12 ms on a full bus at 1 Mbit/s.
const QUEUE: usize = 256;

/// The number of received frames lost to an overrun of the controller or to a full queue. An overrun counts as one
/// frame.
pub(in crate::board) static OVERRUNS: AtomicU32 = AtomicU32::new(0);

/// The state of the receive interrupts.
struct Reception {
    rx0: Rx0<Registers>,
    rx1: Rx1<Registers>,
    received: Producer<'static, Frame>,
}

static mut RECEPTION: MaybeUninit<Reception> = MaybeUninit::uninit();

/// Hands the receive halves of the controller to the interrupts. Returns the consumer of their queue. This function is
/// called once, before the interrupts are enabled.
pub(super) fn start(rx0: Rx0<Registers>, rx1: Rx1<Registers>) -> Consumer<'static, Frame> {
    // A queue holds one frame less than its length.
    static STORAGE: ConstStaticCell<Queue<Frame, { QUEUE + 1 }>> = ConstStaticCell::new(Queue::new());
    let (received, waiting) = STORAGE.take().split();
    // SAFETY: no interrupt accesses the static yet, and the storage is handed out once.
    unsafe { addr_of_mut!(RECEPTION).write(MaybeUninit::new(Reception { rx0, rx1, received })) };
    waiting
}

#[interrupt]
fn CAN1_RX0() {
    empty(0, |reception| reception.rx0.receive());
}

#[interrupt]
fn CAN1_RX1() {
    empty(1, |reception| reception.rx1.receive());
}

/// Moves the frames of a FIFO to the queue. Only the receive interrupts call this function.
fn empty(fifo: usize, receive: impl Fn(&mut Reception) -> nb::Result<bxcan::Frame, OverrunError>) {
    // SAFETY: written before the interrupts were enabled; they have equal priority, so neither preempts the other.
    let reception = unsafe { (*addr_of_mut!(RECEPTION)).assume_init_mut() };
    let mut lost = 0;
    while CAN1.rfr(fifo).read().fmp() != 0 {
        let payload = Payload::peek(fifo);
        match receive(reception) {
            Ok(frame) => lost += u32::from(reception.received.enqueue(payload.of(&frame)).is_err()),
            Err(nb::Error::Other(_)) => lost += 1,
            Err(nb::Error::WouldBlock) => {}
        }
        // `bxcan` does not wait for the release of the FIFO output, which holds the taken frame until then.
        while CAN1.rfr(fifo).read().rfom() {}
    }
    if lost != 0 {
        OVERRUNS.fetch_add(lost, Ordering::Relaxed);
    }
    notify(Event::Received);
}
