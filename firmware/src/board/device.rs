//! The device task, which has the highest priority of all tasks. Only this task feeds the watchdog, and only while no
//! memory result is overdue.

use embassy_time::{Duration, Instant};
use firmware::console::{Command, OTHER_KIND};
use firmware::plant::{Change, Inapplicable, Plant};
use firmware::settings::Settings;
use nvm::Contents;
use protocol_core::controller::BusErrorMode;
use protocol_core::device::{AnyDevice, Device, Effect, Restart, StartCause};
use protocol_core::memory::{Image, StoreError};
use protocol_core::pump::{note_sent, pump, receive};
use protocol_core::time::NEVER;
use static_cell::StaticCell;

use super::can::{self, Can1};
use super::console::Answer;
use super::led::{Lights, led_of};
use super::link::Link;
use super::local_controls::LocalControls;
use super::storage::{Client, Done, Request};
use super::wake_up::{Event, Events, WakeUp, notify};
use super::watchdog::{FEED, Watchdog};

/// The polling period of a controller that is not error-active or whose frame is blocked. No interrupt reports the end
/// of these states.
const LOOK: Duration = Duration::from_millis(1);

#[embassy_executor::task]
pub(super) async fn run(
    can: Can1,
    mut watchdog: Watchdog,
    cause: StartCause,
    mut memory: Client,
    controls: LocalControls,
    lights: &'static Lights,
) -> ! {
    let mut wake_up = WakeUp::new().await;
    let (settings, contents) = loop {
        let now = Instant::now();
        watchdog.feed(&memory, now);
        if let Some(Done::Started(settings, contents)) = memory.take() {
            break (settings, contents);
        }
        wake_up.wait(now + FEED, now).await;
    };
    // The waits above may have consumed the event of a line or a press.
    notify(Event::Controls);
    defmt::info!("{}", settings.kind.name());
    let device = power_on(&settings, &contents.image, cause);
    let link = Link::new(can);
    let (plant, contents, restarting) = (Plant::healthy(settings.kind), Some(contents), None);
    Board { settings, link, watchdog, wake_up, memory, contents, controls, lights, plant, restarting }
        .serve(device)
        .await
}

/// A device as a trait object that can move to another executor.
type SendDevice = dyn Device + Send;

fn power_on(settings: &Settings, image: &Image, cause: StartCause) -> &'static mut SendDevice {
    let device = new_device(settings);
    device.start_up(image, cause, Instant::now());
    device.as_dyn_mut()
}

// `inline(never)`, because the stack frame of this function holds a device. It is released before the device starts.
#[inline(never)]
fn new_device(settings: &Settings) -> &'static mut AnyDevice {
    static DEVICE: StaticCell<AnyDevice> = StaticCell::new();
    DEVICE.init_with(|| AnyDevice::new(settings.setup()))
}

/// The environment of the device on the board.
struct Board {
    settings: Settings,
    link: Link,
    watchdog: Watchdog,
    wake_up: WakeUp,
    memory: Client,
    /// The contents of the memory at the last read; `None` during a read.
    contents: Option<&'static mut Contents>,
    controls: LocalControls,
    lights: &'static Lights,
    plant: Plant,
    /// The restart of the device, which waits for the contents of the memory.
    restarting: Option<Restart>,
}

impl Board {
    async fn serve(mut self, device: &mut SendDevice) -> ! {
        device.sense(&self.plant.inputs, Instant::now());
        self.link.set_bit_rate(device.bit_rate());
        let (mut now, mut due) = (Instant::now(), Instant::MIN);
        loop {
            let events = self.wake_up.wait(due, now).await;
            now = Instant::now();
            self.watchdog.feed(&self.memory, now);
            // Most frames that pass the filters are for other nodes, and need no pump.
            let only_received = events.are_only(Event::Received) && self.restarting.is_none() && now < due;
            if only_received && !receive(device, &mut self.link.can, now) {
                continue;
            }
            if events.include(Event::Sent) && !events.are_only(Event::Sent) {
                self.note_sent(device, now);
            }
            let answer = self.look(events, device);
            if self.link.settle(&mut self.wake_up).await {
                // The wait took time, so received frames take effect at the present time.
                now = Instant::now();
            }
            if let Some(answer) = answer {
                self.controls.answer(answer);
            }
            while self.restarting.is_none()
                && let Some(effect) = pump(device, &mut self.link.can, now)
            {
                self.carry_out(effect, device);
                self.link.settle(&mut self.wake_up).await;
                now = Instant::now();
            }
            if events.include(Event::Leds) {
                self.lights.show(led_of(device, &self.plant.inputs));
            }
            due = self.next_look(device, now);
        }
    }

    /// Passes the controller's error mode, memory results, console lines and button presses to the device. Returns the
    /// answer to a line if the answer is known already.
    fn look(&mut self, events: Events, device: &mut SendDevice) -> Option<Answer> {
        if events.include(Event::Errors) || self.plant.inputs.bus != BusErrorMode::ErrorActive {
            self.look_at_bus(device);
        }
        if events.include(Event::Memory) {
            self.look_at_memory(device);
        }
        if events.include(Event::Controls) { self.look_at_controls(device) } else { None }
    }

    /// Tells the device which of its frames are sent, before it takes an input or a frame that came at the same time.
    // `inline(never)` keeps the rare call out of the loop, in which each frame counts.
    #[inline(never)]
    fn note_sent(&self, device: &mut SendDevice, now: Instant) {
        note_sent(device, &self.link.can, now);
    }

    /// Returns the time of the next poll if no event occurs before.
    fn next_look(&self, device: &SendDevice, now: Instant) -> Instant {
        let due = if self.restarting.is_some() { NEVER } else { device.deadline() };
        // The retry is needed in every error mode.
        let is_blocked = can::retry();
        let is_calm = self.plant.inputs.bus == BusErrorMode::ErrorActive && !is_blocked;
        due.min(now + if is_calm { FEED } else { LOOK })
    }

    /// Passes the controller's error mode to the device.
    fn look_at_bus(&mut self, device: &mut SendDevice) {
        let mode = self.link.follow(self.plant.bus_off);
        if mode != self.plant.inputs.bus {
            self.plant.inputs.bus = mode;
            device.sense(&self.plant.inputs, Instant::now());
        }
    }

    /// Passes the memory results to the device.
    fn look_at_memory(&mut self, device: &mut SendDevice) {
        while let Some(done) = self.memory.take() {
            match done {
                Done::Stored(key, result) => device.stored(key, result, Instant::now()),
                Done::Read(contents) => {
                    if let Some(scope) = self.restarting.take() {
                        device.restart(scope, &contents.image, Instant::now());
                        self.link.set_bit_rate(device.bit_rate());
                    }
                    self.contents = Some(contents);
                }
                Done::Became(Ok(())) => self.controls.answer(Answer::Restart),
                Done::Became(Err(_)) => self.controls.answer(Answer::Refused("the memory failed")),
                Done::Started(..) => {}
            }
        }
    }

    /// Executes a button press and a console line. Returns the answer to the line if the answer is known already.
    fn look_at_controls(&mut self, device: &mut SendDevice) -> Option<Answer> {
        if let Some(plant) = self.controls.pressed(&self.plant) {
            self.set_plant(plant, device);
        }
        match self.controls.command()? {
            Command::Plant(change) => Some(self.change_plant(change, device)),
            Command::Status => {
                self.controls.tell_status(&self.settings, device, &self.link, &self.plant);
                Some(Answer::Status)
            }
            Command::Kind(kind, serial) => self.become_new(Some(Settings::new(kind, serial))),
            Command::Blank(serial) => self.become_new(self.settings.blank(serial)),
            Command::PowerCycle => Some(Answer::Restart),
            Command::Help => Some(Answer::Help((&self.plant.inputs.product).into())),
        }
    }

    /// Requests the write of `settings`, so that the board is a new device at the next start. `None` stands for an
    /// impossible device. Returns the answer if the command is refused. Otherwise the answer follows with the memory
    /// result.
    fn become_new(&mut self, settings: Option<Settings>) -> Option<Answer> {
        let Some(settings) = settings else {
            return Some(Answer::Refused("on ISOBUS a valve always has an address"));
        };
        self.memory.ask(Request::Become(settings)).err().map(|_| Answer::Refused("the memory is busy"))
    }

    fn change_plant(&mut self, change: Change, device: &mut SendDevice) -> Answer {
        let mut plant = self.plant;
        match plant.change(change, Instant::now()) {
            Ok(()) => {
                self.set_plant(plant, device);
                Answer::Done
            }
            Err(Inapplicable::OtherProduct) => Answer::Refused(OTHER_KIND),
            Err(Inapplicable::OutOfRange) => Answer::Usage,
        }
    }

    fn set_plant(&mut self, plant: Plant, device: &mut SendDevice) {
        self.plant = plant;
        device.sense(&plant.inputs, Instant::now());
        self.look_at_bus(device);
    }

    fn carry_out(&mut self, effect: Effect, device: &mut SendDevice) {
        match effect {
            Effect::Store(key, record) => {
                let asked = if self.plant.memory_fails {
                    Err(StoreError)
                } else {
                    self.memory.ask(Request::Store(key, record))
                };
                if asked.is_err() {
                    device.stored(key, Err(StoreError), Instant::now());
                }
            }
            Effect::SetBitRate(bit_rate) => self.link.set_bit_rate(bit_rate),
            Effect::Restart(scope) => {
                // There is room, because a restarting device makes no other request.
                if let Some(contents) = self.contents.take() {
                    let _ = self.memory.ask(Request::Read(contents));
                }
                self.restarting = Some(scope);
            }
        }
    }
}
