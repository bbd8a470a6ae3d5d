//! The CANopen products, as an EDS describes them.

use super::hat::objects::{HatObjects, RULES};
use super::hat::records::{identity, new_layer};
use super::{Kind, Protocol, hat, pve};
use crate::canopen::dictionary::{Entry, Initial};
use crate::canopen::node;

/// The properties of a product in an EDS, other than its objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Whether the indices 0x0001–0x0007 of data types can be mapped, as gaps in a PDO.
    pub dummies: bool,
}

/// Passes every object of a new device to `each`, in the order of the dictionary. Returns `None` for a kind without an
/// object dictionary.
pub fn describe(kind: Kind, each: impl FnMut(&'static Entry, Initial<'_>)) -> Option<Capabilities> {
    match (kind, kind.protocol()) {
        (Kind::Pve(kind), Protocol::Canopen) => Some(pve::describe(kind, each)),
        (Kind::Hat(kind), _) => {
            let layer = new_layer(&hat::Setup::new(kind));
            node::describe(&HatObjects::new(kind, identity(kind, None), layer), each);
            Some(Capabilities { dummies: RULES.tpdo.dummies })
        }
        (Kind::Pve(_), Protocol::Isobus) => None,
    }
}
