//! Writes a find as a scenario: the steps up to the faults, the faults, the later actions, and expectations for the
//! oracles that the pair breaks.

use std::fmt::Write as _;

use protocol_core::time::{Duration, Instant};
use toml::{Table, Value};

use super::pair::{Failing, Pair, Timed};
use crate::campaign::oracle::Proof;
use crate::campaign::plan::Plan;
use crate::campaign::verdict::Verdict;
use crate::scenario::Scenario;
use crate::state::digits;
use crate::text::in_one_line;

/// Returns a scenario for a pair that fails; `None` if there is none. The scenario fails only in the expectations that
/// stand for the oracles. The scenario passes with one fault alone if the verdict on this fault alone is
/// [`Verdict::Safe`].
pub(super) fn scenario(plan: &Plan, seed: u64, pair: &Pair, failing: &Failing) -> Option<String> {
    let document: Table = toml::from_str(&plan.texts.1).ok()?;
    let run = |without: Option<usize>| {
        let text = Text::of(plan, &document, pair, failing, without)?;
        let outcome = Scenario::parse(&text.text).ok()?.run(seed);
        Some((text, outcome))
    };
    let (text, outcome) = run(None)?;
    if outcome.is_success() || !outcome.lines().all(|line| text.checks.contains(&line)) {
        return None;
    }
    for (alone, verdict) in failing.singles.iter().enumerate() {
        if *verdict == Verdict::Safe && !run(Some(1 - alone))?.1.is_success() {
            return None;
        }
    }
    Some(text.text)
}

/// A scenario, and the numbers of the lines with expectations that stand for the oracles.
struct Text {
    text: String,
    checks: Vec<usize>,
}

/// A step at an instant. Steps at the same instant are in the order of their parts.
struct Item {
    at_ms: u64,
    part: Part,
    step: Table,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Fault,
    Check,
    Own,
}

/// The keys of a step that form its expectation or prohibition.
const EXPECTATION: [&str; 6] = ["expect", "any_order", "within_ms", "never", "for_ms", "since_ms"];

impl Text {
    /// Writes the scenario of a pair, without the fault at index `without`, if any.
    fn of(plan: &Plan, document: &Table, pair: &Pair, failing: &Failing, without: Option<usize>) -> Option<Self> {
        let [first, second] = failing.singles;
        let mut text = format!(
            "# Found by pve-sim campaign --explore. The first fault alone: {first}. The second fault alone: {second}.\n"
        );
        let title = in_one_line(&format!("{}: {}", failing.verdict, pair.text()));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "title = {}", Value::from(title));
        let (mut own, mut items) = (Vec::new(), checks(plan, pair, failing)?);
        for (place, timed) in pair.faults.iter().enumerate().filter(|(place, _)| Some(*place) != without) {
            items.extend(fault(place, timed));
        }
        for (key, value) in document.iter().filter(|(key, _)| !matches!(key.as_str(), "title" | "strict")) {
            match (key.as_str(), value) {
                ("steps", Value::Array(steps)) => own = steps.iter().filter_map(Value::as_table).cloned().collect(),
                ("reactions", Value::Array(rules)) => write_list(&mut text, key, rules),
                _ => {
                    let _ = writeln!(text, "{key} = {value}");
                }
            }
        }
        let mut steps: Vec<(bool, Table)> = Vec::new();
        for (place, (step, at)) in own.into_iter().zip(&failing.acted).enumerate() {
            let step = shortened(step, place < failing.completed, *at, pair.begin());
            if place <= failing.completed && *at <= pair.begin() {
                steps.push((false, step));
            } else if step.keys().any(|key| !matches!(key.as_str(), "at_ms" | "after_ms" | "note")) {
                let step = step.into_iter().filter(|(key, _)| !matches!(key.as_str(), "at_ms" | "after_ms"));
                items.push(Item { at_ms: at.as_millis(), part: Part::Own, step: step.collect() });
            }
        }
        let last = items.iter().filter(|item| item.part == Part::Check).map(|item| item.at_ms).max()?;
        items.retain(|item| item.at_ms <= last);
        items.sort_by_key(|item| (item.at_ms, item.part));
        let mut now = None;
        for Item { at_ms, part, mut step } in items {
            // An own action takes time, so that a second one at the same millisecond begins at once.
            if part != Part::Own || now.is_none_or(|now| now < at_ms) {
                step.insert("at_ms".to_owned(), integer(at_ms));
            }
            now = Some(at_ms);
            steps.push((part == Part::Check, step));
        }
        let first = text.lines().count() + 2;
        let checks = steps.iter().enumerate().filter(|(_, (is_check, _))| *is_check);
        let checks = checks.map(|(place, _)| first + place).collect();
        let steps: Vec<Value> = steps.into_iter().map(|(_, step)| Value::Table(step)).collect();
        write_list(&mut text, "steps", &steps);
        Some(Self { text, checks })
    }
}

/// Writes a list with one item in each line.
fn write_list(text: &mut String, key: &str, items: &[Value]) {
    let _ = writeln!(text, "{key} = [");
    for item in items {
        let _ = writeln!(text, "  {item},");
    }
    text.push_str("]\n");
}

/// Returns a step for the written scenario. Drops expectations that the fault may break: those of a step that is not
/// over at the first fault, and a prohibition that reaches beyond the first fault.
fn shortened(mut step: Table, is_over: bool, acted: Instant, fault: Instant) -> Table {
    if let Some(note) = step.get_mut("note") {
        *note = in_one_line(note.as_str().unwrap_or_default()).into();
    }
    let never = step.get("for_ms").and_then(Value::as_integer).and_then(|ms| u64::try_from(ms).ok());
    let ends = never.is_some_and(|ms| acted.as_millis() + ms < fault.as_millis());
    if !is_over || (step.contains_key("never") && !ends) {
        step.retain(|key, _| !EXPECTATION.contains(&key));
    }
    if !step.contains_key("send") {
        // The period of an expected frame, which only a strict scenario has.
        step.remove("every_ms");
    }
    if !["expect", "never", "plant", "power"].iter().any(|key| step.contains_key(*key)) {
        step.remove("device");
    }
    step
}

/// Returns the steps that inject a fault.
fn fault(place: usize, Timed { fault, at_ms }: &Timed) -> Vec<Item> {
    let mut entry = fault.entry.clone();
    let note = ["the first fault", "the second fault"][place];
    let mut ends = None;
    let mut step = Table::new();
    if let Some(device) = fault.device() {
        let lasts = entry.remove("for_ms");
        step.extend(entry);
        if let (Some(Value::Table(plant)), Some(lasts)) = (step.get_mut("plant"), lasts) {
            plant.insert("for_ms".to_owned(), lasts);
        }
        if let Some(off_for) = fault.off_for {
            let on = Value::Table(Table::from_iter([("on".to_owned(), true.into())]));
            let on = [("device".to_owned(), device.into()), ("power".to_owned(), on)];
            ends = Some((u64::from(*at_ms) + off_for.as_millis(), Table::from_iter(on)));
        }
    } else {
        step.insert("fault".to_owned(), Value::Table(entry));
    }
    step.insert("note".to_owned(), note.into());
    let item = |(at_ms, step)| Item { at_ms, part: Part::Fault, step };
    [(u64::from(*at_ms), step)].into_iter().chain(ends).map(item).collect()
}

/// Returns the oracles that the pair breaks, as expectations at the instants of their limits.
fn checks(plan: &Plan, pair: &Pair, Failing { observed, .. }: &Failing) -> Option<Vec<Item>> {
    let document: Table = toml::from_str(&plan.texts.0).ok()?;
    let is_broken = |limit: Duration, held: Option<Duration>| held.is_none_or(|held| held > limit);
    let [first, second] = pair.faults.each_ref().map(|fault| u64::from(fault.at_ms));
    let mut checks = Vec::new();
    let mut check = |at_ms: u64, note: &str, keys: &[(&str, Value)]| {
        let mut step: Table = keys.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect();
        step.insert("note".to_owned(), note.into());
        checks.push(Item { at_ms, part: Part::Check, step });
    };
    let now = ("within_ms", Value::from(0));
    let device = |oracle: &Table| oracle.get("device").map(|name| ("device", name.clone()));
    let detected = plan.detected.as_ref().zip(plan.limits.detected);
    if let Some((proof, within)) = detected.filter(|(_, within)| is_broken(*within, observed.detected)) {
        let limit = second + within.as_millis();
        let keys = document.get("detected")?.as_table()?;
        match (proof, keys.get("expect")) {
            (Proof::Stops(id, span), _) => {
                let begin = limit.saturating_sub(span.as_millis());
                let keys = [
                    ("never", digits(*id).into()),
                    ("since_ms", integer(begin)),
                    ("for_ms", integer(span.as_millis())),
                ];
                check(begin, "detected", &keys);
            }
            (Proof::Frames(_), Some(frames)) => {
                check(limit, "detected", &[("expect", frames.clone()), ("since_ms", integer(first)), now.clone()]);
            }
            (Proof::State(_), Some(state)) => {
                let keys: Vec<_> = [("expect", state.clone()), now.clone()].into_iter().chain(device(keys)).collect();
                check(limit, "detected", &keys);
            }
            _ => return None,
        }
    }
    let safe = plan.safe.as_ref().zip(plan.limits.safe);
    if let Some((state, within)) = safe.filter(|(_, within)| is_broken(*within, observed.safe)) {
        let limit = second + within.as_millis();
        let end = state.span.map_or(second + plan.observe.as_millis(), |span| limit + span.as_millis());
        let keys = document.get("safe")?.as_table()?;
        let keys: Vec<_> = [("expect", keys.get("expect")?.clone()), now].into_iter().chain(device(keys)).collect();
        check(limit, "safe", &keys);
        check(end, "still safe", &keys);
    }
    Some(checks)
}

fn integer(number: u64) -> Value {
    i64::try_from(number).unwrap_or(i64::MAX).into()
}
