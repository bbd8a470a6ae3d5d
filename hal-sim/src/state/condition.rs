//! Conditions to wait for: a subset of a device's state, or a frame.

use std::ops::RangeInclusive;

use protocol_core::time::{Duration, Instant, NEVER, after};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::Invalid;
use super::device::{Color, Command, DeviceState, DeviceStateMachine, Led, Nmt, SetPointValue};
use super::{BitsPerSecond, Pattern, possible};
use crate::Kind;
use crate::world::{NodeId, World};

/// A condition that a command waits for.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Condition {
    /// The named device is in a state that matches.
    State(String, Box<StateCondition>),
    /// A frame that matches the pattern is sent.
    Frame(Pattern),
    /// The controller that sends the frames of commands receives a frame. Each received frame counts once, in order,
    /// from the start of the simulation. A frame that a communication fault loses for all receivers does not count.
    Received,
}

/// A condition on any subset of a device state. Scalars must be equal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StateCondition {
    /// The instant, in microseconds of virtual time.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(maximum = 9223372036854775807_i64)]
    pub t_us: Option<u64>,
    /// The name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The kind.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// The node ID or address.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<u8>, maximum = 255)]
    pub node_id: Option<Option<u8>>,
    /// The bit rate.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<BitsPerSecond>)]
    pub bit_rate: Option<Option<u32>>,
    /// Whether the device has power and has booted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub powered: Option<bool>,
    /// The NMT state.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Nmt>)]
    pub nmt: Option<Option<Nmt>>,
    /// The device state machine.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<DeviceStateMachine>)]
    pub dsm: Option<Option<DeviceStateMachine>>,
    /// The state of the auxiliary valve.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Command>)]
    pub command: Option<Option<Command>>,
    /// The set-point, or its limits.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<SetPointCondition>)]
    pub set_point: Option<Option<SetPointCondition>>,
    /// The position, or its limits.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<PositionCondition>)]
    pub position: Option<Option<PositionCondition>>,
    /// Whether the solenoids are energised.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<bool>)]
    pub solenoids: Option<Option<bool>>,
    /// The LED: its colour, whether it flashes, or both.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<LedCondition>)]
    pub led: Option<Option<LedCondition>>,
    /// The exact set of active faults, by name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub faults: Option<Vec<String>>,
}

/// A set-point, or its limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged, expecting = "accepted: -16384 to 16384, \"float\", or {\"min\", \"max\"}")]
pub enum SetPointCondition {
    /// An exact value.
    Equal(SetPointValue),
    /// A value within limits; float never matches.
    Within(Limits),
}

/// A position, or its limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(untagged, expecting = "accepted: -16384 to 16384, or {\"min\", \"max\"}")]
pub enum PositionCondition {
    /// An exact value.
    Equal(i16),
    /// A value within limits.
    Within(Limits),
}

/// Inclusive limits. A missing limit does not restrict.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// The lower limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = -16384, maximum = 16384)]
    pub min: Option<i16>,
    /// The upper limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(minimum = -16384, maximum = 16384)]
    pub max: Option<i16>,
}

/// The LED: its colour, whether it flashes, or both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LedCondition {
    /// The colour.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<Color>,
    /// Whether the LED flashes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flashing: Option<bool>,
}

/// Deserialises a value that may be null; null differs from a missing key.
fn present<'de, D: Deserializer<'de>, T: Deserialize<'de>>(value: D) -> Result<Option<Option<T>>, D::Error> {
    Option::deserialize(value).map(Some)
}

impl StateCondition {
    /// Refuses a condition that can never hold for a device of this kind and name. `none` is the word for null in
    /// messages.
    ///
    /// # Errors
    /// A message with the key and its possible values.
    pub fn check(&self, name: &str, kind: Kind, none: &str) -> Result<(), Invalid> {
        let known = kind.fault_names();
        if let Some(fault) = self.faults.iter().flatten().find(|fault| !known.contains(&fault.as_str())) {
            return Err(Invalid(format!("'{fault}' is not a fault of {name}; accepted: {}", known.join(", "))));
        }
        possible::check(&self.keys(), kind, name, none).map_err(Invalid)
    }

    /// Returns whether the condition always holds for a device of this kind and name.
    pub fn is_always_so(&self, name: &str, kind: Kind) -> bool {
        possible::is_always_so(&self.keys(), kind, name)
    }

    /// Returns the keys of the condition with their values.
    pub(crate) fn keys(&self) -> Vec<(String, Value)> {
        match serde_json::to_value(self) {
            Ok(Value::Object(keys)) => keys.into_iter().collect(),
            _ => Vec::new(),
        }
    }

    /// Returns whether a state satisfies the condition.
    pub fn holds(&self, state: &DeviceState) -> bool {
        is(self.t_us.as_ref(), &state.t_us)
            && is(self.name.as_ref(), &state.name)
            && self.kind.as_ref().is_none_or(|kind| kind == state.kind)
            && is(self.node_id.as_ref(), &state.node_id)
            && is(self.bit_rate.as_ref(), &state.bit_rate)
            && is(self.powered.as_ref(), &state.powered)
            && is(self.nmt.as_ref(), &state.nmt)
            && is(self.dsm.as_ref(), &state.dsm)
            && is(self.command.as_ref(), &state.command)
            && fits(self.set_point.as_ref(), state.set_point.as_ref(), SetPointCondition::holds)
            && fits(self.position.as_ref(), state.position.as_ref(), |it, at| it.range().contains(at))
            && is(self.solenoids.as_ref(), &state.solenoids)
            && fits(self.led.as_ref(), state.led.as_ref(), LedCondition::holds)
            && self.faults.as_ref().is_none_or(|wanted| are_active(wanted, state))
    }

    /// Returns a text that lists the keys that a state does not satisfy, each with its value and the expected one.
    pub(crate) fn differences(&self, state: &DeviceState) -> String {
        let mut found = json!(state);
        found["faults"] = state.faults.iter().filter(|fault| fault.active).map(|fault| fault.fault).collect();
        let differs = |(key, value): (String, Value)| {
            let alone: Self = serde_json::from_value(json!({ key.as_str(): value })).ok()?;
            (!alone.holds(state)).then(|| format!("{key} is {}, not {value}", found[&key]))
        };
        self.keys().into_iter().filter_map(differs).collect::<Vec<_>>().join("; ")
    }

    /// Returns the accepted positions if the current position is not one of them.
    pub fn wanted_positions(&self, position: Option<i16>) -> Option<RangeInclusive<i16>> {
        let (wanted, found) = (self.position.flatten()?, position?);
        Some(wanted.range()).filter(|range| !range.contains(&found))
    }
}

fn is<T: PartialEq>(wanted: Option<&T>, found: &T) -> bool {
    wanted.is_none_or(|wanted| wanted == found)
}

/// Returns whether a nullable value satisfies an optional condition.
fn fits<W, T>(wanted: Option<&Option<W>>, found: Option<&T>, holds: impl FnOnce(&W, &T) -> bool) -> bool {
    match (wanted, found) {
        (None, _) | (Some(None), None) => true,
        (Some(Some(wanted)), Some(found)) => holds(wanted, found),
        _ => false,
    }
}

fn are_active(wanted: &[String], state: &DeviceState) -> bool {
    state.faults.iter().all(|fault| fault.active == wanted.iter().any(|name| name == fault.fault))
}

impl SetPointCondition {
    fn holds(&self, set_point: &SetPointValue) -> bool {
        match (self, set_point) {
            (Self::Equal(wanted), found) => wanted == found,
            (Self::Within(limits), SetPointValue::Position(position)) => limits.range().contains(position),
            (Self::Within(_), SetPointValue::Float(_)) => false,
        }
    }
}

impl PositionCondition {
    fn range(self) -> RangeInclusive<i16> {
        match self {
            Self::Equal(position) => position..=position,
            Self::Within(limits) => limits.range(),
        }
    }
}

impl Limits {
    fn range(self) -> RangeInclusive<i16> {
        self.min.unwrap_or(i16::MIN)..=self.max.unwrap_or(i16::MAX)
    }
}

impl LedCondition {
    fn holds(&self, led: &Led) -> bool {
        is(self.color.as_ref(), &led.color) && is(self.flashing.as_ref(), &led.flashing)
    }
}

/// The maximum time over which a change of position is predicted, because a linked shaft is searched step by step.
const FORESIGHT: Duration = Duration::from_secs(1);

/// A condition on a device state. The caller must check the condition after every event of the world and at the due
/// time.
#[derive(Clone, Debug)]
pub struct StateWatch {
    node: NodeId,
    kind: Kind,
    pub(crate) condition: Box<StateCondition>,
    /// The time before which the position cannot match unless an event occurs.
    moves_there: Instant,
}

impl StateWatch {
    /// Creates a watch for a device of this kind.
    pub const fn new((node, kind): (NodeId, Kind), condition: Box<StateCondition>) -> Self {
        Self { node, kind, condition, moves_there: NEVER }
    }

    /// Returns the current state of the device, and whether it satisfies the condition.
    pub fn look(&mut self, world: &World) -> (DeviceState, bool) {
        let state = DeviceState::of(self.node, self.kind, world);
        let holds = self.condition.holds(&state);
        let wanted = if holds { None } else { self.condition.wanted_positions(state.position) };
        self.moves_there = wanted.map_or(NEVER, |range| match world.has_free_spool(self.node) {
            true => world.next_inside(self.node, &range, NEVER),
            false => world.outside_until(self.node, &range),
        });
        (state, holds)
    }

    /// Returns the next time at which the condition must be checked if no event occurs; `until` at the latest.
    pub fn due(&self, until: Instant, world: &World) -> Instant {
        let asked = self.condition.t_us.map_or(NEVER, Instant::from_micros);
        let limit = if asked > world.now() { asked.min(until) } else { until };
        if self.moves_there > world.now() {
            return limit.min(self.moves_there);
        }
        let near = world.next_event().min(after(world.now(), FORESIGHT));
        world.next_position(self.node, limit.min(near))
    }
}
