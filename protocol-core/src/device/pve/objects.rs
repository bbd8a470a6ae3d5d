//! The values of a valve's own objects, and the rules of the CANopen valves (SPEC 4.1).

use heapless::Vec;

use super::Kind;
use super::device_control::{DeviceControl, FLOAT};
use super::dictionary::{DESCRIPTION_MAX, DICTIONARY, HEARTBEAT_MAX, Task, ValveObject};
use super::fault_codes::register;
use super::records::Factory;
use super::state_machine::{DeviceMode, DeviceState};
use crate::actuator::{ActuatorType, Position, Scale, SetPoint};
use crate::canopen::dictionary::{Dictionary, Mappable, Value};
#[cfg(feature = "names")]
use crate::canopen::dictionary::{Entry, Initial};
#[cfg(feature = "names")]
use crate::canopen::node;
use crate::canopen::node::{Object, Product, Rules};
use crate::canopen::{heartbeat, lss, nmt, pdo};
use crate::controller::Filter;
#[cfg(feature = "names")]
use crate::device::Capabilities;
use crate::time::Instant;
use crate::wire::decimal::{DIGITS, decimal};
use crate::wire::emcy::{Emcy, GENERIC_ERROR};
use crate::wire::lss::Address;
use crate::wire::sdo::AbortCode;
use crate::wire::uds;

/// Returns object 0x100A: version 132, the part number, release 000 (A) and firmware date 180701 (A). (R) The older
/// manual prints no blank before the date.
const fn software_version(kind: Kind) -> &'static str {
    match kind.actuator_type() {
        ActuatorType::Proportional => "APP-_S6m1_M_R132_CANOPEN-_11149437_-000_ 180701",
        ActuatorType::OnOff => "APP-_S6m1_M_R132_CANOPEN-_11149443_-000_ 180701",
    }
}

/// Returns the default of object 0x6053.
const fn description(kind: Kind) -> &'static str {
    match kind.actuator_type() {
        ActuatorType::Proportional => "PVEA-CI S6",
        ActuatorType::OnOff => "PVEO-CI S6",
    }
}

/// The rules of both kinds (SPEC 4).
const RULES: Rules = Rules {
    extended_ids: false,
    nmt: nmt::Rules::NONE,
    heartbeat: heartbeat::Rules {
        // The period is rounded up to a multiple of 10 ms (A).
        resolution: 10,
        max: HEARTBEAT_MAX,
    },
    rpdo: pdo::Rules { direction: Mappable::Rpdo, transmission_types: &[pdo::EVENT_DRIVEN..=pdo::EVENT_DRIVEN], ..PDO },
    // (R) The manual once prints 7 as the lower limit, elsewhere 1.
    tpdo: pdo::Rules {
        direction: Mappable::Tpdo,
        transmission_types: &[1..=240, pdo::EVENT_DRIVEN..=pdo::EVENT_DRIVEN],
        ..PDO
    },
    lss: lss::Rules {
        bit_rates: Kind::PveaCanopen.bit_rates(),
        // (R) CiA 305 permits these two services in LSS waiting, too.
        non_configured_in: &[lss::State::Configuration],
        fast_scan_in: &[lss::State::Configuration],
        fast_scan_selects: false,
        remote_in: &[],
        can_remove_node_id: false,
        on_waiting: lss::OnWaiting::Restart,
        start_drops_pending: true,
        node_id_error: 1,
        bit_rate_error: 1,
        store_error: 2,
    },
    other_protocol: Some(|node_id| Filter {
        key: uds::key_to(uds::Address::node(node_id.get())),
        mask: uds::ANY_SOURCE,
    }),
};

/// The rules that both PDOs share.
const PDO: pdo::Rules = pdo::Rules {
    direction: Mappable::No,
    transmission_types: &[],
    extended_ids: false,
    // (A) The manual does not define the effect of switching on a PDO without mapped objects.
    may_be_empty: false,
    dummies: true,
    // (R) CiA 301 permits writes of entries only while sub-index 0 is 0.
    entries_while_counted: true,
    timers: false,
    sampled_when_due: false,
};

/// The values of the valve's own objects.
#[derive(Clone, Debug)]
pub(super) struct ValveObjects {
    pub(super) kind: Kind,
    pub(super) control: DeviceControl,
    factory: Factory,
    description: Vec<u8, DESCRIPTION_MAX, u8>,
    serial_text: Vec<u8, DIGITS>,
}

/// The command that a write of an object gives to the device control.
#[derive(Clone, Copy, Debug)]
enum Command {
    /// 0x3300, 0x3303, 0x6300:1
    SetPoint(SetPoint),
    /// 0x6042
    Mode(DeviceMode),
    /// 0x6040
    Control(u16),
}

impl ValveObjects {
    pub(super) const fn new(kind: Kind) -> Self {
        Self {
            kind,
            control: DeviceControl::new(kind),
            factory: Factory::UNREAD,
            description: Vec::new(),
            serial_text: Vec::new(),
        }
    }

    pub(super) const fn factory(&self) -> &Factory {
        &self.factory
    }

    /// Sets the factory data, at a start.
    pub(super) fn set_factory(&mut self, factory: Factory) {
        self.factory = factory;
        self.serial_text = decimal(factory.identity.serial);
    }

    /// Decodes the value of an object as a command. The SDO server refuses a value out of range. A PDO drops such a
    /// value.
    #[inline]
    fn command(object: ValveObject, raw: u32) -> Result<Command, AbortCode> {
        let scaled = |scale: Scale, value: i16| match scale.to_position(value) {
            Some(position) => Ok(Command::SetPoint(SetPoint::Position(position))),
            None if value > 0 => Err(AbortCode::TOO_HIGH),
            None => Err(AbortCode::TOO_LOW),
        };
        match object {
            ValveObject::SetPointPer127 => scaled(Scale::Per127, i16::from(raw as i8)),
            ValveObject::SetPointPer1000 => scaled(Scale::Per1000, raw as i16),
            ValveObject::SetPoint => match raw as i16 {
                FLOAT => Ok(Command::SetPoint(SetPoint::Float)),
                value => match Position::new(value) {
                    Some(position) => Ok(Command::SetPoint(SetPoint::Position(position))),
                    None if value > 0 => Err(AbortCode::TOO_HIGH),
                    None => Err(AbortCode::TOO_LOW),
                },
            },
            ValveObject::ControlWord => Ok(Command::Control(raw as u16)),
            ValveObject::DeviceMode => DeviceMode::new(raw as u8).map(Command::Mode).ok_or(AbortCode::INVALID_VALUE),
            ValveObject::SoftwareVersion
            | ValveObject::FaultCount(_)
            | ValveObject::ActualPer127
            | ValveObject::ActualInverted
            | ValveObject::ActualPer1000
            | ValveObject::StatusWord
            | ValveObject::SerialNumber
            | ValveObject::Description
            | ValveObject::Actual => Err(AbortCode::READ_ONLY),
        }
    }
}

impl Product for ValveObjects {
    type Object = ValveObject;
    type Task = Task;

    const DICTIONARY: Dictionary<Object<ValveObject, Task>> = DICTIONARY;
    const RULES: Rules = RULES;

    fn identity(&self) -> &Address {
        &self.factory.identity
    }

    fn error_register(&self) -> u8 {
        register(self.control.valve.faults())
    }

    fn read(&self, object: ValveObject, now: Instant) -> Value<'_> {
        match object {
            ValveObject::SoftwareVersion => Value::Text(software_version(self.kind).as_bytes()),
            ValveObject::SerialNumber => Value::Text(&self.serial_text),
            ValveObject::Description => Value::Text(&self.description),
            number => Value::Number(self.sample(number, now)),
        }
    }

    #[cfg(feature = "names")]
    fn initial(&self, object: ValveObject) -> Initial<'_> {
        match object {
            ValveObject::SerialNumber => Initial::Individual,
            object => Initial::Fixed(self.read(object, Instant::MIN)),
        }
    }

    fn sample(&self, object: ValveObject, now: Instant) -> u32 {
        let control = &self.control;
        match object {
            ValveObject::FaultCount(fault) => control.valve.counters().get(fault).into(),
            ValveObject::SetPointPer127 => low_bits_8(control.set_point_on(Scale::Per127)),
            ValveObject::ActualPer127 => low_bits_8(control.actual_on(Scale::Per127, now)),
            ValveObject::ActualInverted => low_bits_8(control.actual_on(Scale::Per127, now).saturating_neg()),
            ValveObject::SetPointPer1000 => low_bits_16(control.set_point_on(Scale::Per1000)),
            ValveObject::ActualPer1000 => low_bits_16(control.actual_on(Scale::Per1000, now)),
            ValveObject::ControlWord => control.control_word().into(),
            ValveObject::StatusWord => control.state().status_word().into(),
            ValveObject::DeviceMode => control.mode() as u32,
            ValveObject::SetPoint => low_bits_16(control.set_point_raw()),
            ValveObject::Actual => low_bits_16(control.actual_raw(now)),
            ValveObject::SoftwareVersion | ValveObject::SerialNumber | ValveObject::Description => 0,
        }
    }

    fn write(&mut self, object: ValveObject, value: Value<'_>, now: Instant) -> Result<(), AbortCode> {
        let number = match value {
            Value::Number(number) => number,
            Value::Text(text) => {
                self.description = Vec::from_slice(text).map_err(|_| AbortCode::TOO_LONG)?;
                return Ok(());
            }
        };
        match Self::command(object, number)? {
            Command::SetPoint(set_point) => self.control.accept(set_point, now),
            Command::Mode(mode) => self.control.set_mode(mode, now),
            Command::Control(word) => self.control.set_control_word(word, now),
        }
        Ok(())
    }

    /// Loads the description, the only stored object of the product.
    fn load(&mut self, object: ValveObject, value: Value<'_>) {
        if let (ValveObject::Description, Value::Text(text)) = (object, value) {
            self.description = Vec::from_slice(text).unwrap_or_default();
        }
    }

    fn default(&self, _: ValveObject) -> Value<'static> {
        Value::Text(description(self.kind).as_bytes())
    }

    /// Applies the values of an RPDO in the order mode, control word, set-point. The order does not depend on the
    /// mapping. Invalid values are dropped (SPEC 4.1).
    #[inline]
    fn receive(&mut self, values: impl Iterator<Item = (ValveObject, u32)>, now: Instant) {
        let (mut mode, mut control, mut set_point) = (None, None, None);
        for (object, raw) in values {
            match Self::command(object, raw) {
                Ok(Command::Mode(value)) => mode = Some(value),
                Ok(Command::Control(value)) => control = Some(value),
                Ok(Command::SetPoint(value)) => set_point = Some(value),
                Err(_) => {}
            }
        }
        if let Some(mode) = mode {
            self.control.set_mode(mode, now);
        }
        if let Some(word) = control {
            self.control.set_control_word(word, now);
        }
        if let Some(set_point) = set_point {
            self.control.accept(set_point, now);
        }
    }

    fn stopped(&mut self, now: Instant) {
        self.control.shut_down(now);
    }

    /// Handles an EMCY from another node. A generic error is an emergency stop: it shuts an active valve down (SPEC
    /// 4.2).
    fn consume_emcy(&mut self, message: Emcy, now: Instant) {
        if message.code == GENERIC_ERROR && self.control.state() == DeviceState::Active {
            self.control.shut_down(now);
        }
    }
}

/// Passes every object of a new CANopen valve to `each`.
#[cfg(feature = "names")]
pub(in crate::device) fn describe(kind: Kind, each: impl FnMut(&'static Entry, Initial<'_>)) -> Capabilities {
    let mut objects = ValveObjects::new(kind);
    objects.set_factory(Factory::new(kind, None));
    node::describe(&objects, each);
    Capabilities { dummies: PDO.dummies }
}

/// Returns an INTEGER8 as the low bits of a u32.
fn low_bits_8(value: i16) -> u32 {
    u32::from(value as u8)
}

/// Returns an INTEGER16 as the low bits of a u32.
fn low_bits_16(value: i16) -> u32 {
    u32::from(value as u16)
}
