//! The device's task: the only one that feeds the watchdog.

use embassy_futures::select::select;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::{Duration, Instant, Timer};
use firmware::console;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::pve::{Kind, Protocol, PveCanopen, PveIsobus, Setup};
use protocol_core::device::{Device, Effect, Senses, StartCause};
use protocol_core::memory::Image;
use protocol_core::pump::pump;

use super::can::{ATTENTION, Can1};
use super::console::{LINES, UNDERSTOOD};
use super::flash::Bank;
use super::led;

/// The error mode of the bus is looked at, and the watchdog fed, at least so often.
const LOOK: Duration = Duration::from_millis(5);

/// What the board is, unless `PVE_KIND` says otherwise when the image is built.
const DEFAULT_KIND: &str = "pvea-canopen";

#[embassy_executor::task]
pub(super) async fn run(
    mut can: Can1,
    mut bank: Bank,
    mut watchdog: IndependentWatchdog<'static, IWDG>,
    cause: StartCause,
) {
    watchdog.unleash();
    let image = bank.image();
    let kind = Kind::from_name(option_env!("PVE_KIND").unwrap_or(DEFAULT_KIND)).unwrap_or(Kind::PveaCanopen);
    let setup = Setup::new(kind);
    match kind.protocol() {
        Protocol::Canopen => {
            let device = PveCanopen::power_on(setup, &image, cause, Instant::now());
            serve(device, &mut can, &mut bank, &mut watchdog).await;
        }
        Protocol::Isobus => {
            let device = PveIsobus::power_on(setup, &image, cause, Instant::now());
            serve(device, &mut can, &mut bank, &mut watchdog).await;
        }
    }
}

/// Runs the device for ever.
async fn serve(
    mut device: impl Device,
    can: &mut Can1,
    bank: &mut Bank,
    watchdog: &mut IndependentWatchdog<'static, IWDG>,
) {
    let mut senses = Senses::default();
    device.sense(&senses, Instant::now());
    can.start(device.bit_rate());
    let mut overruns = 0;
    loop {
        watchdog.pet();
        let mode = can.mode();
        if mode != senses.bus {
            if mode == BusErrorMode::BusOff {
                can.abort();
            }
            senses.bus = mode;
            device.sense(&senses, Instant::now());
        }
        if let Ok(line) = LINES.try_receive() {
            let changed = console::obey(&line, &senses);
            if let Some(changed) = changed {
                senses = changed;
                device.sense(&senses, Instant::now());
            }
            UNDERSTOOD.send(changed.is_some()).await;
        }
        if can.overruns() != overruns {
            overruns = can.overruns();
            defmt::warn!("{} frames were lost", overruns);
        }
        match pump(&mut device, can, Instant::now()) {
            Some(effect) => carry_out(effect, &mut device, can, bank),
            None => {
                led::show(device.outputs().led);
                let look = Instant::now() + LOOK;
                select(ATTENTION.wait(), Timer::at(device.deadline().min(look))).await;
            }
        }
    }
}

fn carry_out(effect: Effect, device: &mut impl Device, can: &mut Can1, bank: &mut Bank) {
    match effect {
        Effect::Store(key, record) => {
            let result = bank.store(key, &record);
            device.stored(key, result, Instant::now());
        }
        Effect::SetBitRate(bit_rate) => can.start(bit_rate),
        Effect::Restart(scope) => {
            let image: Image = bank.image();
            device.restart(scope, &image, Instant::now());
            can.start(device.bit_rate());
        }
    }
}
