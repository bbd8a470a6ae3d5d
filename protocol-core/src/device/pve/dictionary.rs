//! The object dictionary of the CANopen valves (SPEC 4.1).
//!
//! Names follow CiA 301 below 0x2000, the manual up to 0x5FFF, and CiA 408 from 0x6000.

use super::device_control::FLOAT;
use crate::actuator::{COUNTER_MAX, Fault, Position};
use crate::canopen::dictionary::DataType::{I8, I16, Text, U8, U16, U32};
use crate::canopen::dictionary::DefaultValue::{self, NodeIdPlus, Number};
use crate::canopen::dictionary::{Dictionary, Entry, Mappable, Row, Table};
use crate::canopen::emcy;
use crate::canopen::node::NodeObject::{
    EmcyCobId, EmcyConsumer, ErrorCount, ErrorField, HeartbeatTime, Rpdo, SyncCobId, Tpdo,
};
use crate::canopen::node::Object::{self, ErrorRegister, Identity, Node, Product};
use crate::canopen::node::PdoParameter::{CobId, Count, Entry as Mapped, TransmissionType};
use crate::canopen::node::{LOAD, SAVE};
use crate::canopen::pdo;
use crate::canopen::sync::SyncConsumer;
use crate::wire::cob_id::Function;
use crate::wire::decimal::DIGITS;
use crate::wire::sdo::Multiplexer;

use Task::{ClearCounters, Load, Save};
use ValveObject::{
    Actual, ActualInverted, ActualPer127, ActualPer1000, ControlWord, Description, DeviceMode, FaultCount,
    SerialNumber, SetPoint, SetPointPer127, SetPointPer1000, SoftwareVersion, StatusWord,
};

/// The product's own objects.
#[derive(Clone, Copy, Debug)]
pub(super) enum ValveObject {
    /// 0x100A
    SoftwareVersion,
    /// 0x2001–0x2040, the occurrence counter of a fault (A)
    FaultCount(Fault),
    /// 0x3300
    SetPointPer127,
    /// 0x3301
    ActualPer127,
    /// 0x3302
    ActualInverted,
    /// 0x3303
    SetPointPer1000,
    /// 0x3304
    ActualPer1000,
    /// 0x6040
    ControlWord,
    /// 0x6041
    StatusWord,
    /// 0x6042
    DeviceMode,
    /// 0x6052, decimal (A)
    SerialNumber,
    /// 0x6053
    Description,
    /// 0x6300:1
    SetPoint,
    /// 0x6301:1
    Actual,
}

/// The tasks that signatures in 0x1010 and 0x1011 demand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// "save"
    Save,
    /// "load"
    Load,
    /// Clear the occurrence counters.
    ClearCounters,
}

/// The full stroke in 0x6300 and 0x6301.
const FULL: i32 = Position::FULL as i32;

/// The maximum value of object 0x1017.
pub(super) const HEARTBEAT_MAX: u16 = 0x7FFF;

/// The maximum length of object 0x6053.
pub(super) const DESCRIPTION_MAX: usize = 10;

/// The mapping entry for a gap of one bit.
const DUMMY: u32 = 0x0001_0001;

/// The length of object 0x100A.
const SOFTWARE_VERSION_LEN: u8 = 47;

/// The signature of 0x1011:5 that clears the occurrence counters: "pkds".
const CLEAR_COUNTERS: u32 = 0x7364_6B70;

/// Returns the description of an object; `None` if the object does not exist.
#[must_use]
pub fn entry(object: Multiplexer) -> Option<&'static Entry> {
    DICTIONARY.entries().find(object).ok().map(|place| place.entry)
}

/// All objects of a CANopen valve.
pub(super) const DICTIONARY: Dictionary<Object<ValveObject, Task>> = Dictionary::new(&Table::new([
    Row::constant(0x1000, 0, U32, 0x0000_0198, "Device type"),
    Row::ro(0x1001, 0, U8, ErrorRegister, "Error register"),
    Row::rw(0x1003, 0, U8, Node(ErrorCount), "Pre-defined error field: number of errors"),
    Row::ro(0x1003, 1, U32, Node(ErrorField), "Pre-defined error field 1"),
    Row::ro(0x1003, 2, U32, Node(ErrorField), "Pre-defined error field 2"),
    Row::ro(0x1003, 3, U32, Node(ErrorField), "Pre-defined error field 3"),
    Row::ro(0x1003, 4, U32, Node(ErrorField), "Pre-defined error field 4"),
    Row::ro(0x1003, 5, U32, Node(ErrorField), "Pre-defined error field 5"),
    Row::ro(0x1003, 6, U32, Node(ErrorField), "Pre-defined error field 6"),
    Row::ro(0x1003, 7, U32, Node(ErrorField), "Pre-defined error field 7"),
    Row::ro(0x1003, 8, U32, Node(ErrorField), "Pre-defined error field 8"),
    Row::rw(0x1005, 0, U32, Node(SyncCobId), "COB-ID SYNC").stored(Number(SyncConsumer::DEFAULT)),
    Row::ro(0x100A, 0, Text(SOFTWARE_VERSION_LEN), Product(SoftwareVersion), "Manufacturer software version"),
    Row::constant(0x1010, 0, U8, 1, "Store parameters: highest sub-index"),
    Row::signature(0x1010, 1, SAVE, Save, "Store all parameters"),
    Row::constant(0x1011, 0, U8, 5, "Restore default parameters: highest sub-index"),
    Row::signature(0x1011, 1, LOAD, Load, "Restore all default parameters"),
    Row::signature(0x1011, 5, CLEAR_COUNTERS, ClearCounters, "Clear occurrence counters"),
    Row::ro(0x1014, 0, U32, Node(EmcyCobId), "COB-ID EMCY"),
    Row::rw(0x1017, 0, U16, Node(HeartbeatTime), "Producer heartbeat time")
        .within(0, HEARTBEAT_MAX as i32)
        .stored(Number(0)),
    // (R) Sub-index 0 reads 3 although sub-index 4 can be read: the real device does so.
    Row::constant(0x1018, 0, U8, 3, "Identity object: highest sub-index"),
    Row::ro(0x1018, 1, U32, Identity, "Vendor ID"),
    Row::ro(0x1018, 2, U32, Identity, "Product code"),
    Row::ro(0x1018, 3, U32, Identity, "Revision number"),
    Row::ro(0x1018, 4, U32, Identity, "Serial number"),
    Row::constant(0x1028, 0, U8, 1, "Emergency consumer: highest sub-index"),
    Row::rw(0x1028, 1, U32, Node(EmcyConsumer), "Emergency consumer 1").stored(Number(emcy::EmcyConsumer::DEFAULT)),
    Row::constant(0x1400, 0, U8, 2, "RPDO 1 communication: highest sub-index"),
    Row::rw(0x1400, 1, U32, Node(Rpdo(CobId)), "RPDO 1 COB-ID").stored(NodeIdPlus(Function::Rpdo1 as u32)),
    Row::rw(0x1400, 2, U8, Node(Rpdo(TransmissionType)), "RPDO 1 transmission type")
        .within(0xFF, 0xFF)
        .stored(Number(0xFF)),
    Row::rw(0x1600, 0, U8, Node(Rpdo(Count)), "RPDO 1 mapping: number of objects")
        .within(0, pdo::ENTRIES as i32)
        .stored(Number(2)),
    Row::rw(0x1600, 1, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 1").stored(Number(0x6040_0010)),
    Row::rw(0x1600, 2, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 2").stored(Number(0x6300_0110)),
    Row::rw(0x1600, 3, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 3").stored(Number(DUMMY)),
    Row::rw(0x1600, 4, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 4").stored(Number(DUMMY)),
    Row::rw(0x1600, 5, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 5").stored(Number(DUMMY)),
    Row::rw(0x1600, 6, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 6").stored(Number(DUMMY)),
    Row::rw(0x1600, 7, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 7").stored(Number(DUMMY)),
    Row::rw(0x1600, 8, U32, Node(Rpdo(Mapped)), "RPDO 1 mapping 8").stored(Number(DUMMY)),
    Row::constant(0x1800, 0, U8, 2, "TPDO 1 communication: highest sub-index"),
    Row::rw(0x1800, 1, U32, Node(Tpdo(CobId)), "TPDO 1 COB-ID").stored(NodeIdPlus(Function::Tpdo1 as u32)),
    Row::rw(0x1800, 2, U8, Node(Tpdo(TransmissionType)), "TPDO 1 transmission type").stored(Number(0xFF)),
    Row::rw(0x1A00, 0, U8, Node(Tpdo(Count)), "TPDO 1 mapping: number of objects")
        .within(0, pdo::ENTRIES as i32)
        .stored(Number(2)),
    Row::rw(0x1A00, 1, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 1").stored(Number(0x6041_0010)),
    Row::rw(0x1A00, 2, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 2").stored(Number(0x6301_0110)),
    Row::rw(0x1A00, 3, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 3").stored(Number(DUMMY)),
    Row::rw(0x1A00, 4, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 4").stored(Number(DUMMY)),
    Row::rw(0x1A00, 5, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 5").stored(Number(DUMMY)),
    Row::rw(0x1A00, 6, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 6").stored(Number(DUMMY)),
    Row::rw(0x1A00, 7, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 7").stored(Number(DUMMY)),
    Row::rw(0x1A00, 8, U32, Node(Tpdo(Mapped)), "TPDO 1 mapping 8").stored(Number(DUMMY)),
    Row::ro(0x2001, 0, U8, Product(FaultCount(Fault::SupplyHigh)), "Error: supply voltage too high")
        .within(0, COUNTER_MAX as i32),
    Row::ro(0x2002, 0, U8, Product(FaultCount(Fault::SupplyLow)), "Error: supply voltage too low")
        .within(0, COUNTER_MAX as i32),
    Row::ro(0x200F, 0, U8, Product(FaultCount(Fault::Temperature)), "Error: temperature").within(0, COUNTER_MAX as i32),
    Row::ro(0x2019, 0, U8, Product(FaultCount(Fault::CanBus)), "Error: CAN bus").within(0, COUNTER_MAX as i32),
    Row::ro(
        0x201D,
        0,
        U8,
        Product(FaultCount(Fault::SpoolNotAtSetPoint)),
        "Error: spool not at set-point or float not reached",
    )
    .within(0, COUNTER_MAX as i32),
    // (R) The manual describes a spool position not reached. Code and EDS name belong to time guarding.
    Row::ro(0x2023, 0, U8, Product(FaultCount(Fault::TimeGuarding)), "Error: set-point timeout")
        .within(0, COUNTER_MAX as i32),
    // (R) 0x2040 according to the EDS list; the object table prints 0x2024.
    Row::ro(0x2024, 0, U8, Product(FaultCount(Fault::Internal)), "Error: internal error").within(0, COUNTER_MAX as i32),
    Row::ro(0x2040, 0, U8, Product(FaultCount(Fault::Internal)), "Error: internal error (second index)")
        .within(0, COUNTER_MAX as i32),
    Row::rw(0x3300, 0, I8, Product(SetPointPer127), "Set-point, 8 bit").within(-127, 127).mappable(Mappable::Rpdo),
    Row::ro(0x3301, 0, I8, Product(ActualPer127), "Actual value, 8 bit").within(-127, 127).mappable(Mappable::Tpdo),
    Row::ro(0x3302, 0, I8, Product(ActualInverted), "Actual value, 8 bit, inverted")
        .within(-127, 127)
        .mappable(Mappable::Tpdo),
    Row::rw(0x3303, 0, I16, Product(SetPointPer1000), "Set-point, 16 bit").within(-1000, 1000).mappable(Mappable::Rpdo),
    // (R) The manual's list of mappable objects calls this a status word.
    Row::ro(0x3304, 0, I16, Product(ActualPer1000), "Actual value, 16 bit")
        .within(-1000, 1000)
        .mappable(Mappable::Tpdo),
    Row::rw(0x6040, 0, U16, Product(ControlWord), "Device control word").mappable(Mappable::Rpdo),
    Row::ro(0x6041, 0, U16, Product(StatusWord), "Device status word").mappable(Mappable::Tpdo),
    Row::rw(0x6042, 0, I8, Product(DeviceMode), "Device mode").within(1, 2).mappable(Mappable::Rpdo),
    Row::ro(0x6052, 0, Text(DIGITS as u8), Product(SerialNumber), "Device serial number"),
    Row::rw(0x6053, 0, Text(DESCRIPTION_MAX as u8), Product(Description), "Device description")
        .stored(DefaultValue::Product),
    Row::constant(0x605F, 0, U32, 0x0500_0000, "Device capability"),
    Row::constant(0x6300, 0, U8, 1, "VPOC set-point: highest sub-index"),
    Row::rw(0x6300, 1, I16, Product(SetPoint), "VPOC set-point").within(-FULL, FLOAT as i32).mappable(Mappable::Rpdo),
    Row::constant(0x6301, 0, U8, 1, "VPOC actual value: highest sub-index"),
    Row::ro(0x6301, 1, I16, Product(Actual), "VPOC actual value").within(-FULL, FLOAT as i32).mappable(Mappable::Tpdo),
]));
