//! The objects of a product with their values in a new device, for an EDS.

use super::object::{NodeObject, Object};
use super::objects::STORES_ON_COMMAND;
use super::product::Product;
use crate::canopen::dictionary::{DefaultValue, Entry, Initial, Place, Value};
use crate::wire::cob_id::Function;

/// The sub-index of the serial number in the identity object.
const SERIAL_NUMBER: u8 = 4;

/// Passes every object of a new device to `each`, in the order of the dictionary.
pub(crate) fn describe<P: Product>(product: &P, mut each: impl FnMut(&'static Entry, Initial<'_>)) {
    let number = |number| Initial::Fixed(Value::Number(number));
    for Place { entry, position } in P::DICTIONARY.entries().iter() {
        let Some(behind) = P::DICTIONARY.behind(position) else { continue };
        let initial = match (entry.default(), behind) {
            (Some(DefaultValue::Number(default)), _) => number(default),
            (Some(DefaultValue::NodeIdPlus(base)), _) => Initial::NodeIdPlus(base),
            (Some(DefaultValue::Product), Object::Product(object)) => Initial::Fixed(product.default(object)),
            (None, Object::Product(object)) => product.initial(object),
            (_, Object::Constant) => number(entry.number()),
            (_, Object::Node(NodeObject::EmcyCobId)) => Initial::NodeIdPlus(Function::Emcy as u32),
            (_, Object::Signature(_)) => number(STORES_ON_COMMAND),
            (_, Object::ErrorRegister | Object::Node(NodeObject::ErrorCount)) => number(0),
            (_, Object::Identity) if entry.sub() == SERIAL_NUMBER => Initial::Individual,
            (_, Object::Identity) => {
                let part = entry.sub().checked_sub(1).and_then(|part| product.identity().part(part));
                part.map_or(Initial::Individual, number)
            }
            // History entries exist only after an error. The rows of all other objects of the node have a default.
            (_, Object::Node(_)) => Initial::Individual,
        };
        each(entry, initial);
    }
}
