//! The fictitious product: a lamp that is dimmed by an RPDO and reports its brightness and the error register.

use crate::canopen::dictionary::DataType::{Text, U8, U16, U32};
use crate::canopen::dictionary::DefaultValue::{self, NodeIdPlus, Number};
use crate::canopen::dictionary::{Dictionary, Mappable, Row, Table, Value};
use crate::canopen::node::NodeObject::{
    EmcyCobId, EmcyConsumer, ErrorCount, ErrorField, HeartbeatTime, Rpdo, SyncCobId, Tpdo,
};
use crate::canopen::node::Object::{ErrorRegister, Identity, Node, Product as Own};
use crate::canopen::node::PdoParameter::{CobId, Count, Entry, TransmissionType};
use crate::canopen::node::{Object, Product, Rules, SAVE};
use crate::canopen::{heartbeat, lss, nmt, pdo};
use crate::controller::BitRate;
use crate::time::Instant;
use crate::wire::emcy::Emcy;
use crate::wire::lss::Address;
use crate::wire::sdo::AbortCode;

#[derive(Clone, Copy, Debug)]
pub(super) enum LampObject {
    Brightness,
    Dimmer,
    Label,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    Save,
}

pub(super) const DICTIONARY: Dictionary<Object<LampObject, Task>> = Dictionary::new(&Table::new([
    Row::constant(0x1000, 0, U32, 0x191, "Device type"),
    Row::ro(0x1001, 0, U8, ErrorRegister, "Error register").mappable(Mappable::Tpdo),
    Row::rw(0x1003, 0, U8, Node(ErrorCount), "Number of errors"),
    Row::ro(0x1003, 1, U32, Node(ErrorField), "Error 1"),
    Row::rw(0x1005, 0, U32, Node(SyncCobId), "COB-ID SYNC").stored(Number(0x80)),
    Row::signature(0x1010, 1, SAVE, Task::Save, "Store"),
    Row::ro(0x1014, 0, U32, Node(EmcyCobId), "COB-ID EMCY"),
    Row::rw(0x1017, 0, U16, Node(HeartbeatTime), "Heartbeat").stored(Number(0)),
    Row::ro(0x1018, 1, U32, Identity, "Vendor"),
    Row::rw(0x1028, 1, U32, Node(EmcyConsumer), "EMCY consumer").stored(Number(0x8000_0000)),
    Row::rw(0x1400, 1, U32, Node(Rpdo(CobId)), "RPDO COB-ID").stored(NodeIdPlus(0x200)),
    Row::rw(0x1400, 2, U8, Node(Rpdo(TransmissionType)), "RPDO type").stored(Number(0xFF)),
    Row::rw(0x1600, 0, U8, Node(Rpdo(Count)), "RPDO mapping").stored(Number(1)),
    Row::rw(0x1600, 1, U32, Node(Rpdo(Entry)), "RPDO mapping 1").stored(Number(0x6200_0008)),
    Row::rw(0x1800, 1, U32, Node(Tpdo(CobId)), "TPDO COB-ID").stored(NodeIdPlus(0x180)),
    Row::rw(0x1800, 2, U8, Node(Tpdo(TransmissionType)), "TPDO type").stored(Number(0xFF)),
    Row::rw(0x1A00, 0, U8, Node(Tpdo(Count)), "TPDO mapping").stored(Number(2)),
    Row::rw(0x1A00, 1, U32, Node(Tpdo(Entry)), "TPDO mapping 1").stored(Number(0x6000_0008)),
    Row::rw(0x1A00, 2, U32, Node(Tpdo(Entry)), "TPDO mapping 2").stored(Number(0x1001_0008)),
    Row::rw(0x2100, 0, Text(12), Own(LampObject::Label), "Label").stored(DefaultValue::Product),
    Row::ro(0x6000, 0, U8, Own(LampObject::Brightness), "Brightness").mappable(Mappable::Tpdo),
    Row::rw(0x6200, 0, U8, Own(LampObject::Dimmer), "Dimmer").mappable(Mappable::Rpdo),
]));

const PDO: pdo::Rules = pdo::Rules {
    direction: Mappable::No,
    transmission_types: &[0..=240, 254..=255],
    extended_ids: true,
    may_be_empty: true,
    dummies: false,
    entries_while_counted: false,
    timers: false,
    sampled_when_due: false,
};

/// A lamp with a brightness of at most 100.
#[derive(Debug, Default)]
pub(super) struct Lamp {
    pub(super) brightness: u8,
    pub(super) register: u8,
    pub(super) stops: u32,
    pub(super) heard: Option<Emcy>,
    pub(super) label: heapless::Vec<u8, 12>,
}

impl Product for Lamp {
    type Object = LampObject;
    type Task = Task;

    const DICTIONARY: Dictionary<Object<LampObject, Task>> = DICTIONARY;
    const RULES: Rules = Rules {
        extended_ids: true,
        nmt: nmt::Rules::NONE,
        heartbeat: heartbeat::Rules { resolution: 1, max: 0xFFFF },
        rpdo: pdo::Rules { direction: Mappable::Rpdo, ..PDO },
        tpdo: pdo::Rules { direction: Mappable::Tpdo, ..PDO },
        lss: lss::Rules {
            bit_rates: &BitRate::ALL,
            remote_in: &[],
            non_configured_in: &[lss::State::Waiting, lss::State::Configuration],
            fast_scan_in: &[lss::State::Waiting, lss::State::Configuration],
            fast_scan_selects: false,
            can_remove_node_id: false,
            on_waiting: lss::OnWaiting::Restart,
            start_drops_pending: true,
            node_id_error: 255,
            bit_rate_error: 1,
            store_error: 255,
        },
        other_protocol: None,
    };

    fn identity(&self) -> &Address {
        &Address { vendor: 0x11, product: 0x22, revision: 0x33, serial: 0x44 }
    }

    fn error_register(&self) -> u8 {
        self.register
    }

    fn read(&self, object: LampObject, now: Instant) -> Value<'_> {
        match object {
            LampObject::Label => Value::Text(&self.label),
            number => Value::Number(self.sample(number, now)),
        }
    }

    fn sample(&self, object: LampObject, _: Instant) -> u32 {
        match object {
            LampObject::Brightness | LampObject::Dimmer => self.brightness.into(),
            LampObject::Label => 0,
        }
    }

    fn write(&mut self, object: LampObject, value: Value<'_>, _: Instant) -> Result<(), AbortCode> {
        match (object, value) {
            (LampObject::Dimmer, Value::Number(level @ 0..=100)) => self.brightness = level as u8,
            (LampObject::Dimmer, _) => return Err(AbortCode::TOO_HIGH),
            (object, value) => self.load(object, value),
        }
        Ok(())
    }

    fn load(&mut self, object: LampObject, value: Value<'_>) {
        if let (LampObject::Label, Value::Text(text)) = (object, value) {
            self.label = heapless::Vec::from_slice(text).unwrap();
        }
    }

    fn default(&self, _: LampObject) -> Value<'static> {
        Value::Text(b"lamp")
    }

    fn receive(&mut self, values: impl Iterator<Item = (LampObject, u32)>, now: Instant) {
        for (object, raw) in values {
            let _ = self.write(object, Value::Number(raw), now);
        }
    }

    fn stopped(&mut self, _: Instant) {
        self.stops += 1;
        self.brightness = 0;
    }

    fn consume_emcy(&mut self, message: Emcy, _: Instant) {
        self.heard = Some(message);
    }
}
