//! The controller against RM0090 chapter 32, by its registers.

mod errors;
mod filters;
mod modes;
mod reception;
mod transmission;

use hal_sim::WireEvent::{Begins, Ends, Joined, Received, Sent};
use protocol_core::frame::{Frame, Id, extended, standard};

use super::registers::*;
use super::{BxCan, Presence};

/// Out of reset and through initialization with these values of MCR and BTR; FIFO 0 takes everything.
fn set_up(control: u32, timing: u32) -> BxCan {
    let mut can = BxCan::default();
    can.write(MCR, control | mcr::INRQ);
    can.write(BTR, timing);
    accept_all(&mut can, 0);
    can.write(MCR, control);
    can
}

/// The same at some bit rate, on the bus.
fn on_bus(control: u32) -> BxCan {
    let mut can = set_up(control, 0x001C_0009);
    can.hear(Joined);
    assert_eq!(can.read(MSR) & (msr::INAK | msr::SLAK), 0, "it is on the bus");
    can
}

/// Bank 0: everything into a FIFO.
fn accept_all(can: &mut BxCan, fifo: u32) {
    can.write(FMR, can.read(FMR) | 1);
    can.write(FS1R, 1);
    can.write(FM1R, 0);
    can.write(FFA1R, fifo);
    can.write(F0R1, 0);
    can.write(F0R1 + 4, 0);
    can.write(FA1R, 1);
    can.write(FMR, can.read(FMR) & !1);
}

/// Frames with these identifiers come.
fn receive_all(can: &mut BxCan, ids: std::ops::RangeInclusive<u16>) {
    ids.for_each(|id| receive(can, std(id, &[])));
}

/// Requests the transmission of a frame from a mailbox.
fn request(can: &mut BxCan, mailbox: u32, frame: &Frame) {
    let at = TI0R + 0x10 * mailbox;
    let id = match frame.id() {
        Id::Standard(id) => u32::from(id.as_raw()) << 21,
        Id::Extended(id) => id.as_raw() << 3 | 1 << 2,
    };
    can.write(at + 4, u32::from(frame.len()));
    can.write(at + 8, u32::from_le_bytes(frame.bytes()[..4].try_into().unwrap()));
    can.write(at + 12, u32::from_le_bytes(frame.bytes()[4..].try_into().unwrap()));
    can.write(at, id | u32::from(frame.is_remote()) << 1 | 1);
}

/// On the bus, with a request in mailbox 0.
fn requested(control: u32) -> BxCan {
    let mut can = on_bus(control);
    request(&mut can, 0, &std(0x100, &[]));
    can
}

fn receive(can: &mut BxCan, frame: Frame) {
    can.hear(Begins { own: false });
    can.hear(Received(frame));
    can.hear(Ends);
}

/// The offered frame goes out.
fn send(can: &mut BxCan) -> Frame {
    let frame = can.offer().expect("something to send").frame;
    can.hear(Begins { own: true });
    can.hear(Sent);
    can.hear(Ends);
    frame
}

/// Releases the output of a FIFO, and waits for that.
fn release(can: &mut BxCan, fifo: u32) {
    can.write(RF0R + 4 * fifo, rfr::RFOM);
    while can.read(RF0R + 4 * fifo) & rfr::RFOM != 0 {
        can.pass_access(RF0R);
    }
}

fn std(id: u16, data: &[u8]) -> Frame {
    Frame::of(standard(id).into(), data).unwrap()
}

fn ext(id: u32, data: &[u8]) -> Frame {
    Frame::of(extended(id).into(), data).unwrap()
}

fn is_off(can: &BxCan) -> bool {
    can.presence() == Presence::Off
}
