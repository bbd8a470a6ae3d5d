//! What lies behind the dictionary: the communication objects 0x1000–0x1FFF, and the way to the product's own.

use super::object::{ErrorClass, Object, PdoParameter};
use super::product::{ObjectOf, Product};
use crate::canopen::dictionary::{DefaultValue, Dictionary, Group, Row, Value};
use crate::canopen::emcy::{EmcyConsumer, EmcyProducer, ErrorHistory};
use crate::canopen::heartbeat::HeartbeatProducer;
use crate::canopen::nmt::{ErrorBehaviour, Reset};
use crate::canopen::parameters::Stored;
use crate::canopen::pdo::{self, Pdo};
use crate::canopen::sdo_server;
use crate::canopen::sync::SyncConsumer;
use crate::outcome::Outcome;
use crate::time::Instant;
use crate::wire::cob_id::NodeId;
use crate::wire::sdo::{AbortCode, Multiplexer};

/// The value that an object of "save" and "load" reads: it stores on command (CiA 301 7.5.2.13).
pub(super) const STORES_ON_COMMAND: u32 = 1;

/// What errors do to the NMT state, by their class.
#[derive(Debug)]
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

/// The communication objects.
#[derive(Debug)]
pub(super) struct Communication<P: Product> {
    pub(super) node_id: Option<NodeId>,
    pub(super) history: ErrorHistory,
    pub(super) heartbeat: HeartbeatProducer,
    pub(super) sync: SyncConsumer,
    pub(super) emcy: EmcyProducer,
    pub(super) error_behaviour: ErrorBehaviours,
    pub(super) startup: u32,
    pub(super) emcy_consumer: EmcyConsumer,
    pub(super) rpdo: Pdo<ObjectOf<P>>,
    pub(super) tpdo: Pdo<ObjectOf<P>>,
}

impl<P: Product> Communication<P> {
    pub(super) const fn new() -> Self {
        Self {
            node_id: None,
            history: ErrorHistory::new(),
            heartbeat: HeartbeatProducer::new(const { &P::RULES.heartbeat }),
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

    /// Takes the stored parameters of a group, or the defaults where there are none. Reset communication leaves the
    /// product's own objects alone.
    pub(super) fn load(
        &mut self,
        scope: Reset,
        (group, stored): (Group, Option<Stored<'_, ObjectOf<P>>>),
        product: &mut P,
    ) {
        let concerned =
            |row: &Row<ObjectOf<P>>| scope == Reset::Application || !matches!(row.behind, Object::Product(_));
        if let Some(stored) = stored {
            for (row, value) in stored.values().filter(|(row, _)| concerned(row)) {
                self.put(row.behind, value, product);
            }
        } else {
            for row in P::DICTIONARY.stored(group).filter(|row| concerned(row)) {
                if let Some(value) = self.default(row, product) {
                    self.put(row.behind, value, product);
                }
            }
        }
    }

    /// Switches the PDOs on, after everything was loaded.
    pub(super) fn start_pdos(&mut self) {
        self.rpdo.start(&P::RULES.rpdo, P::DICTIONARY);
        self.tpdo.start(&P::RULES.tpdo, P::DICTIONARY);
    }

    /// Returns the default of a stored object; `None` for one that needs a node ID when there is none.
    pub(super) fn default(&self, row: &Row<ObjectOf<P>>, product: &P) -> Option<Value<'static>> {
        match (row.entry.default, row.behind) {
            (DefaultValue::Number(number), _) => Some(Value::Number(number)),
            (DefaultValue::NodeIdPlus(base), _) => {
                self.node_id.map(|id| Value::Number(base.wrapping_add(u32::from(id.get()))))
            }
            (DefaultValue::Product, Object::Product(object)) => Some(product.default(object)),
            (DefaultValue::Product, _) => None,
        }
    }

    /// Puts in a stored value, unchecked: it was checked when it was written. No other objects are stored.
    fn put(&mut self, object: ObjectOf<P>, value: Value<'_>, product: &mut P) {
        // Of the node's own objects none holds a text.
        let number = value.number().unwrap_or(0);
        match object {
            Object::Product(object) => product.load(object, value),
            Object::SyncCobId => self.sync.load(number),
            Object::EmcyCobId => self.emcy.load(number),
            Object::ErrorBehaviour(class) => {
                self.error_behaviour.set(class, ErrorBehaviour::new(number as u8).unwrap_or_default());
            }
            Object::NmtStartup => self.startup = number,
            Object::HeartbeatTime => self.heartbeat.load(number as u16),
            Object::EmcyConsumer => self.emcy_consumer.load(number),
            Object::Rpdo(parameter) => put_pdo(&mut self.rpdo, parameter, number),
            Object::Tpdo(parameter) => put_pdo(&mut self.tpdo, parameter, number),
            Object::Constant(_)
            | Object::ErrorRegister
            | Object::ErrorCount
            | Object::ErrorField(_)
            | Object::Signature(..)
            | Object::Identity(_) => {}
        }
    }

    /// Returns the number that a mapped object holds.
    #[inline]
    pub(super) fn sample(&self, object: ObjectOf<P>, product: &P, now: Instant) -> u32 {
        match object {
            Object::Product(object) => product.sample(object, now),
            object => self.read(object, product, now).ok().and_then(Value::number).unwrap_or(0),
        }
    }

    /// Reads an object.
    #[inline(never)]
    pub(super) fn read<'a>(
        &'a self,
        object: ObjectOf<P>,
        product: &'a P,
        now: Instant,
    ) -> Result<Value<'a>, AbortCode> {
        let number = match object {
            Object::Constant(number) => number,
            Object::Product(object) => return Ok(product.read(object, now)),
            Object::ErrorRegister => product.error_register().into(),
            Object::ErrorCount => self.history.count().into(),
            Object::ErrorField(sub) => self.history.field(sub)?,
            Object::SyncCobId => self.sync.cob_id().raw(),
            Object::Signature(..) => STORES_ON_COMMAND,
            Object::EmcyCobId => self.emcy.cob_id().raw(),
            Object::ErrorBehaviour(class) => self.error_behaviour.of(class) as u32,
            Object::NmtStartup => self.startup,
            Object::HeartbeatTime => self.heartbeat.time().into(),
            Object::Identity(part) => product.identity().part(part).ok_or(AbortCode::NO_SUB)?,
            Object::EmcyConsumer => self.emcy_consumer.cob_id().raw(),
            Object::Rpdo(parameter) => read_pdo(&self.rpdo, parameter)?,
            Object::Tpdo(parameter) => read_pdo(&self.tpdo, parameter)?,
        };
        Ok(Value::Number(number))
    }
}

fn read_pdo<B: Copy + 'static>(pdo: &Pdo<B>, parameter: PdoParameter) -> Result<u32, AbortCode> {
    Ok(match parameter {
        PdoParameter::CobId => pdo.cob_id().raw(),
        PdoParameter::TransmissionType => pdo.transmission().kind().into(),
        PdoParameter::InhibitTime => pdo.transmission().inhibit().into(),
        PdoParameter::EventTimer => pdo.transmission().event_timer().into(),
        PdoParameter::Count => pdo.count().into(),
        PdoParameter::Entry(sub) => pdo.entry(sub)?,
    })
}

fn put_pdo<B: Copy + 'static>(pdo: &mut Pdo<B>, parameter: PdoParameter, number: u32) {
    match parameter {
        PdoParameter::CobId => pdo.load_cob_id(number),
        PdoParameter::TransmissionType => pdo.load_transmission_type(number as u8),
        PdoParameter::InhibitTime => pdo.load_inhibit(number as u16),
        PdoParameter::EventTimer => pdo.load_event_timer(number as u16),
        PdoParameter::Count => pdo.load_count(number as u8),
        PdoParameter::Entry(sub) => pdo.load_entry(sub, number),
    }
}

fn write_pdo<B: Copy + 'static>(
    pdo: &mut Pdo<B>,
    parameter: PdoParameter,
    number: u32,
    rules: &pdo::Rules,
    dictionary: Dictionary<B>,
    now: Instant,
) -> Result<(), AbortCode> {
    match parameter {
        PdoParameter::CobId => pdo.write_cob_id(number, rules, dictionary, now),
        PdoParameter::TransmissionType => pdo.write_transmission_type(number as u8, rules, now),
        PdoParameter::InhibitTime => pdo.write_inhibit(number as u16),
        PdoParameter::EventTimer => {
            pdo.write_event_timer(number as u16, now);
            Ok(())
        }
        PdoParameter::Count => pdo.write_count(number as u8, rules, dictionary),
        PdoParameter::Entry(sub) => pdo.write_entry(sub, number, rules, dictionary),
    }
}

/// The objects as an SDO client sees them at an instant.
pub(super) struct View<'a, P: Product> {
    pub(super) communication: &'a mut Communication<P>,
    pub(super) product: &'a mut P,
    pub(super) now: Instant,
    /// An identifier or the heartbeat was written.
    pub(super) rewired: bool,
    /// The key of EMCYs that are off, or have another key, since a write.
    pub(super) outdated_emcys: Option<u32>,
    /// An object of the product was written, on which others may depend.
    pub(super) reports_changed: bool,
}

impl<P: Product> sdo_server::Objects for View<'_, P> {
    type Behind = ObjectOf<P>;
    type Demand = P::Task;

    #[inline]
    fn find(&self, object: Multiplexer) -> Result<&'static Row<ObjectOf<P>>, AbortCode> {
        P::DICTIONARY.find(object)
    }

    fn read(&self, object: ObjectOf<P>) -> Result<Value<'_>, AbortCode> {
        self.communication.read(object, self.product, self.now)
    }

    fn write(&mut self, object: ObjectOf<P>, value: Value<'_>) -> Result<Outcome<(), P::Task>, AbortCode> {
        let own = &mut *self.communication;
        // Of the node's own objects none holds a text.
        let number = value.number().unwrap_or(0);
        match object {
            Object::Product(object) => {
                self.product.write(object, value, self.now)?;
                self.reports_changed = true;
            }
            Object::Signature(signature, task) => {
                return if number == signature { Ok(Outcome::Demand(task)) } else { Err(AbortCode::CANNOT_STORE) };
            }
            Object::ErrorCount => own.history.write_count(number as u8)?,
            Object::HeartbeatTime => {
                own.heartbeat.write(number as u16, self.now)?;
                self.rewired = true;
            }
            Object::SyncCobId => {
                own.sync.write(number, P::RULES.extended_ids)?;
                self.rewired = true;
            }
            Object::EmcyCobId => {
                let key = own.emcy.key();
                own.emcy.write(number, P::RULES.extended_ids)?;
                self.outdated_emcys = key.filter(|key| own.emcy.key() != Some(*key));
                self.rewired = true;
            }
            Object::ErrorBehaviour(class) => {
                let behaviour = ErrorBehaviour::new(number as u8).ok_or(AbortCode::INVALID_VALUE)?;
                own.error_behaviour.set(class, behaviour);
            }
            Object::NmtStartup => {
                if !P::RULES.nmt.startup.contains(&number) {
                    return Err(AbortCode::INVALID_VALUE);
                }
                own.startup = number;
            }
            Object::EmcyConsumer => {
                own.emcy_consumer.write(number, P::RULES.extended_ids)?;
                self.rewired = true;
            }
            Object::Rpdo(parameter) => {
                write_pdo(&mut own.rpdo, parameter, number, &P::RULES.rpdo, P::DICTIONARY, self.now)?;
                self.rewired = true;
            }
            Object::Tpdo(parameter) => {
                write_pdo(&mut own.tpdo, parameter, number, &P::RULES.tpdo, P::DICTIONARY, self.now)?;
                self.rewired = true;
            }
            Object::Constant(_) | Object::ErrorRegister | Object::ErrorField(_) | Object::Identity(_) => {
                return Err(AbortCode::READ_ONLY);
            }
        }
        Ok(Outcome::Done(()))
    }
}
