//! A checked scenario: every step can be executed.

use protocol_core::controller::BitRate;

use super::file::{self, DeviceEntry, DeviceTable, ScenarioFile};
use super::reaction::Reaction;
use super::step::Step;
use super::trial::Trial;
use super::{OWN, ReadError};
use crate::devices::{self, DeviceSpec, NamedDevice, NamedLink};
use crate::memory::Memory;
use crate::simulation::Simulation;
use crate::text::in_one_line;

/// A checked scenario.
#[derive(Debug)]
pub struct Scenario {
    pub(super) title: String,
    pub(super) devices: Vec<NamedDevice>,
    /// The device entries of the file.
    pub(super) entries: Vec<Entry>,
    links: Vec<NamedLink>,
    bit_rate: BitRate,
    /// True if a step must claim every frame from a device.
    pub(super) strict: bool,
    pub(super) reactions: Vec<Reaction>,
    pub(super) steps: Vec<Step>,
}

/// A device entry of the file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) line: usize,
    /// True if the device must run at the bit rate of the bus.
    pub(super) heard: bool,
}

impl Scenario {
    /// Parses and checks a scenario. A scenario without `expect` and `never` is an error, because it would always pass.
    ///
    /// # Errors
    /// [`ReadError`] with the line of the first error.
    pub fn parse(text: &str) -> Result<Self, ReadError> {
        let scenario =
            Self::read(text).map_err(|ReadError { line, reason }| ReadError { line, reason: in_one_line(&reason) })?;
        if scenario.steps.iter().all(|step| step.expect.is_none() && step.never.is_none()) {
            let reason = "no step has expect or never; add a step such as { expect = \"720#00\" }".to_owned();
            return Err(ReadError { line: Some(1), reason });
        }
        Ok(scenario)
    }

    /// As [`Scenario::parse`], but accepts a scenario without `expect` and `never`: in a campaign, the plan judges.
    ///
    /// # Errors
    /// [`ReadError`] with the line of the first error; the reason can have several lines.
    pub(crate) fn read(text: &str) -> Result<Self, ReadError> {
        let ScenarioFile { title, devices, links, bit_rate, allow_clash, strict, reactions, steps } = file::read(text)?;
        let at = |place: usize| move |reason: String| ReadError { line: Some(file::line_of(text, place)), reason };
        let first = devices.first().map_or(0, |device| device.span().start);
        let mut entries = Vec::new();
        let specs = devices.into_iter().map(|entry| {
            let place = entry.span().start;
            let (device, heard) = match entry.into_inner() {
                DeviceEntry::Text(device) => (device, true),
                DeviceEntry::Table(DeviceTable { device, heard }) => (device, heard.unwrap_or(true)),
            };
            entries.push(Entry { line: file::line_of(text, place), heard });
            device.parse::<DeviceSpec>().map_err(at(place))
        });
        let specs = specs.collect::<Result<Vec<_>, _>>()?;
        let mut devices = devices::named(specs).map_err(|error| at(first)(format!("{error} name=")))?;
        if devices.is_empty() {
            return Err(at(0)("no devices; add devices = [\"pvea-canopen@0x20\"]".to_owned()));
        }
        if !allow_clash {
            devices::refuse_clashes(&devices)
                .map_err(|error| at(first)(format!("{error} with @ID, or set allow_clash = true")))?;
        }
        let first = links.first().map_or(0, |link| link.span().start);
        let links = links.into_iter().map(|spec| {
            let place = spec.span().start;
            spec.into_inner().parse::<NamedLink>().map_err(at(place))
        });
        let links: Vec<NamedLink> = links.collect::<Result<_, _>>()?;
        devices::refuse_bad_links(&devices, &links).map_err(|error| at(first)(error.to_string()))?;
        // The schema accepts only known bit rates.
        let bit_rate = bit_rate.and_then(BitRate::from_bits_per_second);
        let bit_rate = devices::share_bit_rate(&mut devices, bit_rate);
        if steps.is_empty() {
            return Err(at(0)("no steps; add steps = [{ expect = \"720#00\" }]".to_owned()));
        }
        let mut scenario =
            Self { title, devices, entries, links, bit_rate, strict, reactions: Vec::new(), steps: Vec::new() };
        // The trial run refuses steps that cannot be executed.
        let mut trial = Trial::new(scenario.trial(), scenario.devices.clone(), strict);
        let places: Vec<usize> = reactions.iter().map(|reaction| reaction.span().start).collect();
        for (reaction, place) in reactions.into_iter().zip(&places) {
            scenario.reactions.push(trial.reaction(reaction.into_inner()).map_err(at(*place))?);
        }
        for step in steps {
            let line = file::line_of(text, step.span().start);
            let step = trial.check(line, step.into_inner()).map_err(|reason| ReadError { line: Some(line), reason })?;
            scenario.steps.push(step);
        }
        for (reaction, place) in scenario.reactions.iter().zip(&places) {
            trial.check_stop(reaction).map_err(at(*place))?;
        }
        refuse_unwatched(&scenario.steps)?;
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

    /// Creates a simulation with the unpowered devices and the sender of the steps.
    pub(crate) fn trial(&self) -> Simulation {
        let mut simulation = self.simulation(0);
        simulation.send_as(OWN);
        simulation
    }

    /// Creates a simulation with the unpowered devices.
    pub(crate) fn simulation(&self, seed: u64) -> Simulation {
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

/// Refuses a `never` after which no time passes, because such a `never` would check at most one instant.
fn refuse_unwatched(steps: &[Step]) -> Result<(), ReadError> {
    // The scenario continues until every `never` with a duration has ended.
    if steps.iter().any(|step| step.never.as_ref().is_some_and(|never| never.span.is_some())) {
        return Ok(());
    }
    let last = steps.iter().rposition(Step::can_take_time).unwrap_or(0);
    let Some((place, step)) = steps.iter().enumerate().skip(last).find(|(_, step)| step.never.is_some()) else {
        return Ok(());
    };
    let reason = if place + 1 == steps.len() {
        "never: the scenario ends with this step; add for_ms, or a later step"
    } else {
        "never: no time passes in the later steps; add for_ms, or a later step that takes time"
    };
    Err(ReadError { line: Some(step.line), reason: reason.to_owned() })
}
