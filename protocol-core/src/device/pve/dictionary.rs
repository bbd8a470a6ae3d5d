//! The object dictionary of the CANopen kinds (SPEC 4.1), as one table.

use crate::canopen::dictionary::Access::{Ro, Rw};
use crate::canopen::dictionary::DataType::{I8, I16, Text, U8, U16, U32};
use crate::canopen::dictionary::Default::{NodeIdPlus, Number, Product};
use crate::canopen::dictionary::Mappable::{Rpdo, Tpdo};
use crate::canopen::dictionary::{Entry, Table};
use crate::canopen::emcy::EmcyConsumer;
use crate::canopen::sync::SyncConsumer;
use crate::wire::cob_id::Function;

/// How many characters object 0x6053 takes.
pub(super) const DESCRIPTION_MAX: usize = 10;

/// How many characters the serial number has at the most: a decimal u32.
pub(super) const SERIAL_MAX: usize = 10;

/// A mapping entry that stands for a gap of one bit.
const DUMMY: u32 = 0x0001_0001;

/// How many characters the software version has.
const SOFTWARE_VERSION_LEN: u8 = 47;

/// Every object of a valve on CANopen, and no other.
pub const TABLE: Table = Table::new(&[
    Entry::new(0x1000, 0, U32, Ro, "Device type").default(0x0000_0198),
    Entry::new(0x1001, 0, U8, Ro, "Error register"),
    Entry::new(0x1003, 0, U8, Rw, "Pre-defined error field: number of errors"),
    Entry::new(0x1003, 1, U32, Ro, "Pre-defined error field 1"),
    Entry::new(0x1003, 2, U32, Ro, "Pre-defined error field 2"),
    Entry::new(0x1003, 3, U32, Ro, "Pre-defined error field 3"),
    Entry::new(0x1003, 4, U32, Ro, "Pre-defined error field 4"),
    Entry::new(0x1003, 5, U32, Ro, "Pre-defined error field 5"),
    Entry::new(0x1003, 6, U32, Ro, "Pre-defined error field 6"),
    Entry::new(0x1003, 7, U32, Ro, "Pre-defined error field 7"),
    Entry::new(0x1003, 8, U32, Ro, "Pre-defined error field 8"),
    Entry::new(0x1005, 0, U32, Rw, "COB-ID SYNC").stored(Number(SyncConsumer::DEFAULT)),
    Entry::new(0x100A, 0, Text(SOFTWARE_VERSION_LEN), Ro, "Manufacturer software version"),
    Entry::new(0x1010, 0, U8, Ro, "Store parameters: highest sub-index").default(1),
    Entry::new(0x1010, 1, U32, Rw, "Store all parameters").default(1),
    Entry::new(0x1011, 0, U8, Ro, "Restore default parameters: highest sub-index").default(5),
    Entry::new(0x1011, 1, U32, Rw, "Restore all default parameters").default(1),
    Entry::new(0x1011, 5, U32, Rw, "Clear occurrence counters").default(1),
    Entry::new(0x1014, 0, U32, Ro, "COB-ID EMCY"),
    Entry::new(0x1017, 0, U16, Rw, "Producer heartbeat time").stored(Number(0)),
    // (R) sub-index 0 reads 3 although sub-index 4 can be read: the real device does so
    Entry::new(0x1018, 0, U8, Ro, "Identity object: highest sub-index").default(3),
    Entry::new(0x1018, 1, U32, Ro, "Vendor ID"),
    Entry::new(0x1018, 2, U32, Ro, "Product code"),
    Entry::new(0x1018, 3, U32, Ro, "Revision number"),
    Entry::new(0x1018, 4, U32, Ro, "Serial number"),
    Entry::new(0x1028, 0, U8, Ro, "Emergency consumer: highest sub-index").default(1),
    Entry::new(0x1028, 1, U32, Rw, "Emergency consumer 1").stored(Number(EmcyConsumer::DEFAULT)),
    Entry::new(0x1400, 0, U8, Ro, "RPDO 1 communication: highest sub-index").default(2),
    Entry::new(0x1400, 1, U32, Rw, "RPDO 1 COB-ID").stored(NodeIdPlus(Function::Rpdo1 as u32)),
    Entry::new(0x1400, 2, U8, Rw, "RPDO 1 transmission type").stored(Number(0xFF)),
    Entry::new(0x1600, 0, U8, Rw, "RPDO 1 mapping: number of objects").stored(Number(2)),
    Entry::new(0x1600, 1, U32, Rw, "RPDO 1 mapping 1").stored(Number(0x6040_0010)),
    Entry::new(0x1600, 2, U32, Rw, "RPDO 1 mapping 2").stored(Number(0x6300_0110)),
    Entry::new(0x1600, 3, U32, Rw, "RPDO 1 mapping 3").stored(Number(DUMMY)),
    Entry::new(0x1600, 4, U32, Rw, "RPDO 1 mapping 4").stored(Number(DUMMY)),
    Entry::new(0x1600, 5, U32, Rw, "RPDO 1 mapping 5").stored(Number(DUMMY)),
    Entry::new(0x1600, 6, U32, Rw, "RPDO 1 mapping 6").stored(Number(DUMMY)),
    Entry::new(0x1600, 7, U32, Rw, "RPDO 1 mapping 7").stored(Number(DUMMY)),
    Entry::new(0x1600, 8, U32, Rw, "RPDO 1 mapping 8").stored(Number(DUMMY)),
    Entry::new(0x1800, 0, U8, Ro, "TPDO 1 communication: highest sub-index").default(2),
    Entry::new(0x1800, 1, U32, Rw, "TPDO 1 COB-ID").stored(NodeIdPlus(Function::Tpdo1 as u32)),
    Entry::new(0x1800, 2, U8, Rw, "TPDO 1 transmission type").stored(Number(0xFF)),
    Entry::new(0x1A00, 0, U8, Rw, "TPDO 1 mapping: number of objects").stored(Number(2)),
    Entry::new(0x1A00, 1, U32, Rw, "TPDO 1 mapping 1").stored(Number(0x6041_0010)),
    Entry::new(0x1A00, 2, U32, Rw, "TPDO 1 mapping 2").stored(Number(0x6301_0110)),
    Entry::new(0x1A00, 3, U32, Rw, "TPDO 1 mapping 3").stored(Number(DUMMY)),
    Entry::new(0x1A00, 4, U32, Rw, "TPDO 1 mapping 4").stored(Number(DUMMY)),
    Entry::new(0x1A00, 5, U32, Rw, "TPDO 1 mapping 5").stored(Number(DUMMY)),
    Entry::new(0x1A00, 6, U32, Rw, "TPDO 1 mapping 6").stored(Number(DUMMY)),
    Entry::new(0x1A00, 7, U32, Rw, "TPDO 1 mapping 7").stored(Number(DUMMY)),
    Entry::new(0x1A00, 8, U32, Rw, "TPDO 1 mapping 8").stored(Number(DUMMY)),
    Entry::new(0x2001, 0, U8, Ro, "Error: supply voltage too high"),
    Entry::new(0x2002, 0, U8, Ro, "Error: supply voltage too low"),
    Entry::new(0x200F, 0, U8, Ro, "Error: temperature"),
    Entry::new(0x2019, 0, U8, Ro, "Error: CAN bus"),
    Entry::new(0x201D, 0, U8, Ro, "Error: spool not at set-point or float not reached"),
    // (R) the manual describes it as a spool position that is not reached; it is time guarding
    Entry::new(0x2023, 0, U8, Ro, "Error: set-point timeout"),
    Entry::new(0x2024, 0, U8, Ro, "Error: internal error"),
    Entry::new(0x2040, 0, U8, Ro, "Error: internal error (second index)"),
    Entry::new(0x3300, 0, I8, Rw, "Set-point, 8 bit").mappable(Rpdo),
    Entry::new(0x3301, 0, I8, Ro, "Actual value, 8 bit").mappable(Tpdo),
    Entry::new(0x3302, 0, I8, Ro, "Actual value, 8 bit, inverted").mappable(Tpdo),
    Entry::new(0x3303, 0, I16, Rw, "Set-point, 16 bit").mappable(Rpdo),
    // (R) the manual's list of mappable objects calls it a status word
    Entry::new(0x3304, 0, I16, Ro, "Actual value, 16 bit").mappable(Tpdo),
    Entry::new(0x6040, 0, U16, Rw, "Device control word").mappable(Rpdo),
    Entry::new(0x6041, 0, U16, Ro, "Device status word").mappable(Tpdo),
    Entry::new(0x6042, 0, I8, Rw, "Device mode").mappable(Rpdo),
    Entry::new(0x6052, 0, Text(SERIAL_MAX as u8), Ro, "Device serial number"),
    Entry::new(0x6053, 0, Text(DESCRIPTION_MAX as u8), Rw, "Device description").stored(Product),
    Entry::new(0x605F, 0, U32, Ro, "Device capability").default(0x0500_0000),
    Entry::new(0x6300, 0, U8, Ro, "VPOC set-point: highest sub-index").default(1),
    Entry::new(0x6300, 1, I16, Rw, "VPOC set-point").mappable(Rpdo),
    Entry::new(0x6301, 0, U8, Ro, "VPOC actual value: highest sub-index").default(1),
    Entry::new(0x6301, 1, I16, Ro, "VPOC actual value").mappable(Tpdo),
]);
