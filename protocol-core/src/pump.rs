//! The pump: moves frames between a controller and a device. The board and the simulator both run this one.

use crate::controller::Controller;
use crate::device::{Device, Effect};
use crate::time::Instant;

/// Hands the device what the controller received. Says whether any of it was for the device; when nothing was, there is
/// no need to [pump].
pub fn receive<D, C>(device: &mut D, can: &mut C, now: Instant) -> bool
where
    D: Device + ?Sized,
    C: Controller,
{
    let mut any = false;
    // An overrun is the controller's to count; what came after it can still be read.
    while let Ok(frame) = can.receive() {
        any |= device.handle(&frame, now);
    }
    any
}

/// Hands the device what the controller received and the time, and the controller what the device has to send.
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
    // Before the answer to the request that changed them goes out: whoever waits for it can rely on them.
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
