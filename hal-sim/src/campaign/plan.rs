//! The checked plan of a campaign.

use protocol_core::time::{Duration, Instant};
use toml::{Table, Value};

use super::fault::{self, PlanFault};
use super::file::{self, Instants, PlanFile, ReadySet};
use super::oracle::{Proof, SafeState};
use super::verdict::Limits;
use crate::scenario::file::line_at;
use crate::scenario::{ReadError, Scenario};
use crate::state::schema::Place;
use crate::text::in_one_line;

/// The maximum number of grid cells.
pub const MAX_CELLS: u64 = 10_000_000;

/// A checked plan, whose faults and oracles suit the devices of its scenario.
#[derive(Debug)]
pub struct Plan {
    title: String,
    pub(super) path: String,
    /// The texts of the plan and of its scenario.
    pub(super) texts: (String, String),
    /// The controller program with its arguments, and the speed of virtual time relative to wall time.
    controller: Option<(Vec<String>, f64)>,
    pub(super) scenario: Scenario,
    pub(super) seeds: Vec<u64>,
    pub(super) faults: Vec<Entry>,
    pub(super) instants: Instants,
    pub(super) detected: Option<Proof>,
    pub(super) safe: Option<SafeState>,
    pub(super) limits: Limits,
    pub(super) observe: Duration,
}

/// A checked entry of `faults`.
#[derive(Debug)]
pub(super) enum Entry {
    Own(Vec<PlanFault>),
    /// The communication errors, on identifiers from the golden runs.
    Communication,
}

impl Instants {
    fn check(&self) -> Result<(), String> {
        let Self { from_ms, to_ms, step_ms, at } = self;
        if from_ms > to_ms {
            return Err(format!("from_ms {from_ms} is after to_ms {to_ms}"));
        }
        if step_ms.is_some() == at.is_some() {
            return Err("give either step_ms = 10 or at = \"each frame\"".to_owned());
        }
        Ok(())
    }

    /// Returns the first instant.
    pub(super) fn begin(&self) -> Instant {
        Instant::from_millis(self.from_ms.into())
    }

    /// Returns the number of instants; `None` for instants at the ends of frames.
    fn len(&self) -> Option<u64> {
        self.step_ms.map(|step| u64::from((self.to_ms - self.from_ms) / step) + 1)
    }
}

/// The place of an error in a plan, and its reason.
type Refused = (Vec<Place>, String);

impl Plan {
    /// Parses and checks a plan. `read` is called with the scenario path as written in the plan, and returns the text
    /// of that file.
    ///
    /// # Errors
    /// [`ReadError`] with the line of the first error.
    pub fn parse(text: &str, read: impl FnOnce(&str) -> Result<String, String>) -> Result<Self, ReadError> {
        let in_line = |ReadError { line, reason }| ReadError { line, reason: in_one_line(&reason) };
        let file = file::read(text).map_err(in_line)?;
        let refuse = |(path, reason): Refused| in_line(ReadError { line: Some(line_at(text, &path)), reason });
        let scenario = read(&file.scenario).and_then(|text| {
            let scenario = Scenario::read(&text).map_err(|ReadError { line, reason }| {
                let line = line.map_or_else(String::new, |line| format!("{line}: "));
                format!("{}:{line}{reason}", file.scenario)
            });
            Ok((scenario?, text))
        });
        let (scenario, steps) = scenario.map_err(|reason| refuse(at("scenario")(reason)))?;
        Self::check(file, scenario, (text.to_owned(), steps)).map_err(refuse)
    }

    fn check(file: PlanFile, scenario: Scenario, texts: (String, String)) -> Result<Self, Refused> {
        let PlanFile { title, scenario: path, seeds, faults, instants, detected, safe, observe_ms, controller, speed } =
            file;
        let seeds = seeds.unwrap_or_else(|| vec![1]);
        if seeds.is_empty() {
            return Err(at("seeds")("empty list; give at least one seed, as in [1]".to_owned()));
        }
        if let Some(seed) =
            seeds.iter().enumerate().find_map(|(place, seed)| seeds[..place].contains(seed).then_some(seed))
        {
            return Err(at("seeds")(format!("{seed} is given twice; each run needs a seed of its own")));
        }
        if controller.as_ref().is_some_and(Vec::is_empty) {
            let reason = "empty list; give a program and its arguments, as in [\"python3\", \"ctl.py\", \"{bus}\"]";
            return Err(at("controller")(reason.to_owned()));
        }
        if speed.is_some() && controller.is_none() {
            return Err(at("speed")("only valid together with controller".to_owned()));
        }
        let speed = speed.unwrap_or(1.0);
        if !(speed.is_finite() && speed > 0.0) {
            return Err(at("speed")("must be a number above 0, as in 1 or 0.5".to_owned()));
        }
        let controller = controller.map(|words| (words, speed));
        instants.check().map_err(at("instants"))?;
        let devices = scenario.devices();
        let detected = detected.map(|it| it.check(devices).map_err(at("detected"))).transpose()?;
        let safe = safe.map(|it| it.check(devices).map_err(at("safe"))).transpose()?;
        let (detected, detected_within) = detected.unzip();
        let (safe, safe_within) = safe.unzip();
        let limits = Limits { detected: detected_within, safe: safe_within };
        let Some(longest) = limits.detected.max(limits.safe) else {
            let reason =
                "a plan needs detected, safe, or both, as in safe = { expect = { position = 0 }, within_ms = 1000 }";
            return Err((Vec::new(), reason.to_owned()));
        };
        let dwell = safe.as_ref().and_then(|it| it.span).map_or(longest, |span| longest + span);
        let observe = observe_ms.map_or(longest * 3, |ms| Duration::from_millis(ms.into()));
        if observe < dwell || observe.as_ticks() == 0 {
            let key = if observe_ms.is_some() { "observe_ms" } else { "safe" };
            let reason = format!(
                "the observation of {} ms ends before the last limit; give observe_ms of at least {}",
                observe.as_millis(),
                dwell.as_millis().max(1)
            );
            return Err(at(key)(reason));
        }
        let faults = entries(faults, &scenario, instants.len().unwrap_or(1) * seeds.len() as u64)?;
        Ok(Self { title, path, texts, controller, scenario, seeds, faults, instants, detected, safe, limits, observe })
    }

    /// Returns the title.
    #[must_use]
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Returns the controller program with its arguments, and the speed of virtual time relative to wall time; `None` if
    /// the plan has no program.
    #[must_use]
    pub fn controller(&self) -> Option<(&[String], f64)> {
        self.controller.as_ref().map(|(words, speed)| (words.as_slice(), *speed))
    }

    /// Returns the limits of the oracles.
    #[must_use]
    pub const fn limits(&self) -> Limits {
        self.limits
    }

    /// Returns the observation time after the fault.
    #[must_use]
    pub const fn observe(&self) -> Duration {
        self.observe
    }

    /// Returns the seeds.
    #[must_use]
    pub fn seeds(&self) -> &[u64] {
        &self.seeds
    }

    /// Replaces the seeds with one seed.
    #[must_use]
    pub fn with_seed(self, seed: u64) -> Self {
        Self { seeds: vec![seed], ..self }
    }
}

/// Returns a function that places a reason at a key of the plan.
fn at(key: &'static str) -> impl Fn(String) -> Refused {
    move |reason| (vec![Place::Key(key.to_owned())], format!("{key}: {reason}"))
}

/// Checks the faults of a plan. `cells` is the minimum number of cells of one fault.
fn entries(faults: Vec<Value>, scenario: &Scenario, cells: u64) -> Result<Vec<Entry>, Refused> {
    if faults.is_empty() {
        return Err(at("faults")("empty list; give at least one fault, as in [\"all-of-pve\"]".to_owned()));
    }
    let trial = scenario.trial();
    let mut total: u64 = 0;
    let mut entries = Vec::new();
    for (place, entry) in faults.into_iter().enumerate() {
        let refuse = |reason: String| (vec![Place::Key("faults".to_owned()), Place::Item(place)], reason);
        let mut add = |faults: u64| {
            total = total.saturating_add(faults.saturating_mul(cells));
            refuse_more(total).map_err(refuse)
        };
        let tables: Vec<Table> = match entry {
            Value::Table(entry) => {
                let lists = fault::lists(&entry);
                if let Some((key, _)) = lists.iter().find(|(_, length)| *length == 0) {
                    return Err(refuse(format!("{key}: empty list; give at least one value")));
                }
                add(lists.iter().fold(1, |faults, (_, length)| faults.saturating_mul(*length)))?;
                fault::combinations(&entry)
            }
            word => match word.try_into().map_err(|error| refuse(error.to_string()))? {
                ReadySet::AllOfPve => {
                    let tables = fault::all_of_pve(scenario.devices()).map_err(refuse)?;
                    add(tables.len() as u64)?;
                    tables
                }
                ReadySet::Communication => {
                    // At least one identifier.
                    add(fault::LEAST_ERRORS)?;
                    entries.push(Entry::Communication);
                    continue;
                }
            },
        };
        let faults = tables.into_iter().map(|entry| PlanFault::check(entry, scenario.devices(), &trial));
        entries.push(Entry::Own(faults.collect::<Result<_, _>>().map_err(refuse)?));
    }
    Ok(entries)
}

/// Refuses more than [`MAX_CELLS`] cells.
pub(super) fn refuse_more(cells: u64) -> Result<(), String> {
    if cells <= MAX_CELLS {
        return Ok(());
    }
    Err(format!(
        "the plan has at least {cells} cells, more than {MAX_CELLS}; give fewer faults, values, seeds or instants"
    ))
}
