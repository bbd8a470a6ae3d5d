//! The products on CANopen as their EDS describes them.

use super::hat::objects::{HatObjects, RULES};
use super::hat::records::{identity, new_layer};
use super::{Kind, Protocol, hat, pve};
use crate::canopen::dictionary::{Entry, Initial};
use crate::canopen::node;

/// The description of a product in an EDS, beside its objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// The indices of the data types, 0x0001–0x0007, can be mapped as gaps in a PDO.
    pub dummies: bool,
}

/// Hands out every object of a new device, in the order of its dictionary; `None` for a kind that has no dictionary.
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
