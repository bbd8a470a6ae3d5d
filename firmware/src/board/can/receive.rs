//! Reception: by interrupt into a queue (RM0090 32.7.3).

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};

use critical_section::Mutex;
use embassy_stm32::interrupt;
use embassy_stm32::pac::CAN1;
use heapless::Deque;
use protocol_core::frame::{Frame, Id, extended, standard};

use super::super::attention::{Caller, call};

/// How many frames wait for the device's task: those of 12 ms at 1 Mbit/s, were they all for the device.
const QUEUE: usize = 256;

static RECEIVED: Mutex<RefCell<Deque<Frame, QUEUE>>> = Mutex::new(RefCell::new(Deque::new()));
static OVERRUNS: AtomicU32 = AtomicU32::new(0);

#[interrupt]
fn CAN1_RX0() {
    empty(0);
}

#[interrupt]
fn CAN1_RX1() {
    empty(1);
}

/// The oldest frame that waits.
pub(super) fn take() -> Option<Frame> {
    critical_section::with(|cs| RECEIVED.borrow_ref_mut(cs).pop_front())
}

/// How many frames were lost, in the controller or here, because nobody took them.
pub(super) fn overruns() -> u32 {
    OVERRUNS.load(Ordering::Relaxed)
}

/// Empties a FIFO.
fn empty(fifo: usize) {
    loop {
        let status = CAN1.rfr(fifo).read();
        if status.fovr() {
            OVERRUNS.fetch_add(1, Ordering::Relaxed);
            CAN1.rfr(fifo).write(|rfr| rfr.set_fovr(true));
        }
        if status.fmp() == 0 {
            break;
        }
        let frame = output(fifo);
        CAN1.rfr(fifo).write(|rfr| rfr.set_rfom(true));
        if critical_section::with(|cs| RECEIVED.borrow_ref_mut(cs).push_back(frame)).is_err() {
            OVERRUNS.fetch_add(1, Ordering::Relaxed);
        }
        while CAN1.rfr(fifo).read().rfom() {}
    }
    call(Caller::Frames);
}

/// The frame at the output of a FIFO. A DLC of 9–15, which CAN allows, means eight bytes.
fn output(fifo: usize) -> Frame {
    let mailbox = CAN1.rx(fifo);
    let identifier = mailbox.rir().read().0;
    let len = (mailbox.rdtr().read().0 & 0xF).min(8) as u8;
    let [a, b, c, d] = mailbox.rdlr().read().0.to_le_bytes();
    let [e, f, g, h] = mailbox.rdhr().read().0.to_le_bytes();
    let id: Id = if identifier & 1 << 2 == 0 {
        standard((identifier >> 21) as u16).into()
    } else {
        extended(identifier >> 3).into()
    };
    if identifier & 1 << 1 == 0 { Frame::with_len(id, [a, b, c, d, e, f, g, h], len) } else { Frame::remote(id, len) }
}
