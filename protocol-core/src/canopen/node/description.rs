//! The objects of a product as an EDS describes them: each with the value that a new device reads.

use super::object::Object;
use super::objects::STORES_ON_COMMAND;
use super::product::Product;
use crate::canopen::dictionary::{DefaultValue, Entry, Initial, Value};
use crate::wire::cob_id::Function;

/// The part of the identity object that differs from device to device.
const SERIAL_NUMBER: u8 = 3;

/// Hands out every object of a new device, in the order of the dictionary.
pub(crate) fn describe<P: Product>(product: &P, mut each: impl FnMut(&'static Entry, Initial<'_>)) {
    let number = |number| Initial::Fixed(Value::Number(number));
    for row in P::DICTIONARY.rows() {
        let initial = match (row.entry.default, row.behind) {
            (DefaultValue::Number(default), _) => number(default),
            (DefaultValue::NodeIdPlus(base), _) => Initial::NodeIdPlus(base),
            (DefaultValue::Product, Object::Product(object)) if row.entry.stored => {
                Initial::Fixed(product.default(object))
            }
            (DefaultValue::Product, Object::Product(object)) => product.initial(object),
            (DefaultValue::Product, Object::Constant(constant)) => number(constant),
            (DefaultValue::Product, Object::EmcyCobId) => Initial::NodeIdPlus(Function::Emcy as u32),
            (DefaultValue::Product, Object::Signature(..)) => number(STORES_ON_COMMAND),
            (DefaultValue::Product, Object::ErrorRegister | Object::ErrorCount) => number(0),
            (DefaultValue::Product, Object::Identity(SERIAL_NUMBER)) => Initial::Individual,
            (DefaultValue::Product, Object::Identity(part)) => {
                product.identity().part(part).map_or(Initial::Individual, number)
            }
            // An entry of the history exists once there was an error; the others are stored, and their rows say it.
            (DefaultValue::Product, _) => Initial::Individual,
        };
        each(&row.entry, initial);
    }
}
