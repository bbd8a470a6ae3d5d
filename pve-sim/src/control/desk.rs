//! The world's end of the control interface: obeys messages, and watches the world for those who wait.

use std::collections::VecDeque;

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, NEVER, after};

use super::events::Events;
use super::message::{
    Answer, BusState, DisturbState, Message, NotHeard, Sent, SpeedValue, StepWord, Stopped, Time, Waited,
};
use super::record::{BusTrouble, Frames, Passed, raw};
use super::refusal::Refusal;
use super::wait::Waits;
use crate::speed::Speed;
use hal_sim::Kind;
use hal_sim::devices::RateWatch;
use hal_sim::explain::Explainer;
use hal_sim::sender::Sender;
use hal_sim::state::{Condition, DeviceState};
use hal_sim::world::{Event, NodeId, World};

/// The world's end of the control interface.
#[derive(Debug)]
pub(crate) struct Desk {
    /// The devices, in their order on the bus.
    devices: Vec<(NodeId, Kind)>,
    speed: Speed,
    frames: Frames,
    sender: Sender<Answer<Sent>>,
    waits: Waits,
    events: Events,
    /// The call that lets time pass, with its end.
    advance: Option<(Instant, Answer<Time>)>,
    /// Calls that let time pass after it, one after the other.
    queue: VecDeque<Passage>,
}

/// A call that lets time pass when time is stepped.
#[derive(Debug)]
enum Passage {
    Advance(Duration, Answer<Time>),
    Send(Frame, Option<Duration>, Answer<Sent>),
    Wait(Condition, Duration, Answer<Waited>),
}

impl Desk {
    /// Puts the control interface of a world with devices of these kinds in charge.
    pub(crate) fn new(kinds: &[Kind], speed: Speed, world: &mut World) -> Self {
        let devices: Vec<_> = world.devices().zip(kinds.iter().copied()).collect();
        let factor = match speed {
            Speed::Factor(factor) => factor,
            Speed::Step => 1.0,
        };
        Self {
            speed,
            frames: Frames::default(),
            sender: Sender::new(hal_sim::sender::CONTROL, world),
            waits: Waits::default(),
            events: Events::new(&devices, factor, world),
            advance: None,
            queue: VecDeque::new(),
            devices,
        }
    }

    /// Obeys a message at the world's instant.
    pub(crate) fn obey(&mut self, message: Message, explainer: &Explainer, rates: &mut RateWatch, world: &mut World) {
        match message {
            Message::Devices(answer) => {
                answer.send(Ok(self.devices.iter().map(|(node, kind)| DeviceState::of(*node, *kind, world)).collect()));
            }
            Message::Device(name, answer) => answer.send(self.with(&name, world, |_, _| Ok(()))),
            Message::Plant(name, change, answer) => {
                answer.send(self.with(&name, world, |node, world| Ok(change.make(node, world)?)));
            }
            Message::Power(name, power, answer) => {
                answer.send(self.with(&name, world, |node, world| {
                    power.switch(node, world).map_err(|reason| Refusal::Conflict(reason.to_owned()))
                }));
            }
            Message::Bus(answer) => answer.send(Ok(bus(rates, world))),
            Message::BitRate(bit_rate, answer) => {
                world.set_bit_rate(bit_rate);
                answer.send(Ok(bus(rates, world)));
            }
            Message::Disturb(disturbance, answer) => {
                world.disturb(disturbance);
                answer.send(Ok(bus(rates, world)));
            }
            Message::Stop(id, answer) => answer.send(Ok(Stopped { stopped: self.sender.stop(id, world) })),
            Message::Time(answer) => answer.send(Ok(self.time(world))),
            Message::Trace(limit, answer) => answer.send(Ok(self.frames.last(limit, explainer))),
            Message::Subscribe(answer) => answer.send(self.events.subscribe(world)),
            Message::Advance(span, answer) => self.pass(Passage::Advance(span, answer), world),
            Message::Send(frame, period, answer) => self.pass(Passage::Send(frame, period, answer), world),
            Message::Wait(condition, within, answer) => self.pass(Passage::Wait(condition, within, answer), world),
        }
        self.attend(world);
    }

    /// Shows an event, and what is told of one that is trouble. To be called with each of them in their order, before
    /// [`attend`](Self::attend).
    pub(crate) fn show(&mut self, event: &Event, trouble: Option<&str>, explainer: &Explainer) {
        if let Some(meaning) = trouble {
            let trouble =
                BusTrouble { t_us: event.at.as_micros(), from: event.who.to_string(), meaning: meaning.to_owned() };
            self.events.show_trouble(&trouble);
            self.frames.keep_error(trouble);
        }
        let Some(frame) = event.frame() else { return };
        let passed = Passed { at: event.at, frame: *frame, from: event.who.clone() };
        let meaning = || explainer.explain(frame, Some(&event.who));
        self.waits.show(&passed, || passed.record(meaning()));
        self.events.show(&passed, meaning);
        self.frames.keep(passed);
    }

    /// Does what is due at the world's instant: to be called after everything that happens.
    pub(crate) fn attend(&mut self, world: &mut World) {
        if !self.sender.is_idle() {
            self.sender.attend(world);
        }
        self.waits.attend(world);
        self.events.attend(world);
        if let Some((_, answer)) = self.advance.take_if(|(end, answer)| *end <= world.now() || answer.is_given_up()) {
            answer.send(Ok(self.time(world)));
        }
    }

    /// Returns when there is next something to do although nothing happens in the world; after now, or at once.
    pub(crate) fn due(&self, world: &World) -> Instant {
        let advanced = self.advance.as_ref().map_or(NEVER, |(end, _)| *end);
        let awaited = if self.waits.is_idle() { NEVER } else { self.waits.due(world) };
        self.sender.due(world.now()).min(awaited).min(self.events.due()).min(advanced)
    }

    /// Returns whether somebody waits for what happens next.
    pub(crate) fn is_watching(&self) -> bool {
        !self.waits.is_idle() || !self.sender.is_idle() || self.events.is_followed()
    }

    /// Returns how far stepped time is to pass for the call whose turn it is; `None` when nobody lets it pass.
    pub(crate) fn horizon(&mut self, world: &mut World) -> Option<Instant> {
        loop {
            let advanced = self.advance.as_ref().map(|(end, _)| *end);
            let horizon =
                advanced.into_iter().chain(self.waits.awaited()).chain(self.sender.awaited(world.now())).max();
            if horizon.is_some() {
                return horizon;
            }
            let next = self.queue.pop_front()?;
            self.begin(next, world);
        }
    }

    /// Lets a call begin that lets time pass: at once, or when it is its turn.
    fn pass(&mut self, passage: Passage, world: &mut World) {
        match passage {
            Passage::Advance(_, answer) if self.speed != Speed::Step => answer.send(Err(Refusal::Conflict(
                "time passes by itself: it is advanced with --speed step only".to_owned(),
            ))),
            passage if self.speed != Speed::Step => self.begin(passage, world),
            passage => {
                // The others are as many as calls may wait.
                self.queue.retain(|passage| !passage.is_given_up());
                self.queue.push_back(passage);
            }
        }
    }

    fn begin(&mut self, passage: Passage, world: &mut World) {
        match passage {
            // The client is gone: its turn is over.
            Passage::Advance(_, answer) if answer.is_given_up() => {}
            Passage::Send(.., answer) if answer.is_given_up() => {}
            Passage::Advance(span, answer) => self.advance = Some((after(world.now(), span), answer)),
            Passage::Send(frame, period, answer) => self.sender.send(frame, period, answer, world),
            Passage::Wait(condition, within, answer) => {
                let devices = &self.devices;
                let names: Vec<String> = devices.iter().map(|(node, _)| world.name(*node).to_owned()).collect();
                self.waits.begin(condition, within, answer, world, |name| find(name, devices, &names));
            }
        }
        self.attend(world);
    }

    fn time(&self, world: &World) -> Time {
        let speed = match self.speed {
            Speed::Factor(factor) => SpeedValue::Factor(factor),
            Speed::Step => SpeedValue::Step(StepWord::Step),
        };
        Time { now_us: world.now().as_micros(), speed }
    }

    /// Acts on a device; returns its state.
    fn with(
        &self,
        name: &str,
        world: &mut World,
        act: impl FnOnce(NodeId, &mut World) -> Result<(), Refusal>,
    ) -> Result<DeviceState, Refusal> {
        let names: Vec<String> = self.devices.iter().map(|(node, _)| world.name(*node).to_owned()).collect();
        let (node, kind) = find(name, &self.devices, &names)?;
        act(node, world)?;
        Ok(DeviceState::of(node, kind, world))
    }
}

impl Passage {
    /// Returns whether the client is gone.
    fn is_given_up(&self) -> bool {
        match self {
            Self::Advance(_, answer) => answer.is_given_up(),
            Self::Send(.., answer) => answer.is_given_up(),
            Self::Wait(.., answer) => answer.is_given_up(),
        }
    }
}

/// Returns the device of a name.
fn find(name: &str, devices: &[(NodeId, Kind)], names: &[String]) -> Result<(NodeId, Kind), Refusal> {
    let found = names.iter().position(|known| known == name).and_then(|place| devices.get(place));
    found.copied().ok_or_else(|| Refusal::UnknownDevice { name: name.to_owned(), known: names.join(", ") })
}

fn bus(rates: &mut RateWatch, world: &mut World) -> BusState {
    rates.look(world);
    let disturbance = world.disturbance();
    let id = disturbance.id.filter(|_| disturbance.frames > 0).map(raw);
    BusState {
        t_us: world.now().as_micros(),
        bit_rate: world.bit_rate().bits_per_second(),
        load: world.load(),
        disturb: DisturbState {
            frames: disturbance.frames,
            id: id.map(|(id, _)| id),
            extended: id.is_some_and(|(_, extended)| extended),
        },
        not_heard: rates.all().into_iter().map(NotHeard::from).collect(),
    }
}
