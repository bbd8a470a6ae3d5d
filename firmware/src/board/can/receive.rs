//! Reception: by interrupt into a queue (RM0090 32.7.3).

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

/// The number of frames that can wait for the device's task: 12 ms of a full bus at 1 Mbit/s.
const QUEUE: usize = 256;

/// The number of frames lost in the controller or in the queue, which nobody took in time. An overrun of the controller
/// counts as one frame.
pub(in crate::board) static OVERRUNS: AtomicU32 = AtomicU32::new(0);

/// The state of the receive interrupts.
struct Reception {
    rx0: Rx0<Registers>,
    rx1: Rx1<Registers>,
    received: Producer<'static, Frame>,
}

static mut RECEPTION: MaybeUninit<Reception> = MaybeUninit::uninit();

/// Gives the receive interrupts their half of the controller; returns the end of the queue that they fill. To be called
/// once, before the interrupts are enabled.
pub(super) fn start(rx0: Rx0<Registers>, rx1: Rx1<Registers>) -> Consumer<'static, Frame> {
    // A queue has room for one frame less than its length.
    static STORAGE: ConstStaticCell<Queue<Frame, { QUEUE + 1 }>> = ConstStaticCell::new(Queue::new());
    let (received, waiting) = STORAGE.take().split();
    // SAFETY: no interrupt looks at it yet, and the storage is handed out once.
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

/// Moves what a FIFO holds into the queue. For the receive interrupts alone.
fn empty(fifo: usize, receive: impl Fn(&mut Reception) -> nb::Result<bxcan::Frame, OverrunError>) {
    // SAFETY: written before the interrupts were enabled; they have one priority, so neither interrupts the other.
    let reception = unsafe { (*addr_of_mut!(RECEPTION)).assume_init_mut() };
    let mut lost = 0;
    while CAN1.rfr(fifo).read().fmp() != 0 {
        let payload = Payload::peek(fifo);
        match receive(reception) {
            Ok(frame) => lost += u32::from(reception.received.enqueue(payload.of(&frame)).is_err()),
            Err(nb::Error::Other(_)) => lost += 1,
            Err(nb::Error::WouldBlock) => {}
        }
        // `bxcan` does not wait for the release: until then the output holds the frame that was taken.
        while CAN1.rfr(fifo).read().rfom() {}
    }
    if lost != 0 {
        OVERRUNS.fetch_add(lost, Ordering::Relaxed);
    }
    notify(Event::Received);
}
