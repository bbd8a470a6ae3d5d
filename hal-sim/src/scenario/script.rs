//! A checked scenario: every step can be executed.

use protocol_core::controller::BitRate;
use protocol_core::device::{Protocol, Setup};
use protocol_core::frame::{Frame, Id};
use protocol_core::time::Duration;

use super::ReadError;
use super::file::{self, DeviceEntry, Expected, PATIENCE, ScenarioFile, StepTable};
use crate::bus::Disturbance;
use crate::devices::{self, DeviceSpec, LinkSpec, NamedDevice, NamedLink};
use crate::memory::Memory;
use crate::simulation::{Command, Simulation};
use crate::state::{
    self, BusChange, Condition, Disturb, Identifier, Invalid, Pattern, Power, PowerChange, StateCondition,
};
use crate::text::in_one_line;

/// The word for null.
const NONE: &str = "\"none\"";

const NO_TIME: Duration = Duration::from_ticks(0);

/// A scenario.
#[derive(Debug)]
pub struct Scenario {
    pub(super) title: String,
    pub(super) devices: Vec<NamedDevice>,
    /// The entry of each device in the file.
    pub(super) entries: Vec<Entry>,
    links: Vec<NamedLink>,
    bit_rate: BitRate,
    /// A step has to expect each frame of a device.
    pub(super) strict: bool,
    pub(super) steps: Vec<Step>,
}

/// The entry of a device in the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) line: usize,
    /// The device has to run at the bit rate of the bus.
    pub(super) heard: bool,
}

/// A step.
#[derive(Debug)]
pub(super) struct Step {
    /// The line of the file.
    pub(super) line: usize,
    pub(super) note: Option<String>,
    pub(super) begin: Begin,
    pub(super) act: Option<Command>,
    pub(super) expect: Option<Expect>,
    pub(super) never: Option<Never>,
}

/// The beginning of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Begin {
    /// The end of the previous step.
    Now,
    /// A time after the end of the previous step.
    After(Duration),
    /// An instant, from the start of the scenario.
    At(Duration),
}

/// An expectation.
#[derive(Debug)]
pub(super) struct Expect {
    pub(super) what: What,
    pub(super) any_order: bool,
    pub(super) within: Duration,
    /// The period in which the frame repeats afterwards.
    pub(super) every: Option<Duration>,
}

/// A prohibition.
#[derive(Debug)]
pub(super) struct Never {
    pub(super) what: What,
    /// Its duration; `None` up to the end.
    pub(super) span: Option<Duration>,
}

/// Frames, or a state.
#[derive(Debug)]
pub(super) enum What {
    Frames(Vec<Pattern>),
    State(Wanted),
}

/// A state of a device.
#[derive(Debug)]
pub(super) struct Wanted {
    /// The name of the device.
    device: String,
    pub(super) condition: StateCondition,
    /// A separate condition for each key, with the key and its value as in the file.
    pub(super) keys: Vec<(String, String, StateCondition)>,
}

impl Scenario {
    /// Reads a scenario.
    ///
    /// # Errors
    /// [`ReadError`] with the line of the first error.
    pub fn parse(text: &str) -> Result<Self, ReadError> {
        Self::read(text).map_err(|ReadError { line, reason }| ReadError { line, reason: in_one_line(&reason) })
    }

    fn read(text: &str) -> Result<Self, ReadError> {
        let ScenarioFile { title, devices, links, bit_rate, allow_clash, strict, steps } = file::read(text)?;
        let at = |place: usize| move |reason: String| ReadError { line: Some(file::line_of(text, place)), reason };
        let first = devices.first().map_or(0, |device| device.span().start);
        let mut entries = Vec::new();
        let specs = devices.into_iter().map(|entry| {
            let place = entry.span().start;
            let (device, heard) = DeviceEntry::read(entry.into_inner()).map_err(at(place))?;
            entries.push(Entry { line: file::line_of(text, place), heard });
            device.parse::<DeviceSpec>().map_err(at(place))
        });
        let specs = specs.collect::<Result<Vec<_>, _>>()?;
        let mut devices = devices::named(specs).map_err(|error| at(first)(format!("{error} name=")))?;
        if devices.is_empty() {
            return Err(at(0)("no devices; accepted: devices = [\"pvea-canopen@0x20\"]".to_owned()));
        }
        if !allow_clash {
            devices::refuse_clashes(&devices)
                .map_err(|error| at(first)(format!("{error} with @ID, or allow_clash = true")))?;
        }
        let first = links.first().map_or(0, |link| link.span().start);
        let specs = links.into_iter().map(|spec| {
            let place = spec.span().start;
            spec.into_inner().parse::<LinkSpec>().map_err(at(place))
        });
        let links = devices::links(&devices, specs.collect::<Result<_, _>>()?).map_err(at(first))?;
        let bit_rate = bit_rate.map(|rate| {
            let place = rate.span().start;
            let change = BusChange { bit_rate: rate.into_inner() };
            change.bit_rate().map_err(|Invalid(reason)| at(place)(reason))
        });
        let bit_rate = devices::share_bit_rate(&mut devices, bit_rate.transpose()?);
        if steps.is_empty() {
            return Err(at(0)("no steps; accepted: steps = [{ expect = \"720#00\" }]".to_owned()));
        }
        let mut scenario = Self { title, devices, entries, links, bit_rate, strict, steps: Vec::new() };
        // Impossible steps are refused before anything runs.
        let mut trial = Trial::new(&scenario);
        for step in steps {
            let line = file::line_of(text, step.span().start);
            let step = trial.check(line, step.into_inner()).map_err(|reason| ReadError { line: Some(line), reason })?;
            scenario.steps.push(step);
        }
        refuse_unwatched(&scenario.steps)?;
        let expects_frames = |step: &Step| matches!(&step.expect, Some(Expect { what: What::Frames(_), .. }));
        if strict && !scenario.steps.iter().any(expects_frames) {
            return Err(at(0)("strict: no step expects a frame; accepted: with expect = \"720#00\"".to_owned()));
        }
        Ok(scenario)
    }

    /// Returns the devices, in the order of the file.
    #[must_use]
    pub fn devices(&self) -> &[NamedDevice] {
        &self.devices
    }

    /// Returns the bit rate of the bus.
    #[must_use]
    pub const fn bit_rate(&self) -> BitRate {
        self.bit_rate
    }

    /// Returns a simulation of the devices, not yet powered.
    pub(super) fn simulation(&self, seed: u64) -> Simulation {
        let mut simulation = Simulation::new(self.bit_rate, seed);
        for (device, entry) in self.devices.iter().zip(&self.entries) {
            let node = simulation.add(device, Memory::in_ram());
            if !entry.heard {
                simulation.rates_mut().ignore(node);
            }
        }
        simulation.link(&self.links);
        simulation
    }
}

/// Refuses a prohibition after which no time passes: at most one instant of it would be checked.
fn refuse_unwatched(steps: &[Step]) -> Result<(), ReadError> {
    // The scenario goes on until all prohibitions with a duration end.
    if steps.iter().any(|step| step.never.as_ref().is_some_and(|never| never.span.is_some())) {
        return Ok(());
    }
    let last = steps.iter().rposition(Step::can_take_time).unwrap_or(0);
    let Some((place, step)) = steps.iter().enumerate().skip(last).find(|(_, step)| step.never.is_some()) else {
        return Ok(());
    };
    let reason = if place + 1 == steps.len() {
        "never: the scenario ends with this step; accepted: for_ms, or steps after it"
    } else {
        "never: no time passes in the steps after it; accepted: for_ms, or a step that takes time after it"
    };
    Err(ReadError { line: Some(step.line), reason: reason.to_owned() })
}

impl Wanted {
    /// Returns the name of the device.
    pub(super) fn device(&self) -> &str {
        &self.device
    }

    /// Returns the condition of a wait.
    pub(super) fn condition(&self) -> Condition {
        Condition::State(self.device.clone(), Box::new(self.condition.clone()))
    }
}

impl What {
    /// Returns the frames; empty for a state.
    fn frames(&self) -> &[Pattern] {
        match self {
            Self::Frames(frames) => frames,
            Self::State(_) => &[],
        }
    }
}

impl Step {
    /// Returns whether time can pass in the step.
    fn can_take_time(&self) -> bool {
        let waits = match self.begin {
            Begin::Now => false,
            Begin::After(pause) => pause > NO_TIME,
            Begin::At(_) => true,
        };
        let expects = matches!(&self.expect, Some(expect) if expect.within > NO_TIME);
        waits || expects || matches!(self.act, Some(Command::Send(..)))
    }
}

/// The trial run of the steps: devices and active cyclic frames.
struct Trial {
    simulation: Simulation,
    devices: Vec<NamedDevice>,
    strict: bool,
    /// The identifiers of the cyclic frames.
    cyclic: Vec<Id>,
}

impl Trial {
    fn new(scenario: &Scenario) -> Self {
        let (simulation, devices) = (scenario.simulation(0), scenario.devices.clone());
        Self { simulation, devices, strict: scenario.strict, cyclic: Vec::new() }
    }

    /// Checks a step, and applies its plant change to the trial.
    fn check(&mut self, line: usize, table: StepTable) -> Result<Step, String> {
        let about_device = table.plant.is_some()
            || table.power.is_some()
            || matches!(table.expect, Some(Expected::State(_)))
            || matches!(table.never, Some(Expected::State(_)));
        if table.device.is_some() && !about_device {
            return Err("device: accepted with plant, power, or a state".to_owned());
        }
        if table.expect.is_some() && table.never.is_some() {
            return Err("expect and never in one step; accepted: a step for each".to_owned());
        }
        refuse_two_acts(&table)?;
        let device = &self.device(table.device.as_deref(), about_device)?;
        let begin = match (table.at_ms, table.after_ms) {
            (None, None) => Begin::Now,
            (Some(at), None) => Begin::At(millis(at)),
            (None, Some(after)) => Begin::After(millis(after)),
            (Some(_), Some(_)) => return Err("at_ms and after_ms: accepted: one of them in a step".to_owned()),
        };
        let mut expect = self.expect(device, table.expect, table.any_order, table.within_ms)?;
        let never = self.never(device, table.never, table.for_ms)?;
        let mut act = None;
        if let Some(frame) = table.send {
            act = Some(self.send(&frame, table.every_ms)?);
        } else if let Some(period) = period(table.every_ms)? {
            self.expect_again(expect.as_mut(), period)?;
        }
        if let Some(which) = table.stop {
            act = Some(Command::Stop(self.stop(&which)?));
        }
        if let Some(change) = table.plant {
            act = Some(self.plant(device, change).map_err(within("plant"))?);
        }
        if let Some(change) = table.power {
            act = Some(Command::Power(device.name.clone(), power(change).map_err(within("power"))?));
        }
        if let Some(change) = table.bus {
            act = Some(Command::BitRate(bit_rate(change).map_err(within("bus"))?));
        }
        if let Some(change) = table.disturb {
            act = Some(Command::Disturb(disturbance(change).map_err(within("disturb"))?));
        }
        Ok(Step { line, note: table.note, begin, act, expect, never })
    }

    fn expect(
        &self,
        device: &NamedDevice,
        expected: Option<Expected>,
        any_order: Option<bool>,
        within_ms: Option<u32>,
    ) -> Result<Option<Expect>, String> {
        let Some(expected) = expected else {
            return match (within_ms, any_order) {
                (Some(_), _) => Err("within_ms: accepted with expect".to_owned()),
                (None, Some(_)) => Err("any_order: accepted with expect".to_owned()),
                (None, None) => Ok(None),
            };
        };
        let what = self.what(device, expected).map_err(within("expect"))?;
        if any_order.is_some() && !matches!(&what, What::Frames(frames) if frames.len() > 1) {
            return Err("any_order: accepted with several frames".to_owned());
        }
        if matches!(what, What::Frames(_)) && within_ms == Some(0) {
            return Err("within_ms 0: no frame comes in no time; accepted: 1 and more, or a state".to_owned());
        }
        let within = within_ms.map_or(PATIENCE, millis);
        Ok(Some(Expect { what, any_order: any_order.unwrap_or(false), within, every: None }))
    }

    /// Checks that a step of a strict scenario can expect its frame cyclically.
    fn expect_again(&mut self, expect: Option<&mut Expect>, period: Duration) -> Result<(), String> {
        let expect = expect.filter(|_| self.strict);
        let expect = expect.and_then(|expect| match expect.what.frames() {
            [frame] => frame.identifier().map(|id| (expect, id)),
            _ => None,
        });
        let Some((expect, id)) = expect else {
            return Err("every_ms: accepted with send; in a strict scenario also with one expected frame".to_owned());
        };
        if !self.cyclic.contains(&id) {
            self.cyclic.push(id);
        }
        expect.every = Some(period);
        Ok(())
    }

    fn never(
        &self,
        device: &NamedDevice,
        expected: Option<Expected>,
        for_ms: Option<u32>,
    ) -> Result<Option<Never>, String> {
        match expected {
            Some(_) if for_ms == Some(0) => Err("for_ms 0: accepted: 1 and more".to_owned()),
            Some(expected) => {
                let what = self.what(device, expected).map_err(within("never"))?;
                if self.strict && matches!(what, What::Frames(_)) {
                    let accepted = "accepted: a state, or no strict = true";
                    return Err(format!("never: in a strict scenario no frame comes that is not expected; {accepted}"));
                }
                Ok(Some(Never { what, span: for_ms.map(millis) }))
            }
            None if for_ms.is_some() => Err("for_ms: accepted with never".to_owned()),
            None => Ok(None),
        }
    }

    /// Returns the named device, or the only one; `is_meant` selects the candidates.
    fn device(&self, name: Option<&str>, is_meant: bool) -> Result<NamedDevice, String> {
        let names = || self.devices.iter().map(|device| device.name.as_str()).collect::<Vec<_>>().join(", ");
        let found = match (name, self.devices.as_slice()) {
            (Some(name), devices) => {
                devices.iter().find(|known| known.name == name).ok_or(format!("no '{name}' on the bus"))
            }
            (None, [only]) => Ok(only),
            (None, [any, ..]) if !is_meant => Ok(any),
            (None, _) => return Err(format!("device is missing, which one is meant? accepted: {}", names())),
        };
        found.cloned().map_err(|reason| format!("device: {reason}; accepted: {}", names()))
    }

    fn send(&mut self, text: &str, every_ms: Option<u32>) -> Result<Command, String> {
        let (frame, period) = (one_frame(text)?, period(every_ms)?);
        if period.is_some() && !self.cyclic.contains(&frame.id()) {
            self.cyclic.push(frame.id());
        }
        Ok(Command::Send(frame, period))
    }

    /// Returns the identifier of the cyclic frame to stop, which has to be active; `None` stops all.
    fn stop(&mut self, which: &Identifier) -> Result<Option<Id>, String> {
        let Some(id) = stopped(which)? else {
            self.cyclic.clear();
            return Ok(None);
        };
        let Some(place) = self.cyclic.iter().position(|cyclic| *cyclic == id) else {
            let cyclic = self.cyclic.iter().map(|id| format!("\"{}\"", digits(*id))).chain(["\"all\"".to_owned()]);
            let accepted = cyclic.collect::<Vec<_>>().join(", ");
            return Err(format!("stop: no frame {which} is sent in a cycle here; accepted: {accepted}"));
        };
        self.cyclic.remove(place);
        Ok(Some(id))
    }

    fn plant(&mut self, device: &NamedDevice, change: toml::Table) -> Result<Command, String> {
        if change.is_empty() {
            return Err("an empty change; accepted: any of its keys, as in { supply_mv = 8000 }".to_owned());
        }
        let command = Command::Plant(device.name.clone(), file::table(change)?);
        self.simulation.execute(command.clone()).map_err(|refusal| refusal.to_string())?;
        Ok(command)
    }

    /// Returns the pattern of a text, which a device on the bus has to be able to send.
    fn frame_to_come(&self, text: &str) -> Result<Pattern, String> {
        let pattern: Pattern = text.parse()?;
        if pattern.is_remote() {
            return Err(format!("'{text}': no device sends remote frames; accepted: data frames"));
        }
        // Every kind can send 29-bit identifiers: valves answer UDS with them, and a COB-ID of an angle sensor can have
        // 29 bits.
        let is_canopen = |device: &NamedDevice| device.setup.kind.protocol() == Protocol::Canopen;
        if !pattern.is_extended() && !self.devices.iter().any(is_canopen) {
            return Err(format!("'{text}': no device on the bus sends identifiers of 11 bits; accepted: 8 digits"));
        }
        Ok(pattern)
    }

    fn what(&self, device: &NamedDevice, expected: Expected) -> Result<What, String> {
        let state = match expected {
            Expected::Frame(frame) => return self.frame_to_come(&frame).map(|frame| What::Frames(vec![frame])),
            Expected::Frames(frames) if frames.is_empty() => {
                return Err("no frames; accepted: [\"720#00\", \"0A0#..\"]".to_owned());
            }
            Expected::Frames(frames) => {
                return frames
                    .iter()
                    .map(|frame| self.frame_to_come(frame))
                    .collect::<Result<_, _>>()
                    .map(What::Frames);
            }
            Expected::State(state) if state.is_empty() => {
                return Err("an empty state; accepted: any of its keys, as in { dsm = \"active\" }".to_owned());
            }
            Expected::State(state) => state,
        };
        let NamedDevice { name, setup: Setup { kind, .. }, .. } = device;
        let keys = state.clone().into_iter().map(|(key, value)| {
            let alone: Result<StateCondition, String> =
                file::table([(key.clone(), value.clone())].into_iter().collect());
            match alone {
                Ok(alone) => Ok((key, value.to_string(), alone)),
                Err(reason) if !reason.starts_with("invalid ") => Err(reason),
                Err(_) => Err(format!("{key} {value}: accepted: {}", state::accepted(&key, *kind, name, NONE))),
            }
        });
        let keys = keys.collect::<Result<_, String>>()?;
        let condition: StateCondition = file::table(state)?;
        condition.check(name, *kind, NONE).map_err(|Invalid(reason)| reason)?;
        if condition.is_always_so(name, *kind) {
            return Err(format!("every state of {name} is so; accepted: values that it does not always have"));
        }
        Ok(What::State(Wanted { device: name.clone(), condition, keys }))
    }
}

/// Returns an identifier as scenarios write it: three digits, or eight.
fn digits(id: Id) -> String {
    match id {
        Id::Standard(id) => format!("{:03X}", id.as_raw()),
        Id::Extended(id) => format!("{:08X}", id.as_raw()),
    }
}

fn within(key: &'static str) -> impl FnOnce(String) -> String {
    move |reason| format!("{key}: {reason}")
}

fn millis(ms: u32) -> Duration {
    Duration::from_millis(ms.into())
}

fn power(change: toml::Table) -> Result<Power, String> {
    let change: PowerChange = file::table(change)?;
    // The control interface has the JSON form of this message.
    let accepted = "accepted: { on = true }, { on = false } or { reset = \"watchdog\" }";
    change.power().map_err(|_| accepted.to_owned())
}

fn bit_rate(change: toml::Table) -> Result<BitRate, String> {
    let change: BusChange = file::table(change)?;
    change.bit_rate().map_err(|Invalid(reason)| reason)
}

fn disturbance(change: toml::Table) -> Result<Disturbance, String> {
    let change: Disturb = file::table(change)?;
    change.disturbance().map_err(|Invalid(reason)| reason)
}

fn period(every_ms: Option<u32>) -> Result<Option<Duration>, String> {
    match every_ms {
        Some(0) => Err("every_ms 0: accepted: 1 and more".to_owned()),
        every_ms => Ok(every_ms.map(millis)),
    }
}

fn refuse_two_acts(table: &StepTable) -> Result<(), String> {
    let acts = [
        ("send", table.send.is_some()),
        ("stop", table.stop.is_some()),
        ("plant", table.plant.is_some()),
        ("power", table.power.is_some()),
        ("bus", table.bus.is_some()),
        ("disturb", table.disturb.is_some()),
    ];
    let mut given = acts.iter().filter(|(_, is_given)| *is_given).map(|(key, _)| key);
    match (given.next(), given.next()) {
        (Some(one), Some(other)) => {
            Err(format!("{one} and {other} in one step; accepted: one of send, stop, plant, power, bus, disturb"))
        }
        _ => Ok(()),
    }
}

fn one_frame(text: &str) -> Result<Frame, String> {
    let frame = text.parse::<Pattern>().map_err(within("send"))?.frame();
    frame.ok_or_else(|| format!("send: '{text}' is no single frame; accepted: all digits, as in \"220#0F00 0020\""))
}

/// Returns the identifier of the cyclic frame to stop; `None` for all.
fn stopped(which: &Identifier) -> Result<Option<Id>, String> {
    match which {
        Identifier::Text(text) if text == "all" => Ok(None),
        _ => {
            let extended = which.needs_29_bits().then_some(true);
            let refuse = |_| format!("stop: {which} is no identifier; accepted: as in \"220\", or \"all\"");
            which.id(extended).map(Some).map_err(refuse)
        }
    }
}
