//! The plant of a device and its changes, for JSON.

use std::borrow::Cow;

use protocol_core::actuator::SpoolFault;
use protocol_core::time::Duration;
use serde::{Deserialize, Serialize};
use utoipa::openapi::{ArrayBuilder, Object, RefOr, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::given::{given, given_object, object, present};
use crate::world::{Electronics, NodeId, Plant, PlantError, World};

/// The plant of a device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum PlantState {
    /// The plant of a valve.
    Valve(ValvePlant),
    /// The plant of an angle sensor.
    Encoder(EncoderPlant),
}

/// The plant of a valve.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct ValvePlant {
    /// The supply voltage, in millivolts.
    pub supply_mv: u32,
    /// The temperature, in °C.
    pub temperature_c: i16,
    /// The state of the spool.
    pub spool: Spool,
    /// The position that the lever pushes the spool to; null when released.
    #[schema(required)]
    pub lever: Option<i16>,
    /// Whether the device has an internal fault.
    pub internal_fault: bool,
    /// The non-volatile memory.
    pub memory: Memory,
    /// Whether the CAN controller is forced bus-off.
    pub bus_off: bool,
    /// The supply voltage, in millivolts, below which the valve is off; null if the valve is never off.
    #[schema(required)]
    pub brown_out_mv: Option<u32>,
    /// Whether cold oil slows the spool down.
    pub oil: bool,
    /// The time from power-on to the start of the program, in milliseconds.
    pub boot_ms: u16,
    /// The answer delay, in milliseconds.
    pub answer_ms: AnswerMs,
    /// The cycle time of the program, in milliseconds; with 0, the program reacts immediately.
    pub cycle_ms: u16,
}

/// The plant of an angle sensor.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct EncoderPlant {
    /// The angle of the shaft, 0…35999 1/100 degree.
    pub angle_cdeg: u32,
    /// The speed of the shaft in turns per minute, positive clockwise.
    pub speed_rpm: i32,
    /// Whether the sensor has a measuring error.
    pub measuring_error: bool,
    /// Whether the device has an internal fault.
    pub internal_fault: bool,
    /// The non-volatile memory.
    pub memory: Memory,
    /// Whether the CAN controller is forced bus-off.
    pub bus_off: bool,
    /// The time from power-on to the start of the program, in milliseconds.
    pub boot_ms: u16,
    /// The answer delay, in milliseconds.
    pub answer_ms: AnswerMs,
    /// The cycle time of the program, in milliseconds; with 0, the program reacts immediately.
    pub cycle_ms: u16,
}

/// The answer delay in milliseconds, or its minimum and maximum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(untagged, expecting = "answer_ms must be a number of milliseconds, or [MIN, MAX]")]
pub enum AnswerMs {
    /// The same delay for every answer.
    #[schema(value_type = Delay)]
    One(u16),
    /// The smallest and the largest delay.
    #[schema(value_type = TwoDelays)]
    Between([u16; 2]),
}

/// The schema of an answer delay, in milliseconds.
#[derive(Clone, Copy, Debug)]
struct Delay;

impl PartialSchema for Delay {
    fn schema() -> RefOr<Schema> {
        Object::builder().schema_type(Type::Integer).minimum(Some(0)).maximum(Some(60_000)).into()
    }
}

impl ToSchema for Delay {
    fn name() -> Cow<'static, str> {
        "DelayOfAnswers".into()
    }
}

/// The schema of the smallest and the largest answer delay.
#[derive(Clone, Copy, Debug)]
struct TwoDelays;

impl PartialSchema for TwoDelays {
    fn schema() -> RefOr<Schema> {
        ArrayBuilder::new().items(Delay::schema()).min_items(Some(2)).max_items(Some(2)).into()
    }
}

impl ToSchema for TwoDelays {
    fn name() -> Cow<'static, str> {
        "TwoDelaysOfAnswers".into()
    }
}

/// The spool.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Spool {
    /// The fault of the spool; null or "ok" for a healthy spool.
    #[schema(required)]
    #[serde(deserialize_with = "Option::deserialize")]
    pub fault: Option<SpoolFaultName>,
}

/// A change of the spool: a word alone, or an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum SpoolChange {
    /// A word alone.
    Word(SpoolFaultName),
    /// An object, as in the state.
    #[serde(deserialize_with = "object")]
    Object(Spool),
}

/// A fault of the spool.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SpoolFaultName {
    /// The spool is healthy; a state has null instead.
    Ok,
    /// The spool does not move.
    Stuck,
    /// The spool moves slowly.
    Slow,
    /// The spool leaves its position.
    Drifting,
    /// The spool does not reach float.
    NoFloat,
}

/// The non-volatile memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Memory {
    /// The memory works.
    Ok,
    /// Every write fails.
    WriteFails,
    /// The memory is unreadable at the next start.
    Damaged,
}

/// A change of the plant: any subset of its fields.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PlantChange {
    /// Valves: the supply voltage, 0…100000 mV.
    #[serde(default, deserialize_with = "given")]
    pub supply_mv: Option<u32>,
    /// Valves: the temperature, −273…1000 °C.
    #[serde(default, deserialize_with = "given")]
    pub temperature_c: Option<i16>,
    /// Valves: the spool.
    #[serde(default, deserialize_with = "given")]
    pub spool: Option<SpoolChange>,
    /// Valves: the position that the lever pushes the spool to, −16384…16384; null releases the lever.
    #[serde(default, deserialize_with = "present")]
    #[schema(value_type = Option<i16>)]
    pub lever: Option<Option<i16>>,
    /// Angle sensors: the angle of the shaft, 0…35999 1/100 degree.
    #[serde(default, deserialize_with = "given")]
    pub angle_cdeg: Option<u32>,
    /// Angle sensors: the speed of the shaft in turns per minute, positive clockwise; 0 for a shaft that follows a
    /// valve.
    #[serde(default, deserialize_with = "given")]
    pub speed_rpm: Option<i32>,
    /// Angle sensors: whether the sensor has a measuring error.
    #[serde(default, deserialize_with = "given")]
    pub measuring_error: Option<bool>,
    /// Whether the device has an internal fault.
    #[serde(default, deserialize_with = "given")]
    pub internal_fault: Option<bool>,
    /// The non-volatile memory.
    #[serde(default, deserialize_with = "given")]
    pub memory: Option<Memory>,
    /// Whether the CAN controller is forced bus-off.
    #[serde(default, deserialize_with = "given")]
    pub bus_off: Option<bool>,
    /// Valves: the supply voltage below which the valve is off, 1…100000 mV; null if the valve is never off.
    #[serde(default, deserialize_with = "present")]
    #[schema(value_type = Option<u32>)]
    pub brown_out_mv: Option<Option<u32>>,
    /// Valves: whether cold oil slows the spool down.
    #[serde(default, deserialize_with = "given")]
    pub oil: Option<bool>,
    /// The time from power-on to the start of the program, 0…60000 ms; a change takes effect at the next start.
    #[serde(default, deserialize_with = "given")]
    pub boot_ms: Option<u16>,
    /// The answer delay, 0…60000 ms, or the smallest and the largest delay.
    #[serde(default, deserialize_with = "given")]
    pub answer_ms: Option<AnswerMs>,
    /// The cycle time of the program, 0…1000 ms; with 0, the program reacts immediately.
    #[serde(default, deserialize_with = "given")]
    pub cycle_ms: Option<u16>,
    /// The duration of the change, in milliseconds, after which the earlier values are restored; permanent by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 1, maximum = 86400000)]
    pub for_ms: Option<u32>,
    /// A profile: a numeric plant word that changes over time.
    #[serde(default, deserialize_with = "given_object")]
    pub profile: Option<Profile>,
}

/// A numeric plant word that changes over time.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// The plant word, such as `supply_mv`.
    pub word: String,
    /// The points, each a time in milliseconds from now and a value; or the name of a predefined profile.
    pub points: Points,
    /// True: each value is kept until the next point. False, the default: values between two points are interpolated
    /// every millisecond.
    #[serde(default)]
    pub steps: bool,
}

/// The points of a profile.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(untagged, expecting = "points must be a list of [MILLISECONDS, VALUE], or \"cranking\"")]
pub enum Points {
    /// A predefined profile.
    Ready(ReadyProfile),
    /// Pairs of a time in milliseconds and a value.
    List(Vec<[i64; 2]>),
}

/// A predefined profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ReadyProfile {
    /// The supply voltage, in mV, of a 24 V machine while its engine is cranked.
    Cranking,
}

/// The supply voltage of a 24 V machine while its engine is cranked, shaped as in ISO 16750-2: times in ms, values in
/// mV (A).
pub const CRANKING: [[i64; 2]; 4] = [[0, 24_000], [50, 6_000], [120, 9_000], [900, 24_000]];

impl Profile {
    /// The maximum duration of a profile in milliseconds: one day.
    pub const MAX_MS: u64 = 24 * 60 * 60 * 1000;

    /// Returns the points of the profile.
    #[must_use]
    pub fn points(&self) -> Vec<[i64; 2]> {
        match &self.points {
            Points::Ready(ReadyProfile::Cranking) => CRANKING.to_vec(),
            Points::List(points) => points.clone(),
        }
    }
}

impl PlantState {
    /// Returns the current plant of a device.
    pub fn of(node: NodeId, world: &World) -> Self {
        let inputs = world.inputs(node);
        let (internal_fault, bus_off) = (inputs.internal_fault, world.is_bus_off_forced(node));
        let memory = match world.memory(node) {
            memory if memory.is_spoilt() => Memory::Damaged,
            memory if memory.write_fails() => Memory::WriteFails,
            _ => Memory::Ok,
        };
        let Electronics { boot, answer: (from, to), cycle, brown_out_mv } = world.electronics(node);
        let [boot_ms, from, to, cycle_ms] = [boot, from, to, cycle].map(millis);
        let answer_ms = AnswerMs::of(from, to);
        if let Some(shaft) = inputs.shaft() {
            return Self::Encoder(EncoderPlant {
                angle_cdeg: world.angle_cdeg(node).unwrap_or(shaft.angle_cdeg),
                speed_rpm: shaft.speed_rpm,
                measuring_error: shaft.measuring_error,
                internal_fault,
                memory,
                bus_off,
                boot_ms,
                answer_ms,
                cycle_ms,
            });
        }
        let valve = inputs.valve().copied().unwrap_or_default();
        Self::Valve(ValvePlant {
            supply_mv: valve.supply_mv,
            temperature_c: valve.temperature_c,
            spool: Spool { fault: name(valve.spool.fault) },
            lever: valve.spool.lever.map(|lever| lever.raw()),
            internal_fault,
            memory,
            bus_off,
            brown_out_mv,
            oil: world.has_oil(node),
            boot_ms,
            answer_ms,
            cycle_ms,
        })
    }

    /// Returns the plant with the shaft angle set to 0, for comparisons: the angle of a rotating shaft changes
    /// continuously.
    pub fn at_rest(&self) -> Self {
        match self {
            Self::Encoder(plant) => Self::Encoder(EncoderPlant { angle_cdeg: 0, ..plant.clone() }),
            valve => valve.clone(),
        }
    }
}

impl PlantChange {
    /// Applies all changes to a device, or none.
    ///
    /// # Errors
    /// [`PlantError`] for the first refused change; nothing has changed.
    pub fn make(self, node: NodeId, world: &mut World) -> Result<(), PlantError> {
        world.set_plants(node, &self.plants())?;
        if let Some(memory) = self.memory {
            let cell = world.memory_mut(node);
            cell.set_write_fails(memory == Memory::WriteFails);
            cell.set_spoilt(memory == Memory::Damaged);
        }
        Ok(())
    }

    /// Returns the plant words that the change sets.
    #[must_use]
    pub fn words(&self) -> Vec<&'static str> {
        let memory = self.memory.map(|_| Plant::MemoryFails(false).word().name);
        self.plants().into_iter().map(|plant| plant.word().name).chain(memory).collect()
    }

    /// Returns the change that restores the values of the same words in `state`.
    #[must_use]
    pub fn earlier(&self, state: &PlantState) -> Self {
        let mut earlier = Self::default();
        match state {
            PlantState::Valve(plant) => {
                earlier.supply_mv = self.supply_mv.map(|_| plant.supply_mv);
                earlier.temperature_c = self.temperature_c.map(|_| plant.temperature_c);
                earlier.spool = self.spool.map(|_| SpoolChange::Object(plant.spool));
                earlier.lever = self.lever.map(|_| plant.lever);
                earlier.brown_out_mv = self.brown_out_mv.map(|_| plant.brown_out_mv);
                earlier.oil = self.oil.map(|_| plant.oil);
            }
            PlantState::Encoder(plant) => {
                earlier.angle_cdeg = self.angle_cdeg.map(|_| plant.angle_cdeg);
                earlier.speed_rpm = self.speed_rpm.map(|_| plant.speed_rpm);
                earlier.measuring_error = self.measuring_error.map(|_| plant.measuring_error);
            }
        }
        let (PlantState::Valve(ValvePlant { internal_fault, memory, bus_off, boot_ms, answer_ms, cycle_ms, .. })
        | PlantState::Encoder(EncoderPlant {
            internal_fault, memory, bus_off, boot_ms, answer_ms, cycle_ms, ..
        })) = state;
        earlier.internal_fault = self.internal_fault.map(|_| *internal_fault);
        earlier.memory = self.memory.map(|_| *memory);
        earlier.bus_off = self.bus_off.map(|_| *bus_off);
        earlier.boot_ms = self.boot_ms.map(|_| *boot_ms);
        earlier.answer_ms = self.answer_ms.map(|_| *answer_ms);
        earlier.cycle_ms = self.cycle_ms.map(|_| *cycle_ms);
        earlier
    }

    /// Returns one plant change for each word that this change sets, except for the memory.
    pub fn plants(&self) -> Vec<Plant> {
        let Self { supply_mv, temperature_c, spool, lever, angle_cdeg, speed_rpm, measuring_error, .. } = *self;
        let plants = [
            supply_mv.map(Plant::SupplyMv),
            temperature_c.map(Plant::TemperatureC),
            spool.map(|spool| Plant::Spool(spool.fault())),
            lever.map(Plant::Lever),
            angle_cdeg.map(Plant::AngleCdeg),
            speed_rpm.map(Plant::SpeedRpm),
            measuring_error.map(Plant::MeasuringError),
            self.internal_fault.map(Plant::InternalFault),
            self.bus_off.map(Plant::BusOff),
            self.brown_out_mv.map(Plant::BrownOutMv),
            self.oil.map(Plant::Oil),
            self.boot_ms.map(Plant::BootMs),
            self.answer_ms.map(AnswerMs::plant),
            self.cycle_ms.map(Plant::CycleMs),
        ];
        plants.into_iter().flatten().collect()
    }
}

impl From<Plant> for PlantChange {
    fn from(plant: Plant) -> Self {
        let mut change = Self::default();
        match plant {
            Plant::SupplyMv(millivolt) => change.supply_mv = Some(millivolt),
            Plant::TemperatureC(celsius) => change.temperature_c = Some(celsius),
            Plant::Spool(fault) => {
                change.spool = Some(SpoolChange::Word(name(fault).unwrap_or(SpoolFaultName::Ok)));
            }
            Plant::Lever(pushed) => change.lever = Some(pushed),
            Plant::AngleCdeg(angle) => change.angle_cdeg = Some(angle),
            Plant::SpeedRpm(speed) => change.speed_rpm = Some(speed),
            Plant::MeasuringError(there) => change.measuring_error = Some(there),
            Plant::InternalFault(there) => change.internal_fault = Some(there),
            Plant::MemoryFails(fails) => change.memory = Some(if fails { Memory::WriteFails } else { Memory::Ok }),
            Plant::BusOff(there) => change.bus_off = Some(there),
            Plant::BrownOutMv(limit) => change.brown_out_mv = Some(limit),
            Plant::Oil(there) => change.oil = Some(there),
            Plant::BootMs(ms) => change.boot_ms = Some(ms),
            Plant::AnswerMs(from, to) => change.answer_ms = Some(AnswerMs::of(from, to)),
            Plant::CycleMs(ms) => change.cycle_ms = Some(ms),
        }
        change
    }
}

impl AnswerMs {
    const fn of(from: u16, to: u16) -> Self {
        if from == to { Self::One(to) } else { Self::Between([from, to]) }
    }

    const fn plant(self) -> Plant {
        match self {
            Self::One(ms) => Plant::AnswerMs(ms, ms),
            Self::Between([from, to]) => Plant::AnswerMs(from, to),
        }
    }
}

/// Returns a time in milliseconds, limited to `u16::MAX`.
fn millis(time: Duration) -> u16 {
    u16::try_from(time.as_millis()).unwrap_or(u16::MAX)
}

impl SpoolChange {
    fn fault(self) -> SpoolFault {
        let name = match self {
            Self::Word(name) | Self::Object(Spool { fault: Some(name) }) => name,
            Self::Object(Spool { fault: None }) => SpoolFaultName::Ok,
        };
        FAULTS.into_iter().find(|(known, _)| *known == name).map_or(SpoolFault::None, |(_, fault)| fault)
    }
}

/// The spool faults by name. `Ok` is not among them: in a state, the fault of a healthy spool is null.
const FAULTS: [(SpoolFaultName, SpoolFault); 4] = [
    (SpoolFaultName::Stuck, SpoolFault::Stuck),
    (SpoolFaultName::Slow, SpoolFault::Slow),
    (SpoolFaultName::Drifting, SpoolFault::Drifting),
    (SpoolFaultName::NoFloat, SpoolFault::NoFloat),
];

fn name(fault: SpoolFault) -> Option<SpoolFaultName> {
    FAULTS.into_iter().find(|(_, known)| *known == fault).map(|(name, _)| name)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use protocol_core::controller::BitRate;
    use protocol_core::device::plant::{Product, WORDS};
    use serde_json::json;

    use super::*;
    use crate::state::schema::Schemas;
    use crate::{SensorKind, ValveKind};

    /// A change with `for_ms` would otherwise leave a word as it is at its end.
    #[test]
    fn each_word_that_a_change_sets_is_among_the_earlier_values() {
        let mut world = World::new(BitRate::Kbit250, 1);
        let valve = world.add("valve", ValveKind::PveaCanopen);
        let sensor = world.add("sensor", SensorKind::Hat1000);
        for (product, node) in [(Product::Valve, valve), (Product::Encoder, sensor)] {
            let state = PlantState::of(node, &world);
            for word in product.words() {
                let healthy = word.healthy().expect(word.name).to_string();
                let change = PlantChange::from(Plant::parse(word.name, &healthy).expect(word.name));
                assert_eq!(change.words(), [word.name], "PlantChange::plants");
                assert_eq!(change.earlier(&state).words(), [word.name], "PlantChange::earlier");
            }
        }
    }

    #[test]
    fn the_members_of_a_change_are_the_words_of_the_plant() {
        let schemas = Schemas::of::<PlantChange>();
        let members = schemas.by_name()["PlantChange"]["properties"].as_object().expect("members");
        let words: BTreeSet<&str> = WORDS.iter().map(|word| word.name).collect();
        let in_time = ["for_ms", "profile"];
        let members_of_words = members.keys().map(String::as_str).filter(|key| !in_time.contains(key));
        assert_eq!(members_of_words.collect::<BTreeSet<_>>(), words);
        for word in &WORDS {
            let refusal = |value| {
                schemas.check("PlantChange", &json!({ word.name: value }), "null").map_err(|mismatch| mismatch.reason)
            };
            let range = word.values.range().filter(|_| word.name != "answer_ms");
            let Some((min, max)) = range else {
                let told = refusal(json!("bent")).expect_err(word.name);
                let values = match word.name {
                    "answer_ms" => "a whole number from 0 to 60000, or a list of 2 items".to_owned(),
                    _ => word.values.to_string().replace("on, off", "true or false"),
                };
                assert!(told.contains(&format!("accepted: {values}")), "{told}");
                continue;
            };
            assert_eq!((refusal(min.into()), refusal(max.into())), (Ok(()), Ok(())), "{word}");
            for beyond in [i64::from(min) - 1, i64::from(max) + 1] {
                let told = refusal(beyond.into()).expect_err(word.name);
                assert!(told.contains(&format!("a whole number from {min} to {max}")), "{told}");
            }
            let description = members[word.name]["description"].as_str().unwrap_or_default();
            assert!(max == i32::MAX || description.contains(&max.to_string()), "{word}: {description}");
        }
    }
}
