//! The link to the bus: joining and leaving, bit rates, and the bus-off that the plant demands.

use embassy_time::{Duration, Instant};
use protocol_core::controller::{BitRate, BusErrorMode, Controller as _, Filter};

use super::can::Can1;
use super::wake_up::WakeUp;

/// The polling period while the controller is leaving the bus.
const LEAVING: Duration = Duration::from_micros(50);

/// The maximum duration of a frame: 160 bits at 10 kbit/s, followed by an error frame.
const LONGEST_FRAME: Duration = Duration::from_millis(20);

/// The number of polls in [`LONGEST_FRAME`].
const POLLS: u64 = LONGEST_FRAME.as_micros() / LEAVING.as_micros();

/// The maximum duration of [`Link::settle`].
pub(super) const LONGEST_SETTLE: Duration = Duration::from_micros(2 * LONGEST_FRAME.as_micros());

/// The number of bits in a bus-off recovery (ISO 11898-1): 128 sequences of 11.
const RECOVERY_BITS: u32 = 128 * 11;

/// The controller and its connection to the bus.
pub(super) struct Link {
    /// The controller.
    pub(super) can: Can1,
    bit_rate: BitRate,
    state: State,
    mode: BusErrorMode,
    /// The number of polls since the controller began to leave the bus; `None` while it is not leaving.
    leaving: Option<u64>,
}

/// The connection of the controller, as the plant demands it.
#[derive(Clone, Copy)]
enum State {
    Up,
    /// The plant holds the controller off the bus.
    Cut,
    /// The controller recovers from the cut until this time.
    Recovering(Instant),
}

impl Link {
    /// Creates a link whose controller has not joined the bus.
    pub(super) const fn new(can: Can1) -> Self {
        Self { can, bit_rate: BitRate::Kbit250, state: State::Up, mode: BusErrorMode::ErrorActive, leaving: None }
    }

    /// Returns the bit rate in force.
    pub(super) const fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    /// Sets the bit rate, which takes effect once the link has [settled](Self::settle). Pending frames are dropped.
    pub(super) fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.bit_rate = bit_rate;
        if let State::Up = self.state {
            self.leave();
        }
    }

    /// Cuts or restores the link, as the plant demands. Returns the resulting error mode. A change to bus-off drops the
    /// pending frames.
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

    /// Makes the controller leave the bus after the current frame.
    fn leave(&mut self) {
        self.can.leave();
        self.leaving = Some(0);
    }

    /// Waits until a leaving controller has left the bus. The controller then joins again, unless the plant cuts the
    /// link. Every use of the controller must follow this call. Returns whether the controller was leaving; time has
    /// then passed.
    ///
    /// A controller cannot leave a bus that is held dominant. Each further call then polls the controller once.
    pub(super) async fn settle(&mut self, wake_up: &mut WakeUp) -> bool {
        let Some(polls) = &mut self.leaving else { return false };
        while !self.can.has_left() {
            match *polls {
                // No frame ends on a stuck bus.
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
