//! A product of the node: its dictionary, the objects behind it, and its rules.

use core::fmt::Debug;

use super::object::Object;
#[cfg(feature = "names")]
use crate::canopen::dictionary::Initial;
use crate::canopen::dictionary::{Dictionary, Value};
use crate::canopen::{heartbeat, lss, nmt, pdo};
use crate::controller::Filter;
use crate::time::Instant;
use crate::wire::cob_id::NodeId;
use crate::wire::emcy::Emcy;
use crate::wire::lss::Address;
use crate::wire::sdo::AbortCode;

/// The rules that one maker has and another has not.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// SYNC, EMCY and the EMCY consumer can have 29-bit identifiers.
    pub(crate) extended_ids: bool,
    /// The NMT state.
    pub(crate) nmt: nmt::Rules,
    /// The heartbeat.
    pub(crate) heartbeat: heartbeat::Rules,
    /// The RPDO.
    pub(crate) rpdo: pdo::Rules,
    /// The TPDO.
    pub(crate) tpdo: pdo::Rules,
    /// LSS.
    pub(crate) lss: lss::Rules,
    /// The frames of another protocol that the device serves beside CANopen.
    pub(crate) other_protocol: Option<fn(NodeId) -> Filter>,
}

/// The object of a row, of a product.
pub(crate) type ObjectOf<P> = Object<<P as Product>::Object, <P as Product>::Task>;

/// A product on CANopen.
pub(crate) trait Product: Sized {
    /// The product's own objects.
    type Object: Copy + Debug + 'static;
    /// The tasks of the signatures of 0x1010 and 0x1011.
    type Task: Copy + Debug + PartialEq + 'static;

    /// Every object of the product, and no other.
    const DICTIONARY: Dictionary<ObjectOf<Self>>;
    /// The product's rules.
    const RULES: Rules;

    /// Returns the four numbers of the identity object.
    fn identity(&self) -> &Address;

    /// Returns the error register.
    fn error_register(&self) -> u8;

    /// Reads an object.
    fn read(&self, object: Self::Object, now: Instant) -> Value<'_>;

    /// Returns the number that an object holds which can be mapped; 0 for another.
    fn sample(&self, object: Self::Object, now: Instant) -> u32;

    /// Returns what an object reads in a new device.
    #[cfg(feature = "names")]
    fn initial(&self, object: Self::Object) -> Initial<'_> {
        Initial::Fixed(self.read(object, Instant::MIN))
    }

    /// Writes an object.
    ///
    /// # Errors
    /// An abort code, with nothing changed, when the value or the state forbids it.
    fn write(&mut self, object: Self::Object, value: Value<'_>, now: Instant) -> Result<(), AbortCode>;

    /// Takes the stored value of an object, or its default, unchecked: it was checked when it was written.
    fn load(&mut self, object: Self::Object, value: Value<'_>);

    /// Returns the default of a stored object whose row gives none.
    fn default(&self, object: Self::Object) -> Value<'static>;

    /// Takes the values of an RPDO in the order of the mapping; what is invalid is dropped.
    fn receive(&mut self, _values: impl Iterator<Item = (Self::Object, u32)>, _now: Instant) {}

    /// Takes note that the node was stopped.
    fn stopped(&mut self, _now: Instant) {}

    /// Takes the EMCY of the node that the product listens to.
    fn hear_emcy(&mut self, _message: Emcy, _now: Instant) {}
}
