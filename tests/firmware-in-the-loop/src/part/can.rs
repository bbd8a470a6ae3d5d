//! CAN1 in the emulated part: the model behind its registers, and the interrupt lines.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hal_sim::bus::FrameBits;
use protocol_core::controller::BitRate;
use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::Layout;
use rigless::soc::stm32f427::generated::can1::Register;
use rigless::time::{EventId, VirtualNanos};

use crate::bxcan::{BitTiming, BxCan, Interrupts, Presence, registers};

/// The controller, shared by the emulated processor and the bus. One of them waits while the other uses it.
#[derive(Clone, Debug, Default)]
pub struct Can1(Arc<Mutex<Shared>>);

/// The content of [`Can1`].
#[derive(Debug, Default)]
pub struct Shared {
    /// The controller.
    pub can: BxCan,
    /// The clock of the bit timing, in Hz.
    pub clock_hz: u64,
    /// Whether the firmware has changed the state of the controller on the bus.
    pub changed: bool,
    /// Whether the part was reset since the bus last looked.
    pub was_reset: bool,
    /// Whether the clock of the controller was enabled and may not run yet.
    pub clock_starts: bool,
}

impl Can1 {
    /// Locks the controller.
    pub fn lock(&self) -> MutexGuard<'_, Shared> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The model that the emulator calls.
#[derive(Debug, Default)]
pub(super) struct CanDevice {
    pub(super) shared: Can1,
    lines: Interrupts,
    loop_back: Option<EventId>,
}

impl CanDevice {
    pub(super) fn new(shared: Can1) -> Self {
        Self { shared, ..Self::default() }
    }

    fn drive_lines(&mut self, context: &mut DeviceContext<'_>) {
        let levels = |interrupts: Interrupts| {
            let Interrupts { transmit, fifo: [first, second], status } = interrupts;
            [transmit, first, second, status]
        };
        let wanted = self.shared.lock().can.interrupts();
        let driven = std::mem::replace(&mut self.lines, wanted);
        for (line, (wanted, driven)) in levels(wanted).into_iter().zip(levels(driven)).enumerate() {
            if wanted != driven {
                context.interrupt(line, Level::from(wanted));
            }
        }
    }

    /// Starts the transmission in loop back mode, which no bus ends.
    fn start_loop_back(&mut self, context: &mut DeviceContext<'_>) {
        let mut shared = self.shared.lock();
        if !shared.can.is_loopback() || self.loop_back.is_some() {
            return;
        }
        let timing = BitTiming::of(shared.can.read(registers::BTR));
        let Some(message) = shared.can.offer() else { return };
        let cycles = FrameBits::of(&message.frame).on_wire() * timing.prescaler * timing.quanta;
        let time = u64::from(cycles) * 1_000_000_000 / shared.clock_hz.max(1);
        self.loop_back = Some(context.schedule(VirtualNanos(context.now().0 + time)));
    }
}

impl Device for CanDevice {
    type Register = Register;

    fn read(&mut self, register: Register, _: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Option<u64> {
        let mut shared = self.shared.lock();
        shared.look_at_clock();
        let offset = register.spec().offset;
        let value = shared.can.read(offset);
        shared.can.pass_access(offset);
        drop(shared);
        self.drive_lines(context);
        Some(value.into())
    }

    fn peek(&self, register: Register, _: &RegisterFile, _: VirtualNanos) -> Option<u64> {
        Some(self.shared.lock().can.read(register.spec().offset).into())
    }

    fn write(&mut self, register: Register, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let mut shared = self.shared.lock();
        shared.look_at_clock();
        shared.can.pass_access(register.spec().offset);
        let before = (shared.can.presence(), shared.can.is_recovering(), shared.can.offer());
        shared.can.write(register.spec().offset, value as u32);
        let after = (shared.can.presence(), shared.can.is_recovering(), shared.can.offer());
        shared.changed |= before != after;
        drop(shared);
        self.drive_lines(context);
        self.start_loop_back(context);
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.loop_back.take_if(|due| *due == event).is_some() {
            self.shared.lock().can.loop_back();
            self.drive_lines(context);
            self.start_loop_back(context);
        }
    }

    /// Handles the events of the bus.
    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.drive_lines(context);
    }

    fn reset(&mut self) {
        let mut shared = self.shared.lock();
        let complaints = shared.can.take_complaints();
        let dominant = shared.can.is_held_dominant();
        *shared = Shared {
            clock_hz: shared.clock_hz,
            changed: true,
            was_reset: true,
            clock_starts: shared.clock_starts,
            ..Shared::default()
        };
        shared.can.complain_of(complaints);
        shared.can.hold_dominant(dominant);
        drop(shared);
        *self = Self::new(self.shared.clone());
    }
}

impl Shared {
    fn look_at_clock(&mut self) {
        if std::mem::take(&mut self.clock_starts) {
            self.can.complain("CAN1 is accessed right after its clock was enabled: it may be without a clock".into());
        }
    }

    /// Returns the bit rate in bits per second, 0 for one that is no whole number, and whether the controller is
    /// silent; `None` off the bus. A controller that sleeps before its first setup is off the bus.
    #[must_use]
    pub fn on_bus(&self) -> Option<(u64, bool)> {
        let rate = |timing: BitTiming| timing.bits_per_second(self.clock_hz).unwrap_or(0);
        match self.can.presence() {
            Presence::Off => None,
            Presence::Asleep { timing } => {
                let usual = u32::try_from(rate(timing)).ok().and_then(BitRate::from_bits_per_second);
                usual.map(|rate| (rate.bits_per_second().into(), true))
            }
            Presence::On { timing, silent } => Some((rate(timing), silent)),
        }
    }
}
