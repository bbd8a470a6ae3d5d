//! What lies behind the object dictionary (SPEC 4.1): where each object is read, written and loaded.

use heapless::Vec;

use super::application::{Application, FLOAT};
use super::dictionary::{DESCRIPTION_MAX, SERIAL_MAX, TABLE};
use super::fault_codes::{fault_of, register};
use super::kind::Kind;
use super::records::Factory;
use super::state_machine::DeviceMode;
use crate::actuator::{ActuatorType, Position, Scale, SetPoint};
use crate::canopen::dictionary::{Default, Entry, Mappable, Objects, Table, Value, Written};
use crate::canopen::emcy::{EmcyConsumer, ErrorHistory};
use crate::canopen::heartbeat::HeartbeatProducer;
use crate::canopen::parameters::Stored;
use crate::canopen::pdo::{EVENT_DRIVEN, Pdo, Rules};
use crate::canopen::sync::SyncConsumer;
use crate::time::{Duration, Instant};
use crate::wire::cob_id::{Function, NodeId};
use crate::wire::sdo::{AbortCode, Multiplexer};

/// Heartbeat periods are rounded up to a multiple of this (A).
pub(super) const HEARTBEAT_RESOLUTION: Duration = Duration::from_millis(10);

/// What 0x1010 takes: "save".
const SAVE: u32 = u32::from_le_bytes(*b"save");
/// What 0x1011:1 takes: "load".
const LOAD: u32 = u32::from_le_bytes(*b"load");
/// What 0x1011:5 takes to clear the occurrence counters: "pkds".
const CLEAR_COUNTERS: u32 = 0x7364_6B70;

/// Object 0x100A: version 132, the part number, release 000 (A), firmware date 180701 (A).
const fn software_version(kind: Kind) -> &'static str {
    match kind.actuator_type() {
        ActuatorType::Proportional => "APP-_S6m1_M_R132_CANOPEN-_11149437_-000_ 180701",
        ActuatorType::OnOff => "APP-_S6m1_M_R132_CANOPEN-_11149443_-000_ 180701",
    }
}

/// The default of object 0x6053.
const fn description(kind: Kind) -> &'static str {
    match kind.actuator_type() {
        ActuatorType::Proportional => "PVEA-CI S6",
        ActuatorType::OnOff => "PVEO-CI S6",
    }
}

/// The first index that is not about communication (CiA 301 7.4.1).
const FIRST_APPLICATION_INDEX: u16 = 0x2000;

const RPDO: Rules = Rules { direction: Mappable::Rpdo, transmission_type: |value| value == EVENT_DRIVEN };
/// (R) The manual prints 7 as the lower end once, 1 otherwise.
const TPDO: Rules =
    Rules { direction: Mappable::Tpdo, transmission_type: |value| matches!(value, 1..=240 | EVENT_DRIVEN) };

/// A write that asks for the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StoreRequest {
    /// "save".
    Save,
    /// "load".
    Load,
    /// Clear the occurrence counters.
    ClearCounters,
}

/// The state behind the dictionary.
#[derive(Debug)]
pub(super) struct PveObjects {
    pub(super) kind: Kind,
    pub(super) factory: Factory,
    pub(super) node_id: Option<NodeId>,
    /// The instant as of which values are read.
    pub(super) now: Instant,
    pub(super) application: Application,
    pub(super) history: ErrorHistory,
    pub(super) heartbeat: HeartbeatProducer,
    pub(super) sync: SyncConsumer,
    pub(super) emcy_consumer: EmcyConsumer,
    pub(super) rpdo: Pdo,
    pub(super) tpdo: Pdo,
    /// Set by a write that has to wait for the memory.
    pub(super) store_request: Option<StoreRequest>,
    description: Vec<u8, DESCRIPTION_MAX>,
    serial_text: Vec<u8, SERIAL_MAX>,
}

impl PveObjects {
    pub(super) fn new(kind: Kind, factory: Factory, application: Application, now: Instant) -> Self {
        Self {
            kind,
            factory,
            node_id: None,
            now,
            application,
            history: ErrorHistory::new(),
            heartbeat: HeartbeatProducer::new(HEARTBEAT_RESOLUTION),
            sync: SyncConsumer::new(),
            emcy_consumer: EmcyConsumer::new(),
            rpdo: Pdo::new(RPDO),
            tpdo: Pdo::new(TPDO),
            store_request: None,
            description: Vec::new(),
            serial_text: decimal(factory.identity.serial),
        }
    }

    /// Takes new factory data, as read at a start.
    pub(super) fn set_factory(&mut self, factory: Factory) {
        self.factory = factory;
        self.serial_text = decimal(factory.identity.serial);
    }

    /// Takes the stored parameters, or the defaults where there are none, and switches the PDOs on. Of a reset of the
    /// communication the application's parameters are not touched.
    pub(super) fn load(&mut self, stored: Option<Stored<'_>>, communication_only: bool) {
        let concerned = |object: Multiplexer| !communication_only || object.index < FIRST_APPLICATION_INDEX;
        if let Some(stored) = stored {
            for (entry, value) in stored.values().filter(|(entry, _)| concerned(entry.object)) {
                self.put(entry.object, value);
            }
        } else {
            for entry in TABLE.stored().filter(|entry| concerned(entry.object)) {
                if let Some(value) = default_value(entry, self.kind, self.node_id) {
                    self.put(entry.object, value);
                }
            }
        }
        self.rpdo.start(TABLE);
        self.tpdo.start(TABLE);
    }

    /// Puts in a stored value, unchecked: it was checked when it was written.
    fn put(&mut self, object: Multiplexer, value: Value<'_>) {
        let (number, text) = match value {
            Value::Number(number) => (number, &[][..]),
            Value::Text(text) => (0, text),
        };
        match (object.index, object.sub) {
            (0x1005, 0) => self.sync.load(number),
            (0x1017, 0) => self.heartbeat.load(number as u16),
            (0x1028, 1) => self.emcy_consumer.load(number),
            (0x1400, 1) => self.rpdo.load_cob_id(number),
            (0x1400, 2) => self.rpdo.load_transmission_type(number as u8),
            (0x1600, 0) => self.rpdo.load_count(number as u8),
            (0x1600, sub) => self.rpdo.load_entry(sub, number),
            (0x1800, 1) => self.tpdo.load_cob_id(number),
            (0x1800, 2) => self.tpdo.load_transmission_type(number as u8),
            (0x1A00, 0) => self.tpdo.load_count(number as u8),
            (0x1A00, sub) => self.tpdo.load_entry(sub, number),
            (0x6053, 0) => self.description = Vec::from_slice(text).unwrap_or(Vec::new()),
            _ => {}
        }
    }

    /// The set-point, or mode, that a value of one of the objects that take them means.
    ///
    /// Over SDO and in a PDO alike: what is out of range here is refused there and dropped here.
    #[inline]
    pub(super) fn command(object: Multiplexer, raw: u32) -> Result<Command, AbortCode> {
        let scaled = |scale: Scale, value: i16| match scale.to_position(value) {
            Some(position) => Ok(Command::SetPoint(SetPoint::Position(position))),
            None if value > 0 => Err(AbortCode::TOO_HIGH),
            None => Err(AbortCode::TOO_LOW),
        };
        match object.index {
            0x3300 => scaled(Scale::Per127, i16::from(raw as i8)),
            0x3303 => scaled(Scale::Per1000, raw as i16),
            0x6300 => match raw as i16 {
                FLOAT => Ok(Command::SetPoint(SetPoint::Float)),
                value => match Position::new(value) {
                    Some(position) => Ok(Command::SetPoint(SetPoint::Position(position))),
                    None if value > 0 => Err(AbortCode::TOO_HIGH),
                    None => Err(AbortCode::TOO_LOW),
                },
            },
            0x6040 => Ok(Command::Control(raw as u16)),
            0x6042 => DeviceMode::new(raw as u8).map(Command::Mode).ok_or(AbortCode::INVALID_VALUE),
            _ => Err(AbortCode::NO_OBJECT),
        }
    }

    /// Obeys a command.
    #[inline]
    pub(super) fn obey(&mut self, command: Command, now: Instant) {
        match command {
            Command::SetPoint(set_point) => self.application.accept(set_point, now),
            Command::Mode(mode) => self.application.set_mode(mode, now),
            Command::Control(word) => self.application.control(word, now),
        }
    }

    /// What can be mapped into the TPDO: the status word and the actual values, by index.
    #[inline]
    pub(super) fn feedback(&self, index: u16) -> u32 {
        let application = &self.application;
        match index {
            0x6041 => application.state().status_word().into(),
            0x6301 => low_bits_16(application.actual_raw(self.now)),
            0x3301 => low_bits_8(application.actual_on(Scale::Per127, self.now)),
            0x3302 => low_bits_8(application.actual_on(Scale::Per127, self.now).saturating_neg()),
            0x3304 => low_bits_16(application.actual_on(Scale::Per1000, self.now)),
            _ => 0,
        }
    }

    fn store(&mut self, value: u32, signature: u32, request: StoreRequest) -> Result<Written, AbortCode> {
        if value != signature {
            return Err(AbortCode::CANNOT_STORE);
        }
        self.store_request = Some(request);
        Ok(Written::WhenStored)
    }
}

/// What a stored object holds before anything was stored; `None` for one that needs a node ID when there is none.
pub(super) fn default_value(entry: &Entry, kind: Kind, node_id: Option<NodeId>) -> Option<Value<'static>> {
    match entry.default {
        Default::Number(number) => Some(Value::Number(number)),
        Default::NodeIdPlus(base) => node_id.map(|id| Value::Number(base.wrapping_add(u32::from(id.get())))),
        Default::Product => Some(Value::Text(description(kind).as_bytes())),
    }
}

/// What the application is told by an object.
#[derive(Clone, Copy, Debug)]
pub(super) enum Command {
    /// 0x3300, 0x3303, 0x6300:1
    SetPoint(SetPoint),
    /// 0x6042
    Mode(DeviceMode),
    /// 0x6040
    Control(u16),
}

impl Objects for PveObjects {
    fn table(&self) -> Table {
        TABLE
    }

    fn read(&self, object: Multiplexer) -> Result<Value<'_>, AbortCode> {
        let application = &self.application;
        let identity = &self.factory.identity;
        let number = match (object.index, object.sub) {
            (0x1001, 0) => register(application.valve.faults()).into(),
            (0x1003, 0) => self.history.count().into(),
            (0x1003, sub) => self.history.field(sub)?,
            (0x1005, 0) => self.sync.cob_id().raw(),
            (0x100A, 0) => return Ok(Value::Text(software_version(self.kind).as_bytes())),
            (0x1014, 0) => self.node_id.map_or(0, |node_id| node_id.id(Function::Emcy).as_raw()).into(),
            (0x1017, 0) => self.heartbeat.time().into(),
            (0x1018, 1) => identity.vendor,
            (0x1018, 2) => identity.product,
            (0x1018, 3) => identity.revision,
            (0x1018, 4) => identity.serial,
            (0x1028, 1) => self.emcy_consumer.cob_id().raw(),
            (0x1400, 1) => self.rpdo.cob_id().raw(),
            (0x1400, 2) => self.rpdo.transmission_type().into(),
            (0x1600, 0) => self.rpdo.count().into(),
            (0x1600, sub) => self.rpdo.entry(sub)?,
            (0x1800, 1) => self.tpdo.cob_id().raw(),
            (0x1800, 2) => self.tpdo.transmission_type().into(),
            (0x1A00, 0) => self.tpdo.count().into(),
            (0x1A00, sub) => self.tpdo.entry(sub)?,
            (0x3300, 0) => low_bits_8(application.set_point_on(Scale::Per127)),
            (0x3303, 0) => low_bits_16(application.set_point_on(Scale::Per1000)),
            (0x6040, 0) => application.control_word().into(),
            (0x6042, 0) => application.mode() as u32,
            (0x6052, 0) => return Ok(Value::Text(&self.serial_text)),
            (0x6053, 0) => return Ok(Value::Text(&self.description)),
            (0x6300, 1) => low_bits_16(application.set_point_raw()),
            (0x3301 | 0x3302 | 0x3304 | 0x6041, 0) | (0x6301, 1) => self.feedback(object.index),
            (0x2000..0x3000, 0) => fault_of(object.index)
                .map(|fault| application.valve.counters().get(fault).into())
                .ok_or(AbortCode::NO_OBJECT)?,
            _ => {
                let entry = TABLE.find(object)?;
                match entry.default {
                    Default::Number(number) => number,
                    _ => return Err(AbortCode::NO_OBJECT),
                }
            }
        };
        Ok(Value::Number(number))
    }

    fn write(&mut self, object: Multiplexer, value: Value<'_>, now: Instant) -> Result<Written, AbortCode> {
        let number = match value {
            Value::Number(number) => number,
            Value::Text(text) => {
                self.description = Vec::from_slice(text).map_err(|_| AbortCode::TOO_LONG)?;
                return Ok(Written::Now);
            }
        };
        match (object.index, object.sub) {
            (0x1003, 0) => self.history.write_count(number as u8)?,
            (0x1005, 0) => self.sync.write(number)?,
            (0x1010, 1) => return self.store(number, SAVE, StoreRequest::Save),
            (0x1011, 1) => return self.store(number, LOAD, StoreRequest::Load),
            (0x1011, 5) => return self.store(number, CLEAR_COUNTERS, StoreRequest::ClearCounters),
            (0x1017, 0) => self.heartbeat.write(number as u16, now)?,
            (0x1028, 1) => self.emcy_consumer.write(number)?,
            (0x1400, 1) => self.rpdo.write_cob_id(number, TABLE)?,
            (0x1400, 2) => self.rpdo.write_transmission_type(number as u8)?,
            (0x1600, 0) => self.rpdo.write_count(number as u8)?,
            (0x1600, sub) => self.rpdo.write_entry(sub, number, TABLE)?,
            (0x1800, 1) => self.tpdo.write_cob_id(number, TABLE)?,
            (0x1800, 2) => self.tpdo.write_transmission_type(number as u8)?,
            (0x1A00, 0) => self.tpdo.write_count(number as u8)?,
            (0x1A00, sub) => self.tpdo.write_entry(sub, number, TABLE)?,
            _ => {
                let command = Self::command(object, number)?;
                self.obey(command, now);
            }
        }
        Ok(Written::Now)
    }
}

/// An INTEGER8 in the low bits.
fn low_bits_8(value: i16) -> u32 {
    u32::from(value as u8)
}

/// An INTEGER16 in the low bits.
fn low_bits_16(value: i16) -> u32 {
    u32::from(value as u16)
}

/// A number in decimal, for 0x6052 (A).
fn decimal(number: u32) -> Vec<u8, SERIAL_MAX> {
    // Ten characters hold every u32.
    Vec::from_slice(itoa::Buffer::new().format(number).as_bytes()).unwrap_or_default()
}
