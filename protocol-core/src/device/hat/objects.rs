//! The values of a sensor's own objects, and the rules of the sensors (SPEC 9).

use super::Kind;
use super::dictionary::{DICTIONARY, HatObject, STARTS_ITSELF, Task, WAITS};
use super::errors::Errors;
#[cfg(feature = "names")]
use crate::canopen::dictionary::Initial;
use crate::canopen::dictionary::{Dictionary, Mappable, Value};
use crate::canopen::lss::{Configuration, Layer};
use crate::canopen::node::{Object, Product, Rules};
use crate::canopen::{heartbeat, lss, nmt, pdo};
use crate::controller::BitRate;
use crate::encoder::{Preset, Shaft};
use crate::time::Instant;
use crate::wire::lss::{Address, LssNodeId};
use crate::wire::sdo::AbortCode;

/// The hardware version, object 0x1009.
const HARDWARE_VERSION: &[u8] = b"01.01";
/// The software version, object 0x100A.
const SOFTWARE_VERSION: &[u8] = b"01.07";

/// The rules of both kinds.
pub(in crate::device) const RULES: Rules = Rules {
    extended_ids: true,
    nmt: nmt::Rules { startup: &[WAITS, STARTS_ITSELF], starts_itself: Some(STARTS_ITSELF) },
    heartbeat: heartbeat::Rules { resolution: 1, max: u16::MAX },
    rpdo: pdo::Rules::NONE,
    tpdo: pdo::Rules {
        direction: Mappable::Tpdo,
        transmission_types: &[pdo::ON_CHANGE..=240, pdo::MANUFACTURER..=pdo::EVENT_DRIVEN],
        extended_ids: true,
        may_be_empty: true,
        timers: true,
        sampled_when_due: true,
        ..pdo::Rules::NONE
    },
    lss: lss::Rules {
        bit_rates: Kind::Hat1000.bit_rates(),
        remote_in: &[lss::State::Waiting, lss::State::Configuration],
        non_configured_in: &[lss::State::Waiting, lss::State::Configuration],
        // (C) Fast scan, which the manual does not describe, follows CiA 305.
        fast_scan_in: &[lss::State::Waiting],
        fast_scan_selects: true,
        can_remove_node_id: true,
        on_waiting: lss::OnWaiting::Boot,
        // (A) The manual does not define the effect of NMT start on a pending node ID or bit rate.
        start_drops_pending: false,
        node_id_error: 255,
        bit_rate_error: 1,
        store_error: 255,
    },
    other_protocol: None,
};

/// The values of the sensor's own objects.
#[derive(Clone, Debug)]
pub(in crate::device) struct HatObjects {
    kind: Kind,
    pub(super) identity: Address,
    pub(in crate::device) errors: Errors,
    pub(super) shaft: Shaft,
    /// The node ID and bit rate in force.
    pub(super) in_force: Layer,
    /// The demanded node ID and bit rate, objects 0x2001:2 and 0x2002:2.
    pub(super) demanded: Layer,
    /// The values written to 0x2001:2 and 0x2002:2 since the last request of an LSS store. The end of this store does
    /// not overwrite them.
    pub(super) demanded_since: Configuration,
    preset: Preset,
}

impl HatObjects {
    pub(in crate::device) const fn new(kind: Kind, identity: Address, layer: Layer) -> Self {
        Self {
            kind,
            identity,
            errors: Errors::NONE,
            shaft: Shaft::at(0),
            in_force: layer,
            demanded: layer,
            demanded_since: Configuration::NONE,
            preset: Preset::NONE,
        }
    }

    /// Returns the position, object 0x6004.
    pub(in crate::device) fn position(&self, now: Instant) -> u32 {
        self.preset.position(self.shaft.position_at(now))
    }
}

impl Product for HatObjects {
    type Object = HatObject;
    type Task = Task;

    const DICTIONARY: Dictionary<Object<HatObject, Task>> = DICTIONARY;
    const RULES: Rules = RULES;

    fn identity(&self) -> &Address {
        &self.identity
    }

    fn error_register(&self) -> u8 {
        self.errors.register()
    }

    fn read(&self, object: HatObject, now: Instant) -> Value<'_> {
        match object {
            HatObject::DeviceName => Value::Text(self.kind.device_name().as_bytes()),
            HatObject::HardwareVersion => Value::Text(HARDWARE_VERSION),
            HatObject::SoftwareVersion => Value::Text(SOFTWARE_VERSION),
            number => Value::Number(self.sample(number, now)),
        }
    }

    #[cfg(feature = "names")]
    fn initial(&self, object: HatObject) -> Initial<'_> {
        match object {
            HatObject::SerialNumber => Initial::Individual,
            HatObject::NodeIdInForce | HatObject::NodeIdDemanded => Initial::NodeIdPlus(0),
            object => Initial::Fixed(self.read(object, Instant::MIN)),
        }
    }

    // `inline(never)` saves 29 instructions on SYNC → TPDO.
    #[inline(never)]
    fn sample(&self, object: HatObject, now: Instant) -> u32 {
        match object {
            HatObject::NodeIdInForce => self.in_force.node_id.get().into(),
            HatObject::NodeIdDemanded => self.demanded.node_id.get().into(),
            HatObject::BitRateInForce => self.in_force.bit_rate.table_index().into(),
            HatObject::BitRateDemanded => self.demanded.bit_rate.table_index().into(),
            HatObject::Preset => self.preset.value(),
            HatObject::Position => self.position(now),
            HatObject::Alarms => self.shaft.measuring_error.into(),
            HatObject::Offset => self.preset.offset(),
            HatObject::SerialNumber => self.identity.serial,
            HatObject::DeviceName | HatObject::HardwareVersion | HatObject::SoftwareVersion => 0,
        }
    }

    fn write(&mut self, object: HatObject, value: Value<'_>, now: Instant) -> Result<(), AbortCode> {
        let Value::Number(number) = value else { return Err(AbortCode::READ_ONLY) };
        match object {
            HatObject::NodeIdDemanded => {
                self.demanded.node_id = LssNodeId::new(number as u8).ok_or(AbortCode::INVALID_VALUE)?;
                self.demanded_since.node_id = Some(self.demanded.node_id);
            }
            HatObject::BitRateDemanded => {
                self.demanded.bit_rate = BitRate::from_table_index(number as u8).ok_or(AbortCode::INVALID_VALUE)?;
                self.demanded_since.bit_rate = Some(self.demanded.bit_rate);
            }
            HatObject::Preset => {
                self.preset = self.preset.moved(self.position(now), number).ok_or(AbortCode::TOO_HIGH)?;
            }
            _ => return Err(AbortCode::READ_ONLY),
        }
        Ok(())
    }

    /// Loads preset or offset, the only stored objects of the product.
    fn load(&mut self, object: HatObject, value: Value<'_>) {
        match (object, value) {
            (HatObject::Preset, Value::Number(preset)) => self.preset.load_value(preset),
            (HatObject::Offset, Value::Number(offset)) => self.preset.load_offset(offset),
            _ => {}
        }
    }

    /// Returns 0. The rows hold all defaults, so this function is never called.
    fn default(&self, _: HatObject) -> Value<'static> {
        Value::Number(0)
    }
}
