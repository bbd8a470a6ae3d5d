//! The pump: moves frames between a controller and a device. The board and the simulator both run this one.

use crate::controller::Controller;
use crate::device::{Device, Effect};
use crate::time::Instant;

/// Hands the device the received frames. Returns whether any was for the device; otherwise there is no need to [pump].
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

/// Hands the device the received frames and the time, and the controller the frames of the device.
///
/// Returns an effect that the platform must carry out; call again until there is none. Call it when a frame was
/// received or sent, when [`Device::deadline`] has come, and after every effect.
///
/// A frame that the controller cannot take goes back to the device and is offered again, after anything more urgent.
pub fn pump<D, C>(device: &mut D, can: &mut C, now: Instant) -> Option<Effect>
where
    D: Device + ?Sized,
    C: Controller,
{
    receive(device, can, now);
    device.poll(now);
    // Before the answer to the request that changed them: its client can rely on them.
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
