//! The device's task, above all others: it alone feeds the watchdog.

use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};
use firmware::console::Command;
use firmware::plant::{Injection, Plant, Value};
use firmware::settings::Settings;
use heapless::String;
use protocol_core::controller::{BitRate, BusErrorMode};
use protocol_core::device::pve::{Protocol, PveCanopen, PveIsobus, Setup};
use protocol_core::device::{Device, Effect, Restart, StartCause};
use protocol_core::memory::{Image, StoreError};
use protocol_core::pump::{pump, receive};
use protocol_core::time::NEVER;
use static_cell::StaticCell;

use super::attention::{Attention, Caller, Calls};
use super::can::Can1;
use super::console::{ANSWER, Answer, STATUS, TYPED};
use super::led;
use super::storage::{BECOMES, CONTENTS, FOUND, READ, REQUESTS, Request, STORED};

/// What the button injects.
pub(super) static INJECTION: Signal<CriticalSectionRawMutex, Injection> = Signal::new();

/// The watchdog is fed at least so often.
const FEED: Duration = Duration::from_millis(100);

/// The error mode is looked at so often while it is not error-active: no interrupt tells of the way back.
const LOOK: Duration = Duration::from_millis(1);

/// So many bits does the way back from bus-off take (ISO 11898-1): 128 sequences of 11.
const RECOVERY_BITS: u64 = 128 * 11;

#[embassy_executor::task]
pub(super) async fn run(can: Can1, mut watchdog: IndependentWatchdog<'static, IWDG>, cause: StartCause) {
    watchdog.unleash();
    let mut attention = Attention::new().await;
    let settings = loop {
        watchdog.pet();
        if let Some(settings) = FOUND.try_take() {
            break settings;
        }
        let now = Instant::now();
        attention.wait(now + FEED, now).await;
    };
    defmt::info!("{}", settings.kind.name());
    let device = {
        let image = &CONTENTS.lock().await.image;
        match settings.kind.protocol() {
            Protocol::Canopen => canopen(settings.setup(), image, cause),
            Protocol::Isobus => isobus(settings.setup(), image, cause),
        }
    };
    Board::new(settings, can, watchdog, attention).serve(device).await;
}

/// A device of any kind, which may be served by an executor of its own.
type AnyDevice = dyn Device + Send;

// Kept apart: each is as large as its device on the stack, and gone from there when that is in its place.
#[inline(never)]
fn canopen(setup: Setup, image: &Image, cause: StartCause) -> &'static mut AnyDevice {
    static DEVICE: StaticCell<PveCanopen> = StaticCell::new();
    DEVICE.init_with(|| PveCanopen::power_on(setup, image, cause, Instant::now()))
}

#[inline(never)]
fn isobus(setup: Setup, image: &Image, cause: StartCause) -> &'static mut AnyDevice {
    static DEVICE: StaticCell<PveIsobus> = StaticCell::new();
    DEVICE.init_with(|| PveIsobus::power_on(setup, image, cause, Instant::now()))
}

/// What stands between the device and the world.
struct Board {
    settings: Settings,
    can: Can1,
    watchdog: IndependentWatchdog<'static, IWDG>,
    attention: Attention,
    plant: Plant,
    link: Link,
    bit_rate: BitRate,
    /// The device waits for what the memory holds.
    restarting: Option<Restart>,
}

/// Whether the plant lets the controller take part in the bus.
#[derive(Clone, Copy)]
enum Link {
    Up,
    /// It is kept off.
    Cut,
    /// It is on its way back until then.
    Recovering(Instant),
}

impl Board {
    fn new(settings: Settings, can: Can1, watchdog: IndependentWatchdog<'static, IWDG>, attention: Attention) -> Self {
        Self {
            settings,
            can,
            watchdog,
            attention,
            plant: Plant::default(),
            link: Link::Up,
            bit_rate: BitRate::Kbit250,
            restarting: None,
        }
    }

    /// Runs the device for ever.
    async fn serve(mut self, device: &mut AnyDevice) {
        device.sense(&self.plant.senses, Instant::now());
        self.set_bit_rate(device.bit_rate()).await;
        let (mut now, mut due) = (Instant::now(), Instant::MIN);
        loop {
            let calls = self.attention.wait(due, now).await;
            self.watchdog.pet();
            now = Instant::now();
            // Most frames that pass the filters are for nobody: nothing is asked of the device then.
            let only_received = calls.are_only(Caller::Received) && self.restarting.is_none() && now < due;
            if only_received && !receive(device, &mut self.can, now) {
                continue;
            }
            self.look(calls, device).await;
            while self.restarting.is_none()
                && let Some(effect) = pump(device, &mut self.can, now)
            {
                self.carry_out(effect, device).await;
                now = Instant::now();
            }
            self.can.resume();
            if calls.include(Caller::Leds) {
                if let Some(outputs) = device.outputs().valve() {
                    led::show(outputs.led);
                }
            }
            due = self.next_look(device, now);
        }
    }

    /// Looks at what the device does not see by itself.
    async fn look(&mut self, calls: Calls, device: &mut AnyDevice) {
        if calls.include(Caller::Errors) || self.plant.senses.bus != BusErrorMode::ErrorActive {
            self.look_at_bus(device).await;
        }
        if calls.include(Caller::Memory) {
            self.look_at_memory(device).await;
        }
        if calls.include(Caller::Front) {
            self.look_at_front(device).await;
        }
    }

    /// When there is something to do although nobody calls.
    fn next_look(&self, device: &AnyDevice, now: Instant) -> Instant {
        let due = if self.restarting.is_some() { NEVER } else { device.deadline() };
        let look = if self.plant.senses.bus == BusErrorMode::ErrorActive { FEED } else { LOOK };
        due.min(now + look)
    }

    /// Tells the device how its controller stands to the bus.
    async fn look_at_bus(&mut self, device: &mut AnyDevice) {
        match self.link {
            Link::Up if self.plant.bus_off => {
                self.can.leave(&mut self.attention).await;
                self.link = Link::Cut;
            }
            Link::Cut if !self.plant.bus_off => {
                let bits_per_second = u64::from(self.bit_rate.bits_per_second());
                let recovery = Duration::from_micros(RECOVERY_BITS * 1_000_000 / bits_per_second);
                self.link = Link::Recovering(Instant::now() + recovery);
            }
            Link::Recovering(until) if until <= Instant::now() => {
                self.can.join(self.bit_rate, &mut self.attention).await;
                self.link = Link::Up;
            }
            _ => {}
        }
        let mode = match self.link {
            Link::Up => self.can.mode(),
            Link::Cut | Link::Recovering(_) => BusErrorMode::BusOff,
        };
        if mode != self.plant.senses.bus {
            if mode == BusErrorMode::BusOff {
                self.can.drop_waiting();
            }
            self.plant.senses.bus = mode;
            device.sense(&self.plant.senses, Instant::now());
        }
    }

    /// Tells the device what has become of its requests to the memory.
    async fn look_at_memory(&mut self, device: &mut AnyDevice) {
        if let Some((key, result)) = STORED.try_take() {
            device.stored(key, result, Instant::now());
        }
        if let Some(scope) = self.restarting
            && READ.try_take().is_some()
        {
            self.restarting = None;
            device.restart(scope, &CONTENTS.lock().await.image, Instant::now());
            self.set_bit_rate(device.bit_rate()).await;
        }
        if let Some(result) = BECOMES.try_take() {
            ANSWER.signal(result.map_or(Answer::Refused("the memory failed"), |()| Answer::Restart));
        }
    }

    /// Obeys console and button.
    async fn look_at_front(&mut self, device: &mut AnyDevice) {
        if let Some(injection) = INJECTION.try_take() {
            self.set_plant(injection.applied_to(self.plant), device).await;
        }
        if let Some(line) = TYPED.try_take() {
            match Command::parse(&line, &self.plant) {
                Some(Command::Plant(plant)) => {
                    self.set_plant(plant, device).await;
                    ANSWER.signal(Answer::Done);
                }
                Some(Command::Status) => ANSWER.signal(Answer::Status(self.status(device))),
                Some(Command::Kind(kind, serial)) => self.become_new(Some(Settings::new(kind, serial))),
                Some(Command::Blank(serial)) => self.become_new(Settings::new_blank(self.settings.kind, serial)),
                Some(Command::PowerCycle) => ANSWER.signal(Answer::Restart),
                None => ANSWER.signal(Answer::Usage),
            }
        }
    }

    async fn set_plant(&mut self, plant: Plant, device: &mut AnyDevice) {
        self.plant = plant;
        device.sense(&plant.senses, Instant::now());
        self.look_at_bus(device).await;
    }

    /// Makes the board a new device at the next start; `None` for what there is not.
    fn become_new(&mut self, settings: Option<Settings>) {
        let Some(settings) = settings else {
            ANSWER.signal(Answer::Refused("on ISOBUS a valve always has an address"));
            return;
        };
        if REQUESTS.try_send(Request::Become(settings)).is_err() {
            ANSWER.signal(Answer::Refused("the memory is busy"));
        }
    }

    /// A line for each thing that can be told; what does not fit is left out.
    fn status(&self, device: &AnyDevice) -> String<STATUS> {
        let number = |number: u32| Value::Number(i32::try_from(number).unwrap_or(i32::MAX));
        let bus = match self.plant.senses.bus {
            BusErrorMode::ErrorActive => "error-active",
            BusErrorMode::ErrorPassive => "error-passive",
            BusErrorMode::BusOff => "bus-off",
        };
        let own = [
            ("kind", Value::Word(self.settings.kind.name())),
            ("node_id", device.node_id().map_or(Value::Word("none"), |node_id| Value::Number(node_id.into()))),
            ("bit_rate", number(self.bit_rate.bits_per_second())),
            ("bus", Value::Word(bus)),
            ("overruns", number(self.can.overruns())),
            ("dropped", number(device.frames_dropped())),
        ];
        let mut status = String::new();
        for (word, value) in own.into_iter().chain(self.plant.words()) {
            let mut digits = itoa::Buffer::new();
            let value = match value {
                Value::Number(number) => digits.format(number),
                Value::Word(word) => word,
            };
            for part in [word, " ", value, "\r\n"] {
                let _ = status.push_str(part);
            }
        }
        status
    }

    async fn carry_out(&mut self, effect: Effect, device: &mut AnyDevice) {
        match effect {
            Effect::Store(key, record) => {
                // There is room: the device asks for one at a time.
                let refused = self.plant.memory_fails || REQUESTS.try_send(Request::Store(key, record)).is_err();
                if refused {
                    device.stored(key, Err(StoreError), Instant::now());
                }
            }
            Effect::SetBitRate(bit_rate) => self.set_bit_rate(bit_rate).await,
            Effect::Restart(scope) => {
                let _ = REQUESTS.try_send(Request::Read);
                self.restarting = Some(scope);
            }
        }
    }

    async fn set_bit_rate(&mut self, bit_rate: BitRate) {
        self.bit_rate = bit_rate;
        if let Link::Up = self.link {
            self.can.join(bit_rate, &mut self.attention).await;
        }
    }
}
