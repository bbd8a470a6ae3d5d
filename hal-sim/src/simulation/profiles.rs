//! Plant changes over time: temporary changes, and profiles of a numeric plant word.

use protocol_core::device::plant::WORDS;
use protocol_core::time::{Duration, Instant, NEVER, after, since};

use super::command::Refusal;
use crate::state::{PlantChange, PlantState, Profile};
use crate::world::{Change, NodeId, World};

/// The interval between the values of an interpolated profile (A).
pub const RAMP_STEP: Duration = Duration::from_millis(1);

/// The maximum number of changes in progress.
const MAX_PROFILES: usize = 64;

/// Points of a profile: times and values.
type Points = Vec<(Instant, i32)>;

/// The changes in progress.
#[derive(Clone, Debug, Default)]
pub(super) struct Profiles(Vec<InProgress>);

#[derive(Clone, Debug)]
struct InProgress {
    node: NodeId,
    /// The plant words that the change affects.
    words: Vec<&'static str>,
    next: Instant,
    end: Instant,
    course: Course,
}

#[derive(Clone, Debug)]
enum Course {
    /// The earlier values, restored at the end.
    Earlier(Box<PlantChange>),
    /// The remaining points of a profile. With steps, the values between the points are not interpolated.
    Points { points: Points, has_steps: bool },
}

impl Profiles {
    /// Starts a plant change: applies the current values and schedules the remaining values.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed.
    pub(super) fn begin(&mut self, node: NodeId, change: &PlantChange, world: &mut World) -> Result<(), Refusal> {
        let now = world.now();
        let mut words = change.words();
        let profile = change.profile.as_ref().map(|profile| points(profile, now)).transpose();
        let profile = profile.map_err(Refusal::Invalid)?;
        if let Some((word, _)) = &profile {
            if words.contains(word) || change.for_ms.is_some() {
                let reason = format!("profile of {word}: not valid together with for_ms or a value of {word}");
                return Err(Refusal::Invalid(reason));
            }
            words.push(word);
        }
        if change.for_ms.is_some() && words.is_empty() {
            return Err(Refusal::Invalid("for_ms is only valid together with a change".to_owned()));
        }
        let busy =
            self.0.iter().find(|other| other.node == node && other.words.iter().any(|word| words.contains(word)));
        if let Some(InProgress { words: busy, end, .. }) = busy {
            let until = since(*end, Instant::from_ticks(0)).as_millis();
            let word = busy.iter().find(|word| words.contains(word)).copied().unwrap_or_default();
            let reason = format!("{word} of {} is already changing until {until} ms", world.name(node));
            return Err(Refusal::Conflict(reason));
        }
        if self.0.len() >= MAX_PROFILES && (change.for_ms.is_some() || profile.is_some()) {
            return Err(Refusal::TooMany("64 plant changes are already in progress"));
        }
        if let Some((word, points)) = &profile {
            let plants: Vec<Change> = points.iter().filter_map(|(_, value)| plant(word, *value)).collect();
            world.check_plants(node, &plants)?;
        }
        let earlier = change.for_ms.map(|_| change.earlier(&PlantState::of(node, world)));
        change.make(node, world)?;
        if let (Some(ms), Some(earlier)) = (change.for_ms, earlier) {
            let end = after(now, Duration::from_millis(ms.into()));
            let course = Course::Earlier(Box::new(earlier));
            self.0.push(InProgress { node, words, next: end, end, course });
        }
        if let (Some((word, points)), Some(profile)) = (profile, &change.profile) {
            let end = points.last().map_or(now, |(at, _)| *at);
            let course = Course::Points { points, has_steps: profile.steps };
            self.0.push(InProgress { node, words: vec![word], next: now, end, course });
            self.poll(world);
        }
        Ok(())
    }

    /// Returns the time at which the next value is due.
    pub(super) fn due(&self) -> Instant {
        self.0.iter().map(|change| change.next).min().unwrap_or(NEVER)
    }

    /// Applies all values that are due.
    pub(super) fn poll(&mut self, world: &mut World) {
        let now = world.now();
        self.0.retain_mut(|change| {
            if change.next > now {
                return true;
            }
            change.apply(now, world);
            change.end > now
        });
    }

    /// Ends the changes in progress. The plants keep their current values.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

impl InProgress {
    /// Applies the current value and schedules the next value.
    fn apply(&mut self, now: Instant, world: &mut World) {
        let change = match &self.course {
            Course::Earlier(earlier) => (**earlier).clone(),
            Course::Points { points, has_steps } => {
                let place = points.partition_point(|(at, _)| *at <= now);
                let last = place.checked_sub(1).and_then(|place| points.get(place)).copied();
                let next = points.get(place).copied();
                self.next = next.map_or(NEVER, |(at, _)| match last {
                    Some((_, value)) if !*has_steps && next.is_some_and(|(_, next)| next != value) => {
                        at.min(after(now, RAMP_STEP))
                    }
                    _ => at,
                });
                let value = match (last, next) {
                    (Some(last), Some(next)) if !*has_steps => between(last, next, now),
                    (Some((_, value)), _) => value,
                    (None, _) => return,
                };
                let plant = self.words.first().and_then(|word| plant(word, value));
                plant.map(PlantChange::from).unwrap_or_default()
            }
        };
        // The change fails if the shaft was linked in the meantime; the value is then not applied.
        let _ = change.make(self.node, world);
    }
}

/// Returns the plant change that sets a numeric word to a value.
fn plant(word: &str, value: i32) -> Option<Change> {
    Change::parse(word, &value.to_string())
}

/// Interpolates between two points.
fn between((begin, from): (Instant, i32), (end, to): (Instant, i32), now: Instant) -> i32 {
    let (passed, whole) = (since(now, begin).as_ticks(), since(end, begin).as_ticks().max(1));
    let change = (i128::from(to) - i128::from(from)) * i128::from(passed) / i128::from(whole);
    (i128::from(from) + change) as i32
}

/// Returns the plant word and the points of a profile that starts now.
fn points(profile: &Profile, now: Instant) -> Result<(&'static str, Points), String> {
    let ranged = || WORDS.iter().filter_map(|word| Some((word, word.values.range()?)));
    let Some((word, (min, max))) = ranged().find(|(word, _)| word.name == profile.word) else {
        let known = ranged().map(|(word, _)| word.name).collect::<Vec<_>>().join(", ");
        return Err(format!("'{}' cannot have a profile; accepted: {known}", profile.word));
    };
    let given = profile.points();
    if given.is_empty() {
        return Err(format!("profile of {} has no points; accepted: at least one", word.name));
    }
    if let Some(pair) = given.windows(2).find(|pair| pair[1][0] <= pair[0][0]) {
        let [before, at] = [pair[0][0], pair[1][0]];
        return Err(format!("profile of {}: {at} ms after {before} ms; times must increase", word.name));
    }
    let point = |[ms, value]: [i64; 2]| {
        let value = i32::try_from(value)
            .ok()
            .filter(|value| (min..=max).contains(value))
            .ok_or_else(|| format!("profile of {}: {value} is out of range; accepted: {}", word.name, word.values))?;
        let ms = u64::try_from(ms)
            .ok()
            .filter(|ms| *ms <= Profile::MAX_MS)
            .ok_or_else(|| format!("profile of {}: {ms} ms must be from 0 to {}", word.name, Profile::MAX_MS))?;
        Ok((after(now, Duration::from_millis(ms)), value))
    };
    Ok((word.name, given.into_iter().map(point).collect::<Result<_, String>>()?))
}

#[cfg(test)]
#[path = "profiles_tests.rs"]
mod tests;
