//! Joining and leaving the bus: bit rates, and the bus-off of the plant.

use embassy_time::{Duration, Instant};
use protocol_core::controller::{BitRate, BusErrorMode, Controller as _, Filter};

use super::can::Can1;
use super::wake_up::WakeUp;

/// The period in which a controller that leaves the bus is polled: it waits for the end of a frame.
const LEAVING: Duration = Duration::from_micros(50);

/// The time of the longest frame: 160 bits at 10 kbit/s, with the error frame that may end it.
const LONGEST_FRAME: Duration = Duration::from_millis(20);

/// The number of polls in [`LONGEST_FRAME`].
const POLLS: u64 = LONGEST_FRAME.as_micros() / LEAVING.as_micros();

/// The longest time that [`Link::settle`] takes.
pub(super) const LONGEST_SETTLE: Duration = Duration::from_micros(2 * LONGEST_FRAME.as_micros());

/// The bits that the recovery from bus-off takes (ISO 11898-1): 128 sequences of 11.
const RECOVERY_BITS: u32 = 128 * 11;

/// The controller, and its standing on the bus.
pub(super) struct Link {
    /// The controller.
    pub(super) can: Can1,
    bit_rate: BitRate,
    state: State,
    mode: BusErrorMode,
    /// The number of polls of a controller that was told to leave the bus and is not known to have left it.
    leaving: Option<u64>,
}

/// The part that the plant lets the controller take in the bus.
#[derive(Clone, Copy)]
enum State {
    Up,
    /// The controller is kept off the bus.
    Cut,
    /// The controller recovers until this instant.
    Recovering(Instant),
}

impl Link {
    /// Returns a controller that has not joined the bus yet.
    pub(super) const fn new(can: Can1) -> Self {
        Self { can, bit_rate: BitRate::Kbit250, state: State::Up, mode: BusErrorMode::ErrorActive, leaving: None }
    }

    /// Returns the bit rate in force.
    pub(super) const fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    /// Runs the bus at a bit rate, once this has [settled](Self::settle); what waits to be sent is dropped.
    pub(super) fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.bit_rate = bit_rate;
        if let State::Up = self.state {
            self.leave();
        }
    }

    /// Follows the plant, which may cut the controller off, and the controller's own error mode. Returns that of the
    /// link, as of now; on the way into bus-off what waits to be sent is dropped.
    pub(super) fn follow(&mut self, is_cut: bool) -> BusErrorMode {
        match self.state {
            State::Up if is_cut => {
                self.leave();
                self.state = State::Cut;
            }
            State::Cut if !is_cut => {
                let recovery = RECOVERY_BITS * 1_000_000 / self.bit_rate.bits_per_second();
                self.state = State::Recovering(Instant::now() + Duration::from_micros(recovery.into()));
            }
            State::Recovering(_) if is_cut => self.state = State::Cut,
            State::Recovering(until) if until <= Instant::now() && self.leaving.is_none() => {
                self.can.join(self.bit_rate);
                self.state = State::Up;
            }
            _ => {}
        }
        let mode = match self.state {
            State::Up => self.can.mode(),
            State::Cut | State::Recovering(_) => BusErrorMode::BusOff,
        };
        if mode == BusErrorMode::BusOff && self.mode != BusErrorMode::BusOff {
            self.can.abort(Filter::ALL);
        }
        self.mode = mode;
        mode
    }

    /// Leaves the bus at the end of the current frame.
    fn leave(&mut self) {
        self.can.leave();
        self.leaving = Some(0);
    }

    /// Waits until a controller that leaves the bus has left it, and has it join again, unless the plant cuts it off.
    /// To be done before the controller is used again. Returns whether the controller was leaving, so that time has passed.
    ///
    /// A bus that is held dominant keeps the controller for as long as that lasts: each further call polls it once.
    pub(super) async fn settle(&mut self, wake_up: &mut WakeUp) -> bool {
        let Some(polls) = &mut self.leaving else { return false };
        while !self.can.has_left() {
            match *polls {
                // On a bus that is stuck no frame ever ends.
                POLLS => self.can.reset(),
                polls if polls >= 2 * POLLS => return true,
                _ => {}
            }
            *polls += 1;
            wake_up.pause(LEAVING).await;
        }
        self.leaving = None;
        if let State::Up = self.state {
            self.can.join(self.bit_rate);
        }
        true
    }
}
