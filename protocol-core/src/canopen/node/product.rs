//! The trait of a product: dictionary, objects and rules.

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

/// The rules that differ between products.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    /// Whether SYNC, EMCY and the EMCY consumer may have 29-bit identifiers.
    pub(crate) extended_ids: bool,
    /// The rules for the NMT state.
    pub(crate) nmt: nmt::Rules,
    /// The rules for the heartbeat.
    pub(crate) heartbeat: heartbeat::Rules,
    /// The rules for the RPDO.
    pub(crate) rpdo: pdo::Rules,
    /// The rules for the TPDO.
    pub(crate) tpdo: pdo::Rules,
    /// The rules for LSS.
    pub(crate) lss: lss::Rules,
    /// The filter for the frames of a protocol other than CANopen.
    pub(crate) other_protocol: Option<fn(NodeId) -> Filter>,
}

/// The type of the objects behind a product's rows.
pub(crate) type ObjectOf<P> = Object<<P as Product>::Object, <P as Product>::Task>;

/// A CANopen product.
pub(crate) trait Product: Sized {
    /// The product's own objects.
    type Object: Copy + Debug + 'static;
    /// The tasks that signatures in 0x1010 and 0x1011 demand.
    type Task: Copy + Debug + PartialEq + 'static;

    /// All objects of the product.
    const DICTIONARY: Dictionary<ObjectOf<Self>>;
    /// The rules of the product.
    const RULES: Rules;

    /// Returns the LSS address: the four numbers of the identity object.
    fn identity(&self) -> &Address;

    /// Returns the error register.
    fn error_register(&self) -> u8;

    /// Reads an object.
    fn read(&self, object: Self::Object, now: Instant) -> Value<'_>;

    /// Returns the value of an object in a PDO; 0 for a text.
    fn sample(&self, object: Self::Object, now: Instant) -> u32;

    /// Returns the value of an object in a new device.
    #[cfg(feature = "names")]
    fn initial(&self, object: Self::Object) -> Initial<'_> {
        Initial::Fixed(self.read(object, Instant::MIN))
    }

    /// Writes an object.
    ///
    /// # Errors
    /// Returns an abort code, and changes nothing, if the value or the state forbids the write.
    fn write(&mut self, object: Self::Object, value: Value<'_>, now: Instant) -> Result<(), AbortCode>;

    /// Loads a stored or default value. A stored value was checked when it was written.
    fn load(&mut self, object: Self::Object, value: Value<'_>);

    /// Returns the default of an object whose row leaves the default to the product.
    fn default(&self, object: Self::Object) -> Value<'static>;

    /// Applies the values of an RPDO. `_values` has the order of the mapping. Invalid values are dropped.
    fn receive(&mut self, _values: impl Iterator<Item = (Self::Object, u32)>, _now: Instant) {}

    /// Handles NMT stop.
    fn stopped(&mut self, _now: Instant) {}

    /// Handles an EMCY that the EMCY consumer received from another node.
    fn consume_emcy(&mut self, _message: Emcy, _now: Instant) {}
}
