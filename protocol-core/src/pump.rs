//! The pump, which moves frames between a controller and a device, on the board and in the simulator.

use crate::controller::Controller;
use crate::device::{Device, Effect};
use crate::time::Instant;

/// Passes the received frames to the device. Returns whether any of them belongs to the device; otherwise [pump] need
/// not be called.
pub fn receive<D, C>(device: &mut D, can: &mut C, now: Instant) -> bool
where
    D: Device + ?Sized,
    C: Controller,
{
    let mut any = false;
    // The controller counts overruns; later frames can still be read.
    while let Ok(frame) = can.receive() {
        any |= device.handle(&frame, now);
    }
    any
}

/// Passes the received frames and the time to the device, and the frames of the device to the controller.
///
/// Returns an effect that the platform must carry out. Must be called when a frame was received or sent, at
/// [`Device::deadline`], and again after every effect until it returns `None`.
///
/// A frame that the controller cannot take returns to the device and is offered again, after any more urgent frame.
pub fn pump<D, C>(device: &mut D, can: &mut C, now: Instant) -> Option<Effect>
where
    D: Device + ?Sized,
    C: Controller,
{
    receive(device, can, now);
    device.poll(now);
    // Set before any answer is sent, so that a client that receives the answer to its change can rely on the new
    // filters.
    if let Some(filters) = device.take_filters() {
        can.set_filters(&filters);
    }
    loop {
        while let Some(which) = device.take_abort() {
            can.abort(which);
        }
        while let Some(frame) = device.next_frame(now) {
            match can.transmit(&frame) {
                Ok(None) => {}
                Ok(Some(overtaken)) => device.give_back(overtaken),
                Err(_) => {
                    device.give_back(frame);
                    return device.next_effect(false);
                }
            }
        }
        if !can.is_idle() {
            return device.next_effect(false);
        }
        if !device.all_sent(now) {
            return device.next_effect(true);
        }
    }
}
