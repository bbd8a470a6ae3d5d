//! Reception: by interrupt into a queue (RM0090 32.7.3).

use core::mem::MaybeUninit;
use core::ptr::addr_of_mut;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_stm32::interrupt;
use embassy_stm32::pac::CAN1;
use heapless::spsc::{Consumer, Producer, Queue};
use protocol_core::frame::{Frame, Id, extended, standard};
use static_cell::ConstStaticCell;

use super::super::attention::{Caller, call};

/// How many frames wait for the device's task: those of 12 ms at 1 Mbit/s, were they all for the device.
const QUEUE: usize = 256;

static OVERRUNS: AtomicU32 = AtomicU32::new(0);

/// The end of the queue that the interrupts fill.
static mut RECEIVED: MaybeUninit<Producer<'static, Frame>> = MaybeUninit::uninit();

/// The end of the queue that the device's task empties. To be called before the interrupts are enabled.
pub(super) fn queue() -> Consumer<'static, Frame> {
    // A queue has room for one frame less than its length.
    static STORAGE: ConstStaticCell<Queue<Frame, { QUEUE + 1 }>> = ConstStaticCell::new(Queue::new());
    let (received, waiting) = STORAGE.take().split();
    // SAFETY: no interrupt looks at it yet, and the storage is handed out once.
    unsafe { addr_of_mut!(RECEIVED).write(MaybeUninit::new(received)) };
    waiting
}

#[interrupt]
fn CAN1_RX0() {
    empty(0);
}

#[interrupt]
fn CAN1_RX1() {
    empty(1);
}

/// How many frames were lost, in the controller or here, because nobody took them.
pub(super) fn overruns() -> u32 {
    OVERRUNS.load(Ordering::Relaxed)
}

/// Empties a FIFO.
fn empty(fifo: usize) {
    // SAFETY: written before the interrupts were enabled; these have one priority, so none comes in between.
    let received = unsafe { (*addr_of_mut!(RECEIVED)).assume_init_mut() };
    let register = CAN1.rfr(fifo);
    let mut lost = 0;
    let mut status = register.read();
    while status.fmp() != 0 {
        let frame = output(fifo);
        register.write(|rfr| rfr.set_rfom(true));
        lost += u32::from(received.enqueue(frame).is_err());
        status = register.read();
        while status.rfom() {
            status = register.read();
        }
    }
    if status.fovr() {
        register.write(|rfr| rfr.set_fovr(true));
        lost += 1;
    }
    if lost != 0 {
        OVERRUNS.fetch_add(lost, Ordering::Relaxed);
    }
    call(Caller::Received);
}

/// The frame at the output of a FIFO. A DLC of 9–15, which CAN allows, means eight bytes: [`Frame`] sees to that.
fn output(fifo: usize) -> Frame {
    let mailbox = CAN1.rx(fifo);
    let identifier = mailbox.rir().read().0;
    let len = (mailbox.rdtr().read().0 & 0xF) as u8;
    let [a, b, c, d] = mailbox.rdlr().read().0.to_le_bytes();
    let [e, f, g, h] = mailbox.rdhr().read().0.to_le_bytes();
    let id: Id = if identifier & 1 << 2 == 0 {
        standard((identifier >> 21) as u16).into()
    } else {
        extended(identifier >> 3).into()
    };
    if identifier & 1 << 1 == 0 { Frame::with_len(id, [a, b, c, d, e, f, g, h], len) } else { Frame::remote(id, len) }
}
