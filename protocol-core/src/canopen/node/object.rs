//! The objects behind the rows of the dictionary: objects of the node and objects of the product.

use crate::canopen::dictionary::{DataType, Row};

/// The signature of 0x1010 (CiA 301 7.5.2.13).
pub(crate) const SAVE: u32 = u32::from_le_bytes(*b"save");

/// The signature of 0x1011 (CiA 301 7.5.2.14).
pub(crate) const LOAD: u32 = u32::from_le_bytes(*b"load");

/// The object behind a row. `A` is the type of the product's own objects, `T` the type of the tasks.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Object<A, T> {
    /// A constant, see [`Row::constant`].
    Constant,
    /// One of the product's own objects.
    Product(A),
    /// One of the node's objects.
    Node(NodeObject),
    /// 0x1001, which the product supplies.
    ErrorRegister,
    /// 0x1018:1–4, which the product supplies.
    Identity,
    /// 0x1010 and 0x1011, which read as 1. A write of the signature demands the task, see [`Row::signature`].
    Signature(T),
}

/// The communication objects of the node. The row supplies the sub-index.
#[derive(Clone, Copy, Debug)]
pub(crate) enum NodeObject {
    /// 0x1003:0
    ErrorCount,
    /// 0x1003:1–8
    ErrorField,
    /// 0x1005
    SyncCobId,
    /// 0x1014, which follows the node ID until a value is stored.
    EmcyCobId,
    /// 0x1017
    HeartbeatTime,
    /// 0x1028:1
    EmcyConsumer,
    /// 0x1029:1–2
    ErrorBehaviour(ErrorClass),
    /// 0x1400 and 0x1600
    Rpdo(PdoParameter),
    /// 0x1800 and 0x1A00
    Tpdo(PdoParameter),
    /// 0x1F80
    NmtStartup,
}

impl NodeObject {
    /// Returns whether the object is the COB-ID of received frames.
    pub(super) const fn is_cob_id(self) -> bool {
        matches!(self, Self::SyncCobId | Self::EmcyConsumer | Self::Rpdo(PdoParameter::CobId))
    }
}

/// The classes of errors that can change the NMT state, 0x1029.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ErrorClass {
    /// Sub-index 1: a communication error.
    Communication,
    /// Sub-index 2: an error of the product.
    Product,
}

/// A parameter of a PDO.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PdoParameter {
    /// Sub-index 1 of the communication parameter.
    CobId,
    /// Sub-index 2 of the communication parameter.
    TransmissionType,
    /// Sub-index 3 of the communication parameter.
    InhibitTime,
    /// Sub-index 5 of the communication parameter.
    EventTimer,
    /// Sub-index 0 of the mapping parameter.
    Count,
    /// Sub-index 1–8 of the mapping parameter.
    Entry,
}

impl<A: Copy, T: Copy> Row<Object<A, T>> {
    /// Creates the row of a constant.
    #[must_use]
    pub(crate) const fn constant(index: u16, sub: u8, data_type: DataType, number: u32, name: &'static str) -> Self {
        Self::ro(index, sub, data_type, Object::Constant, name).with(number)
    }

    /// Creates the row of a signature that demands a task.
    #[must_use]
    pub(crate) const fn signature(index: u16, sub: u8, signature: u32, task: T, name: &'static str) -> Self {
        Self::rw(index, sub, DataType::U32, Object::Signature(task), name).with(signature)
    }
}
