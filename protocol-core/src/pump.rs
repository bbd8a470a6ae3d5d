//! The pump, which moves frames between a controller and a device. Board and simulator share it.

use crate::controller::{Controller, Filter};
use crate::device::{Device, Effect};
use crate::time::Instant;

/// Passes the received frames to the device. Returns whether the device took any of them; otherwise [pump] need not be
/// called.
pub fn receive<D, C>(device: &mut D, can: &mut C, now: Instant) -> bool
where
    D: Device + ?Sized,
    C: Controller,
{
    let mut any = false;
    // An error ends the loop, too. The next call reads the frames that are left.
    while let Ok(frame) = can.receive() {
        any |= device.handle(&frame, now);
    }
    any
}

/// Tells the device which of its frames the controller has sent.
///
/// The [pump] ends with the same. A platform calls this function if a frame may have been sent since, before it passes
/// inputs to the device, because what the device does with them depends on the frames that are still unsent. If the
/// controller has gone bus-off, the call precedes the drop of its frames.
pub fn note_sent<D, C>(device: &mut D, can: &C, now: Instant)
where
    D: Device + ?Sized,
    C: Controller,
{
    if can.holds(Filter::ALL) {
        device.sent_except(&|which| can.holds(which), now);
    } else {
        device.all_sent(now);
    }
}

/// Passes the received frames and the time to the device, and the device's frames to the controller.
///
/// Returns an effect that the platform must carry out. The platform calls the pump when a frame was received or sent,
/// and at [`Device::deadline`]. After every effect it calls the pump again, until the pump returns `None`.
///
/// A frame that the controller does not accept returns to the device, which offers it again.
pub fn pump<D, C>(device: &mut D, can: &mut C, now: Instant) -> Option<Effect>
where
    D: Device + ?Sized,
    C: Controller,
{
    receive(device, can, now);
    device.poll(now);
    // The filters are set before answers are sent, so that a client that has received its answer can rely on the
    // filters.
    if let Some(filters) = device.take_filters() {
        can.set_filters(&filters);
    }
    let mut hands_out = false;
    loop {
        while let Some(which) = device.take_abort() {
            can.abort(which);
        }
        while let Some(frame) = device.next_frame(now) {
            match can.transmit(&frame) {
                Ok(None) => hands_out = true,
                Ok(Some(overtaken)) => device.give_back(overtaken),
                Err(_) => {
                    device.give_back(frame);
                    hands_out = false;
                    break;
                }
            }
        }
        if can.holds(Filter::ALL) {
            // A new frame needs no look at the others: the pump is called again when a frame was sent.
            if !hands_out {
                device.sent_except(&|which| can.holds(which), now);
            }
            return device.next_effect(false);
        }
        if !device.all_sent(now) {
            return device.next_effect(true);
        }
    }
}
