//! The communication objects, 0x1000–0x1FFF, and the access to objects of node and product.

use super::object::{ErrorClass, NodeObject, Object, PdoParameter};
use super::product::{Product, Rules};
use crate::canopen::dictionary::{DefaultValue, Entries, Group, Place, Value};
use crate::canopen::emcy::{EmcyConsumer, EmcyProducer, ErrorHistory};
use crate::canopen::heartbeat::{self, HeartbeatProducer};
use crate::canopen::nmt::{ErrorBehaviour, Reset};
use crate::canopen::parameters::Stored;
use crate::canopen::pdo::{self, Pdo};
use crate::canopen::sync::SyncConsumer;
use crate::time::Instant;
use crate::wire::cob_id::NodeId;
use crate::wire::sdo::AbortCode;

/// The value of 0x1010 and 0x1011: the device stores on command (CiA 301 7.5.2.13).
pub(super) const STORES_ON_COMMAND: u32 = 1;

/// The error behaviour of each error class, 0x1029.
#[derive(Clone, Debug)]
pub(super) struct ErrorBehaviours {
    communication: ErrorBehaviour,
    product: ErrorBehaviour,
}

impl ErrorBehaviours {
    pub(super) const fn of(&self, class: ErrorClass) -> ErrorBehaviour {
        match class {
            ErrorClass::Communication => self.communication,
            ErrorClass::Product => self.product,
        }
    }

    const fn set(&mut self, class: ErrorClass, behaviour: ErrorBehaviour) {
        match class {
            ErrorClass::Communication => self.communication = behaviour,
            ErrorClass::Product => self.product = behaviour,
        }
    }
}

/// The communication objects. Functions that do not need the product are compiled once for all products of an image.
#[derive(Clone, Debug)]
pub(super) struct Communication {
    pub(super) node_id: Option<NodeId>,
    pub(super) history: ErrorHistory,
    pub(super) heartbeat: HeartbeatProducer,
    pub(super) sync: SyncConsumer,
    pub(super) emcy: EmcyProducer,
    pub(super) error_behaviour: ErrorBehaviours,
    pub(super) startup: u32,
    pub(super) emcy_consumer: EmcyConsumer,
    pub(super) rpdo: Pdo,
    pub(super) tpdo: Pdo,
}

impl Communication {
    pub(super) const fn new(heartbeat: &'static heartbeat::Rules) -> Self {
        Self {
            node_id: None,
            history: ErrorHistory::new(),
            heartbeat: HeartbeatProducer::new(heartbeat),
            sync: SyncConsumer::new(),
            emcy: EmcyProducer::new(),
            error_behaviour: ErrorBehaviours {
                communication: ErrorBehaviour::PreOperational,
                product: ErrorBehaviour::PreOperational,
            },
            startup: 0,
            emcy_consumer: EmcyConsumer::new(),
            rpdo: Pdo::new(),
            tpdo: Pdo::new(),
        }
    }

    /// Loads the stored parameters of a group or, if none are stored, its defaults. Reset communication does not load
    /// the product's own objects.
    pub(super) fn load<P: Product>(
        &mut self,
        scope: Reset,
        (group, mut stored): (Group, Option<Stored<'_>>),
        product: &mut P,
    ) {
        for place in P::DICTIONARY.entries().stored(group) {
            let value = match &mut stored {
                Some(stored) => stored.next_of(place.entry),
                None => self.default(place, product),
            };
            if let Some(value) = value {
                self.put(scope, place, value, product);
            }
        }
    }

    /// Switches the PDOs on, after all parameters are loaded.
    pub(super) fn start_pdos(&mut self, rules: &Rules, objects: Entries) {
        self.rpdo.start(&rules.rpdo, objects);
        self.tpdo.start(&rules.tpdo, objects);
    }

    /// Returns the default of an object that "save" stores. Returns `None` for a default that depends on a missing node
    /// ID.
    pub(super) fn default<P: Product>(&self, place: Place, product: &P) -> Option<Value<'static>> {
        match place.entry.default()? {
            DefaultValue::Number(number) => Some(Value::Number(number)),
            DefaultValue::NodeIdPlus(base) => {
                self.node_id.map(|id| Value::Number(base.wrapping_add(u32::from(id.get()))))
            }
            DefaultValue::Product => match P::DICTIONARY.behind(place.position)? {
                Object::Product(object) => Some(product.default(object)),
                _ => None,
            },
        }
    }

    /// Loads a stored or default value. A stored value was checked when it was written.
    fn put<P: Product>(&mut self, scope: Reset, place: Place, value: Value<'_>, product: &mut P) {
        match P::DICTIONARY.behind(place.position) {
            Some(Object::Product(object)) if scope == Reset::Application => product.load(object, value),
            Some(Object::Node(object)) => self.put_own(object, place.entry.sub(), number(value)),
            _ => {}
        }
    }

    fn put_own(&mut self, object: NodeObject, sub: u8, number: u32) {
        match object {
            NodeObject::SyncCobId => self.sync.load(number),
            NodeObject::EmcyCobId => self.emcy.load(number),
            NodeObject::ErrorBehaviour(class) => {
                self.error_behaviour.set(class, ErrorBehaviour::new(number as u8).unwrap_or_default());
            }
            NodeObject::NmtStartup => self.startup = number,
            NodeObject::HeartbeatTime => self.heartbeat.load(number as u16),
            NodeObject::EmcyConsumer => self.emcy_consumer.load(number),
            NodeObject::Rpdo(parameter) => put_pdo(&mut self.rpdo, parameter, sub, number),
            NodeObject::Tpdo(parameter) => put_pdo(&mut self.tpdo, parameter, sub, number),
            NodeObject::ErrorCount | NodeObject::ErrorField => {}
        }
    }

    /// Returns the value of the mapped object at a position in the dictionary.
    #[inline]
    pub(super) fn sample<P: Product>(&self, position: u8, product: &P, now: Instant) -> u32 {
        match P::DICTIONARY.behind(position) {
            Some(Object::Product(object)) => product.sample(object, now),
            _ => self.sample_own(position, product, now),
        }
    }

    fn sample_own<P: Product>(&self, position: u8, product: &P, now: Instant) -> u32 {
        let place = P::DICTIONARY.entries().place(position);
        place.and_then(|place| self.read(place, product, now).ok()).map_or(0, number)
    }

    pub(super) fn read<'a, P: Product>(
        &'a self,
        place: Place,
        product: &'a P,
        now: Instant,
    ) -> Result<Value<'a>, AbortCode> {
        let number = match P::DICTIONARY.behind(place.position).ok_or(AbortCode::NO_OBJECT)? {
            Object::Constant => place.entry.number(),
            Object::Product(object) => return Ok(product.read(object, now)),
            Object::Node(object) => self.read_own(object, place.entry.sub())?,
            Object::ErrorRegister => product.error_register().into(),
            Object::Identity => {
                let part = place.entry.sub().checked_sub(1);
                part.and_then(|part| product.identity().part(part)).ok_or(AbortCode::NO_SUB)?
            }
            Object::Signature(_) => STORES_ON_COMMAND,
        };
        Ok(Value::Number(number))
    }

    fn read_own(&self, object: NodeObject, sub: u8) -> Result<u32, AbortCode> {
        Ok(match object {
            NodeObject::ErrorCount => self.history.count().into(),
            NodeObject::ErrorField => self.history.field(sub)?,
            NodeObject::SyncCobId => self.sync.cob_id().raw(),
            NodeObject::EmcyCobId => self.emcy.cob_id().raw(),
            NodeObject::ErrorBehaviour(class) => self.error_behaviour.of(class) as u32,
            NodeObject::NmtStartup => self.startup,
            NodeObject::HeartbeatTime => self.heartbeat.time().into(),
            NodeObject::EmcyConsumer => self.emcy_consumer.cob_id().raw(),
            NodeObject::Rpdo(parameter) => read_pdo(&self.rpdo, parameter, sub)?,
            NodeObject::Tpdo(parameter) => read_pdo(&self.tpdo, parameter, sub)?,
        })
    }

    /// Writes an object of the node. `number` fits the type of the object.
    ///
    /// # Errors
    /// Returns an abort code, and changes nothing, if the value or the state forbids the write.
    pub(super) fn write_own(
        &mut self,
        (object, sub): (NodeObject, u8),
        number: u32,
        rules: &Rules,
        objects: Entries,
        now: Instant,
    ) -> Result<(), AbortCode> {
        match object {
            NodeObject::ErrorCount => self.history.write_count(number as u8),
            NodeObject::HeartbeatTime => self.heartbeat.write(number as u16, now),
            NodeObject::SyncCobId => self.sync.write(number, rules.extended_ids),
            NodeObject::EmcyCobId => self.emcy.write(number, rules.extended_ids),
            NodeObject::ErrorBehaviour(class) => {
                let behaviour = ErrorBehaviour::new(number as u8).ok_or(AbortCode::INVALID_VALUE)?;
                self.error_behaviour.set(class, behaviour);
                Ok(())
            }
            NodeObject::NmtStartup => {
                if !rules.nmt.startup.contains(&number) {
                    return Err(AbortCode::INVALID_VALUE);
                }
                self.startup = number;
                Ok(())
            }
            NodeObject::EmcyConsumer => self.emcy_consumer.write(number, rules.extended_ids),
            NodeObject::Rpdo(parameter) => {
                write_pdo(&mut self.rpdo, (parameter, sub), number, &rules.rpdo, objects, now)
            }
            NodeObject::Tpdo(parameter) => {
                write_pdo(&mut self.tpdo, (parameter, sub), number, &rules.tpdo, objects, now)
            }
            NodeObject::ErrorField => Err(AbortCode::READ_ONLY),
        }
    }
}

/// Returns the number in a value, 0 for a text. The objects of the node are numbers.
pub(super) fn number(value: Value<'_>) -> u32 {
    value.number().unwrap_or(0)
}

fn read_pdo(pdo: &Pdo, parameter: PdoParameter, sub: u8) -> Result<u32, AbortCode> {
    Ok(match parameter {
        PdoParameter::CobId => pdo.cob_id().raw(),
        PdoParameter::TransmissionType => pdo.transmission().kind().into(),
        PdoParameter::InhibitTime => pdo.transmission().inhibit().into(),
        PdoParameter::EventTimer => pdo.transmission().event_timer().into(),
        PdoParameter::Count => pdo.count().into(),
        PdoParameter::Entry => pdo.entry(sub)?,
    })
}

fn put_pdo(pdo: &mut Pdo, parameter: PdoParameter, sub: u8, number: u32) {
    match parameter {
        PdoParameter::CobId => pdo.load_cob_id(number),
        PdoParameter::TransmissionType => pdo.load_transmission_type(number as u8),
        PdoParameter::InhibitTime => pdo.load_inhibit(number as u16),
        PdoParameter::EventTimer => pdo.load_event_timer(number as u16),
        PdoParameter::Count => pdo.load_count(number as u8),
        PdoParameter::Entry => pdo.load_entry(sub, number),
    }
}

fn write_pdo(
    pdo: &mut Pdo,
    (parameter, sub): (PdoParameter, u8),
    number: u32,
    rules: &pdo::Rules,
    objects: Entries,
    now: Instant,
) -> Result<(), AbortCode> {
    match parameter {
        PdoParameter::CobId => pdo.write_cob_id(number, rules, objects, now),
        PdoParameter::TransmissionType => pdo.write_transmission_type(number as u8, rules, now),
        PdoParameter::InhibitTime => pdo.write_inhibit(number as u16),
        PdoParameter::EventTimer => {
            pdo.write_event_timer(number as u16, now);
            Ok(())
        }
        PdoParameter::Count => pdo.write_count(number as u8, rules, objects),
        PdoParameter::Entry => pdo.write_entry(sub, number, rules, objects),
    }
}
