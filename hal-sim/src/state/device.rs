//! The state of a device as JSON.

use protocol_core::actuator::{self, SetPoint};
use protocol_core::device::pve::DeviceState as Dsm;
use protocol_core::device::view::{FaultView, ValveView, View};
use protocol_core::wire::{nmt, valve};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::BitsPerSecond;
use super::plant::PlantState;
use crate::Kind;
use crate::world::{NodeId, World};

/// The state of a device at one instant of virtual time. Without power, node ID, bit rate, NMT state, device state
/// machine, command and set-point are null.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct DeviceState {
    /// The instant of this state, in microseconds of virtual time.
    pub t_us: u64,
    /// The name.
    pub name: String,
    /// The kind, as in `--device`.
    pub kind: &'static str,
    /// The current node ID; on ISOBUS the address.
    #[schema(required, maximum = 255)]
    pub node_id: Option<u8>,
    /// The current bit rate, in bit/s.
    #[schema(required, value_type = Option<BitsPerSecond>)]
    pub bit_rate: Option<u32>,
    /// Whether the device has power and has booted.
    pub powered: bool,
    /// The NMT state; null on ISOBUS.
    #[schema(required)]
    pub nmt: Option<Nmt>,
    /// The device state machine; CANopen valves only.
    #[schema(required)]
    pub dsm: Option<DeviceStateMachine>,
    /// The state of the auxiliary valve as in AVEF; ISOBUS only.
    #[schema(required)]
    pub command: Option<Command>,
    /// The set-point; null for an angle sensor.
    #[schema(required)]
    pub set_point: Option<SetPointValue>,
    /// The position. For a valve, the spool position, −16384…16384, with or without power. For an angle sensor, object
    /// 0x6004; null without power.
    #[schema(required, minimum = -16384, maximum = 16384)]
    pub position: Option<i16>,
    /// Whether the solenoids are energised; null for an angle sensor.
    #[schema(required)]
    pub solenoids: Option<bool>,
    /// The LED; null for an angle sensor.
    #[schema(required)]
    pub led: Option<Led>,
    /// All faults of the kind, active or not.
    pub faults: Vec<Fault>,
    /// The plant of the device.
    pub plant: PlantState,
}

/// An NMT state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Nmt {
    /// Before the boot-up message.
    Initialising,
    /// Configuration: no PDOs.
    PreOperational,
    /// All services.
    Operational,
    /// NMT and heartbeat only.
    Stopped,
}

/// A state of the device state machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceStateMachine {
    /// Initialised.
    Init,
    /// Disabled.
    Disabled,
    /// Held in neutral.
    Hold,
    /// Active.
    Active,
    /// Shut down after a fault.
    FaultHold,
}

/// A state of an auxiliary valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Command {
    /// Closed.
    Blocked,
    /// Flow out of the extend port.
    Extend,
    /// Flow out of the retract port.
    Retract,
    /// Both ports open.
    Float,
    /// Moved by hand.
    Hand,
    /// Stopped.
    EmergencyStop,
}

/// A set-point: −16384…16384, or `"float"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum SetPointValue {
    /// A position.
    Position(i16),
    /// Float.
    Float(FloatWord),
}

/// The word for float.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FloatWord {
    /// Both ports open.
    Float,
}

/// The state of the LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Led {
    /// The colour.
    pub color: Color,
    /// Whether the LED flashes, at 1.5 Hz.
    pub flashing: bool,
}

/// A colour of the LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Color {
    /// Healthy.
    Green,
    /// Disabled.
    Yellow,
    /// Faulty.
    Red,
    /// Without power.
    Off,
}

/// A fault.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Fault {
    /// The name.
    pub fault: &'static str,
    /// Whether the fault is active.
    pub active: bool,
    /// The occurrence counter; on CANopen, both spool faults share a counter. For an angle sensor, the number of
    /// entries of the fault in 0x1003. Null without power.
    #[schema(required, maximum = 255)]
    pub count: Option<u8>,
}

impl DeviceState {
    /// Returns the current state of a device of this kind.
    pub fn of(node: NodeId, kind: Kind, world: &World) -> Self {
        let view = world.view(node);
        let is_valve = matches!(kind, Kind::Pve(_));
        let valve = view.as_ref().and_then(|view| view.valve);
        Self {
            t_us: world.now().as_micros(),
            name: world.name(node).to_owned(),
            kind: kind.name(),
            node_id: view.as_ref().and_then(|view| view.node_id),
            bit_rate: view.as_ref().map(|view| view.bit_rate.bits_per_second()),
            powered: view.is_some(),
            nmt: view.as_ref().and_then(|view| view.nmt).map(Nmt::from),
            dsm: valve.and_then(|valve| valve.dsm).map(DeviceStateMachine::from),
            command: valve.and_then(|valve| valve.command).map(Command::from),
            set_point: valve.map(|valve| valve.set_point.into()),
            position: view.as_ref().map(|view| view.position).or_else(|| world.spool_position(node)),
            solenoids: is_valve.then(|| valve.is_some_and(|valve| valve.solenoids)),
            led: is_valve.then(|| valve.map_or(Led::OFF, Led::from)),
            faults: faults(kind, view.as_ref()),
            plant: PlantState::of(node, world),
        }
    }
}

fn faults(kind: Kind, view: Option<&View>) -> Vec<Fault> {
    match view {
        Some(view) => {
            let fault =
                |FaultView { name, active, count }: &_| Fault { fault: name, active: *active, count: Some(*count) };
            view.faults.iter().map(fault).collect()
        }
        None => kind.fault_names().iter().map(|name| Fault { fault: name, active: false, count: None }).collect(),
    }
}

impl Led {
    pub(super) const OFF: Self = Self { color: Color::Off, flashing: false };
}

impl From<ValveView> for Led {
    fn from(valve: ValveView) -> Self {
        let color = match valve.led.color {
            actuator::Color::Green => Color::Green,
            actuator::Color::Yellow => Color::Yellow,
            actuator::Color::Red => Color::Red,
        };
        Self { color, flashing: valve.led.flashing }
    }
}

impl From<SetPoint> for SetPointValue {
    fn from(set_point: SetPoint) -> Self {
        match set_point {
            SetPoint::Position(position) => Self::Position(position.raw()),
            SetPoint::Float => Self::Float(FloatWord::Float),
        }
    }
}

impl From<nmt::State> for Nmt {
    fn from(state: nmt::State) -> Self {
        match state {
            nmt::State::Initialising => Self::Initialising,
            nmt::State::PreOperational => Self::PreOperational,
            nmt::State::Operational => Self::Operational,
            nmt::State::Stopped => Self::Stopped,
        }
    }
}

impl From<Dsm> for DeviceStateMachine {
    fn from(state: Dsm) -> Self {
        match state {
            Dsm::Init => Self::Init,
            Dsm::Disabled => Self::Disabled,
            Dsm::Hold => Self::Hold,
            Dsm::Active => Self::Active,
            Dsm::FaultHold => Self::FaultHold,
        }
    }
}

impl From<valve::State> for Command {
    fn from(state: valve::State) -> Self {
        match state {
            valve::State::Blocked => Self::Blocked,
            valve::State::Extend => Self::Extend,
            valve::State::Retract => Self::Retract,
            valve::State::Float => Self::Float,
            valve::State::HandOperation => Self::Hand,
            valve::State::EmergencyStop => Self::EmergencyStop,
        }
    }
}
