//! The checked plan of a campaign.

use std::num::NonZeroU32;

use protocol_core::time::Duration;
use toml::{Table, Value};

use super::fault::{self, PlanFault};
use super::file::{self, At, Instants, PlanFile, ReadySet};
use super::oracle::{Oracle, Proof, SafeState};
use super::verdict::Limits;
use crate::scenario::file::{line_at, table};
use crate::scenario::{OWN, ReadError, Scenario};
use crate::state::schema::Place;
use crate::text::in_one_line;

/// The maximum number of grid cells.
pub const MAX_CELLS: u64 = 10_000_000;

/// A checked plan, whose faults and oracles suit the devices of its scenario.
#[derive(Debug)]
pub struct Plan {
    title: String,
    path: String,
    /// The texts of the plan and of its scenario.
    pub(super) texts: (String, String),
    controller: Option<Vec<String>>,
    speed: f64,
    pub(super) scenario: Scenario,
    pub(super) seeds: Vec<u64>,
    pub(super) faults: Vec<Entry>,
    pub(super) grid: Grid,
    pub(super) detected: Option<Oracle<Proof>>,
    pub(super) safe: Option<Oracle<SafeState>>,
    pub(super) observe: Duration,
}

/// A checked entry of `faults`.
#[derive(Debug)]
pub(super) enum Entry {
    Own(Vec<PlanFault>),
    /// The communication errors, on identifiers from the golden runs.
    Communication,
}

/// The instants of the faults.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub(super) from_ms: u32,
    pub(super) to_ms: u32,
    /// The interval between consecutive instants; `None` for instants at the ends of frames.
    pub(super) step_ms: Option<NonZeroU32>,
}

impl Grid {
    /// Returns the number of instants; `None` for instants at the ends of frames.
    pub(super) fn len(&self) -> Option<u64> {
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
            let scenario = Scenario::parse(&text).map_err(|ReadError { line, reason }| {
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
        let grid = grid(&instants).map_err(at("instants"))?;
        let devices = scenario.devices();
        let detected = detected.map(|it| it.check(devices).map_err(at("detected"))).transpose()?;
        let safe = safe.map(|it| it.check(devices).map_err(at("safe"))).transpose()?;
        let limits = [detected.as_ref().map(|it| it.within), safe.as_ref().map(|it| it.within)];
        let Some(longest) = limits.into_iter().flatten().max() else {
            let reason =
                "a plan needs detected, safe, or both, as in safe = { expect = { position = 0 }, within_ms = 1000 }";
            return Err((Vec::new(), reason.to_owned()));
        };
        let dwell = safe.as_ref().and_then(|it| it.what.span).map_or(longest, |span| longest + span);
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
        let faults = entries(faults, &scenario, grid.len().unwrap_or(1) * seeds.len() as u64)?;
        Ok(Self { title, path, texts, controller, speed, scenario, seeds, faults, grid, detected, safe, observe })
    }

    /// Returns the title.
    #[must_use]
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Returns the path of the scenario, relative to the plan.
    #[must_use]
    pub fn scenario(&self) -> &str {
        &self.path
    }

    /// Returns the controller program and its arguments; `None` if the plan has no program.
    #[must_use]
    pub fn controller(&self) -> Option<&[String]> {
        self.controller.as_deref()
    }

    /// Returns the speed of virtual time relative to wall time for [`controller`](Self::controller).
    #[must_use]
    pub const fn speed(&self) -> f64 {
        self.speed
    }

    /// Returns the limits of the oracles.
    #[must_use]
    pub fn limits(&self) -> Limits {
        Limits {
            detected: self.detected.as_ref().map(|oracle| oracle.within),
            safe: self.safe.as_ref().map(|oracle| oracle.within),
        }
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

fn grid(instants: &Instants) -> Result<Grid, String> {
    let Instants { from_ms, to_ms, step_ms, at } = *instants;
    if from_ms > to_ms {
        return Err(format!("from_ms {from_ms} is after to_ms {to_ms}"));
    }
    let step_ms = match (step_ms, at) {
        (Some(step), None) => NonZeroU32::new(step),
        (None, Some(At::EachFrame)) => None,
        _ => return Err("give either step_ms = 10 or at = \"each frame\"".to_owned()),
    };
    Ok(Grid { from_ms, to_ms, step_ms })
}

/// Checks the faults of a plan. `cells` is the minimum number of cells of one fault.
fn entries(faults: Vec<Value>, scenario: &Scenario, cells: u64) -> Result<Vec<Entry>, Refused> {
    if faults.is_empty() {
        return Err(at("faults")("empty list; give at least one fault, as in [\"all-of-pve\"]".to_owned()));
    }
    let mut trial = scenario.simulation(0);
    trial.send_as(OWN);
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
                if let Some(key) = fault::without_value(&entry) {
                    return Err(refuse(format!("{key}: empty list; give at least one value")));
                }
                add(fault::count(&entry))?;
                fault::combinations(&entry)
            }
            word => match table::<Word>([("word".to_owned(), word)].into_iter().collect()).map_err(refuse)?.word {
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

/// A wrapper that lets [`table`], which deserialises only tables, read the name of a predefined fault set.
#[derive(serde::Deserialize)]
struct Word {
    word: ReadySet,
}
