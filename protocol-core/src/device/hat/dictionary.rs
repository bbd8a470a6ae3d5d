//! The object dictionary of the sensors (SPEC 9). Names follow CiA 301 below 0x2000, the manual up to 0x5FFF, and CiA
//! 406 from 0x6000.

use self::HatObject::{
    Alarms, BitRateDemanded, BitRateInForce, DeviceName, HardwareVersion, NodeIdDemanded, NodeIdInForce, Offset,
    Position, Preset, SerialNumber, SoftwareVersion,
};
use self::Task::{Load, Save};
use crate::canopen::dictionary::DataType::{I32, Text, U8, U16, U32};
use crate::canopen::dictionary::DefaultValue::{NodeIdPlus, Number};
use crate::canopen::dictionary::Mappable::Tpdo as IntoTpdo;
use crate::canopen::dictionary::{Dictionary, Entry, Row, Table};
use crate::canopen::node::NodeObject::{
    EmcyCobId, ErrorBehaviour, ErrorCount, ErrorField, HeartbeatTime, NmtStartup, SyncCobId, Tpdo,
};
use crate::canopen::node::Object::{ErrorRegister, Identity, Node, Product};
use crate::canopen::node::PdoParameter::{CobId, Count, Entry as Mapped, EventTimer, InhibitTime, TransmissionType};
use crate::canopen::node::{ErrorClass, LOAD, Object, SAVE};
use crate::canopen::pdo;
use crate::canopen::sync::SyncConsumer;
use crate::encoder::{POSITION_MAX, STEPS};
use crate::wire::cob_id::{self, Function};
use crate::wire::sdo::Multiplexer;

/// The value of 0x1F80 of a sensor that waits for NMT start.
pub(super) const WAITS: u32 = 0x08;
/// The value of 0x1F80 of a sensor that enters operational by itself. (R) In CiA 302 bit 2 has the opposite meaning.
pub(super) const STARTS_ITSELF: u32 = 0x0C;

/// The value of 0x6507: software version 1.07, profile version 3.2 (A).
const VERSIONS: u32 = 0x0107_0302;

/// The default COB-ID of the TPDO, which is off.
const TPDO_OFF: u32 = cob_id::CobId::OFF | Function::Tpdo1 as u32;

/// The product's own objects.
#[derive(Clone, Copy, Debug)]
pub(in crate::device) enum HatObject {
    DeviceName,
    HardwareVersion,
    SoftwareVersion,
    NodeIdInForce,
    NodeIdDemanded,
    BitRateInForce,
    BitRateDemanded,
    Preset,
    Position,
    Alarms,
    Offset,
    SerialNumber,
}

/// The part of the parameters that a sub-index of 0x1010 and 0x1011 selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::device) enum Part {
    /// The communication and application objects.
    All,
    /// The objects 0x1000–0x1FFF.
    Communication,
    /// The objects 0x6000–0x9FFF.
    Application,
    /// The objects of LSS, 0x2001 and 0x2002.
    Lss,
}

/// The task that a signature in 0x1010 or 0x1011 demands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::device) enum Task {
    /// "save"
    Save(Part),
    /// "load"
    Load(Part),
}

/// Returns the description of an object; `None` if the object does not exist.
#[must_use]
pub fn entry(object: Multiplexer) -> Option<&'static Entry> {
    DICTIONARY.entries().find(object).ok().map(|place| place.entry)
}

/// All objects of a sensor.
pub(super) const DICTIONARY: Dictionary<Object<HatObject, Task>> = Dictionary::new(&Table::new([
    Row::constant(0x1000, 0, U32, 0x0001_0196, "Device type"),
    Row::ro(0x1001, 0, U8, ErrorRegister, "Error register").mappable(IntoTpdo),
    Row::constant(0x1002, 0, U32, 0, "Manufacturer status register").mappable(IntoTpdo),
    // (R) In CiA 301 a write of 0 clears the history.
    Row::ro(0x1003, 0, U8, Node(ErrorCount), "Pre-defined error field: number of errors"),
    Row::ro(0x1003, 1, U32, Node(ErrorField), "Pre-defined error field 1"),
    Row::ro(0x1003, 2, U32, Node(ErrorField), "Pre-defined error field 2"),
    Row::ro(0x1003, 3, U32, Node(ErrorField), "Pre-defined error field 3"),
    Row::ro(0x1003, 4, U32, Node(ErrorField), "Pre-defined error field 4"),
    Row::ro(0x1003, 5, U32, Node(ErrorField), "Pre-defined error field 5"),
    Row::ro(0x1003, 6, U32, Node(ErrorField), "Pre-defined error field 6"),
    Row::ro(0x1003, 7, U32, Node(ErrorField), "Pre-defined error field 7"),
    Row::ro(0x1003, 8, U32, Node(ErrorField), "Pre-defined error field 8"),
    Row::rw(0x1005, 0, U32, Node(SyncCobId), "COB-ID SYNC").stored(Number(SyncConsumer::DEFAULT)),
    Row::ro(0x1008, 0, Text(8), Product(DeviceName), "Manufacturer device name"),
    Row::ro(0x1009, 0, Text(5), Product(HardwareVersion), "Manufacturer hardware version"),
    Row::ro(0x100A, 0, Text(5), Product(SoftwareVersion), "Manufacturer software version"),
    Row::constant(0x1010, 0, U8, 4, "Store parameters: highest sub-index"),
    Row::signature(0x1010, 1, SAVE, Save(Part::All), "Store all parameters"),
    Row::signature(0x1010, 2, SAVE, Save(Part::Communication), "Store communication parameters"),
    Row::signature(0x1010, 3, SAVE, Save(Part::Application), "Store application parameters"),
    Row::signature(0x1010, 4, SAVE, Save(Part::Lss), "Store LSS parameters"),
    Row::constant(0x1011, 0, U8, 4, "Restore default parameters: highest sub-index"),
    Row::signature(0x1011, 1, LOAD, Load(Part::All), "Restore all default parameters"),
    Row::signature(0x1011, 2, LOAD, Load(Part::Communication), "Restore communication default parameters"),
    Row::signature(0x1011, 3, LOAD, Load(Part::Application), "Restore application default parameters"),
    Row::signature(0x1011, 4, LOAD, Load(Part::Lss), "Restore LSS default parameters"),
    Row::rw(0x1014, 0, U32, Node(EmcyCobId), "COB-ID EMCY").stored(NodeIdPlus(Function::Emcy as u32)),
    Row::rw(0x1017, 0, U16, Node(HeartbeatTime), "Producer heartbeat time").stored(Number(0)),
    Row::constant(0x1018, 0, U8, 4, "Identity object: highest sub-index"),
    Row::ro(0x1018, 1, U32, Identity, "Vendor ID"),
    Row::ro(0x1018, 2, U32, Identity, "Product code"),
    Row::ro(0x1018, 3, U32, Identity, "Revision number"),
    Row::ro(0x1018, 4, U32, Identity, "Serial number"),
    Row::constant(0x1029, 0, U8, 2, "Error behaviour: highest sub-index"),
    Row::rw(0x1029, 1, U8, Node(ErrorBehaviour(ErrorClass::Communication)), "Error behaviour: communication error")
        .within(0, 2)
        .stored(Number(0)),
    Row::rw(0x1029, 2, U8, Node(ErrorBehaviour(ErrorClass::Product)), "Error behaviour: controller error")
        .within(0, 2)
        .stored(Number(0)),
    Row::constant(0x1800, 0, U8, 5, "TPDO 1 communication: highest sub-index"),
    Row::rw(0x1800, 1, U32, Node(Tpdo(CobId)), "TPDO 1 COB-ID").stored(NodeIdPlus(TPDO_OFF)),
    Row::rw(0x1800, 2, U8, Node(Tpdo(TransmissionType)), "TPDO 1 transmission type")
        .stored(Number(pdo::MANUFACTURER as u32)),
    Row::rw(0x1800, 3, U16, Node(Tpdo(InhibitTime)), "TPDO 1 inhibit time").stored(Number(0)),
    Row::rw(0x1800, 5, U16, Node(Tpdo(EventTimer)), "TPDO 1 event timer").stored(Number(0)),
    Row::rw(0x1A00, 0, U8, Node(Tpdo(Count)), "TPDO 1 mapping: number of objects")
        .within(0, pdo::ENTRIES as i32)
        .stored(Number(1)),
    Row::rw(0x1A00, 1, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 1").stored(Number(0x6004_0020)),
    Row::rw(0x1A00, 2, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 2").stored(Number(0)),
    Row::rw(0x1A00, 3, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 3").stored(Number(0)),
    Row::rw(0x1A00, 4, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 4").stored(Number(0)),
    Row::rw(0x1A00, 5, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 5").stored(Number(0)),
    Row::rw(0x1A00, 6, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 6").stored(Number(0)),
    Row::rw(0x1A00, 7, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 7").stored(Number(0)),
    Row::rw(0x1A00, 8, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 8").stored(Number(0)),
    Row::rw(0x1F80, 0, U32, Node(NmtStartup), "NMT startup").stored(Number(WAITS)),
    // (R) The manual prints 4, 5 and 6 as sub-indices.
    Row::constant(0x2001, 0, U8, 2, "Node ID: highest sub-index"),
    Row::ro(0x2001, 1, U8, Product(NodeIdInForce), "Node ID in force"),
    Row::rw(0x2001, 2, U8, Product(NodeIdDemanded), "Node ID demanded").within(1, 255),
    Row::constant(0x2002, 0, U8, 2, "Bit rate: highest sub-index"),
    Row::ro(0x2002, 1, U8, Product(BitRateInForce), "Bit rate in force"),
    Row::rw(0x2002, 2, U8, Product(BitRateDemanded), "Bit rate demanded").within(0, 8),
    Row::constant(0x6000, 0, U16, 0, "Operating parameters"),
    Row::constant(0x6001, 0, U32, STEPS, "Measuring units per revolution"),
    Row::constant(0x6002, 0, U32, STEPS, "Total measuring range in measuring units"),
    Row::rw(0x6003, 0, U32, Product(Preset), "Preset value").within(0, POSITION_MAX as i32).stored(Number(0)),
    Row::ro(0x6004, 0, U32, Product(Position), "Position value").within(0, POSITION_MAX as i32).mappable(IntoTpdo),
    Row::constant(0x6500, 0, U16, 0, "Operating status"),
    Row::constant(0x6501, 0, U32, STEPS, "Single-turn resolution"),
    Row::ro(0x6503, 0, U16, Product(Alarms), "Alarms").mappable(IntoTpdo),
    Row::constant(0x6504, 0, U16, 1, "Supported alarms"),
    Row::constant(0x6505, 0, U16, 0, "Warnings"),
    Row::constant(0x6506, 0, U16, 0, "Supported warnings"),
    Row::constant(0x6507, 0, U32, VERSIONS, "Profile and software version"),
    Row::constant(0x6508, 0, U32, 0xFFFF_FFFF, "Operating time"),
    Row::ro(0x6509, 0, I32, Product(Offset), "Offset value")
        .within(-(STEPS as i32) / 2, STEPS as i32 / 2 - 1)
        .stored(Number(0)),
    Row::constant(0x650A, 0, U8, 3, "Module identification: highest sub-index"),
    Row::constant(0x650A, 1, I32, 0, "Manufacturer offset value"),
    Row::constant(0x650A, 2, I32, 0, "Manufacturer minimum position value"),
    Row::constant(0x650A, 3, I32, POSITION_MAX, "Manufacturer maximum position value"),
    Row::ro(0x650B, 0, U32, Product(SerialNumber), "Serial number"),
]));
