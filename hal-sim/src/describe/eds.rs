//! The electronic data sheet of a CANopen product (CiA 306), generated from its object dictionary.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use protocol_core::canopen::dictionary::{Access, DataType, Entry, Initial, Mappable, Value};
use protocol_core::controller::BitRate;
use protocol_core::device::{Capabilities, describe};

use super::product::Product;
use crate::Kind;

/// The CiA 306 version of the sheet.
const EDS_VERSION: &str = "4.0";

/// The date of the sheet's first version, month first: constant, so that the output is reproducible.
const DATE: &str = "11-22-2026";
const TIME: &str = "12:00AM";

/// The mandatory objects of CiA 301.
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];

/// The comments of the sheet, the only place for such text in CiA 306.
const COMMENTS: [&str; 3] = [
    "Of a stand-in for the product, written by pve-sim from its object dictionary.",
    "A serial number differs from device to device: it has no default.",
    "Where sub-indices have gaps, sub-index 0 is what the product says and not their count.",
];

/// An object with its sub-indices, as listed in the sheet.
#[derive(Default)]
struct Object {
    rows: Vec<Row>,
}

struct Row {
    entry: &'static Entry,
    default: Option<String>,
}

/// Generates the EDS of a product, in ASCII; `None` for a kind without an object dictionary.
#[must_use]
pub fn eds(kind: Kind) -> Option<String> {
    let mut objects = BTreeMap::<u16, Object>::new();
    let mut identity = [0; 5];
    let capabilities = describe(kind, |entry, initial| {
        if let (0x1018, Initial::Fixed(Value::Number(number))) = (entry.object().index, initial)
            && let Some(part) = identity.get_mut(usize::from(entry.object().sub))
        {
            *part = number;
        }
        let row = Row { entry, default: default(entry.data_type(), initial) };
        objects.entry(entry.object().index).or_default().rows.push(row);
    })?;
    let mut sheet = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut sheet, kind, identity, capabilities, &objects);
    Some(sheet)
}

fn write(
    out: &mut String,
    kind: Kind,
    identity: [u32; 5],
    capabilities: Capabilities,
    objects: &BTreeMap<u16, Object>,
) -> std::fmt::Result {
    let Product { vendor, name, order_code } = Product::of(kind);
    let [_, vendor_number, product, revision, _] = identity;
    writeln!(out, "[FileInfo]\nFileName={kind}.eds\nFileVersion=1\nFileRevision=0\nEDSVersion={EDS_VERSION}")?;
    writeln!(out, "Description={vendor} {name}\nCreationTime={TIME}\nCreationDate={DATE}\nCreatedBy=pve-sim")?;
    writeln!(out, "ModificationTime={TIME}\nModificationDate={DATE}\nModifiedBy=pve-sim\n")?;

    writeln!(out, "[DeviceInfo]\nVendorName={vendor}\nVendorNumber=0x{vendor_number:08X}\nProductName={name}")?;
    writeln!(out, "ProductNumber=0x{product:08X}\nRevisionNumber=0x{revision:08X}\nOrderCode={order_code}")?;
    for rate in BitRate::ALL.iter().rev() {
        let has = u8::from(kind.bit_rates().contains(rate));
        writeln!(out, "BaudRate_{}={has}", rate.bits_per_second() / 1000)?;
    }
    let pdos = |range: std::ops::RangeInclusive<u16>| objects.range(range).count();
    writeln!(out, "SimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=8\nDynamicChannelsSupported=0")?;
    writeln!(out, "GroupMessaging=0\nNrOfRXPDO={}\nNrOfTXPDO={}", pdos(0x1400..=0x15FF), pdos(0x1800..=0x19FF))?;
    writeln!(out, "LSS_Supported=1\n")?;

    writeln!(out, "[DummyUsage]")?;
    for dummy in 1..=7 {
        writeln!(out, "Dummy{dummy:04}={}", u8::from(capabilities.dummies))?;
    }
    writeln!(out, "\n[Comments]\nLines={}", COMMENTS.len())?;
    for (number, line) in (1..).zip(COMMENTS) {
        writeln!(out, "Line{number}={line}")?;
    }
    writeln!(out)?;

    let is_manufacturers = |index: &u16| matches!(index, 0x2000..=0x5FFF);
    let indices = || objects.keys();
    list(out, "MandatoryObjects", indices().filter(|index| MANDATORY.contains(index)))?;
    list(out, "OptionalObjects", indices().filter(|index| !MANDATORY.contains(index) && !is_manufacturers(index)))?;
    list(out, "ManufacturerObjects", indices().filter(|index| is_manufacturers(index)))?;
    for (index, object) in objects {
        object.write(out, *index)?;
    }
    Ok(())
}

fn list<'a>(out: &mut String, section: &str, indices: impl Iterator<Item = &'a u16> + Clone) -> std::fmt::Result {
    writeln!(out, "[{section}]\nSupportedObjects={}", indices.clone().count())?;
    for (number, index) in (1..).zip(indices) {
        writeln!(out, "{number}=0x{index:04X}")?;
    }
    writeln!(out)
}

/// CiA 301 7.4.3
const VAR: u8 = 7;
const ARRAY: u8 = 8;
const RECORD: u8 = 9;

impl Object {
    fn write(&self, out: &mut String, index: u16) -> std::fmt::Result {
        let [Row { entry: first, .. }, rest @ ..] = &self.rows[..] else { return Ok(()) };
        if rest.is_empty() && first.object().sub == 0 {
            writeln!(out, "[{index:04X}]\nParameterName={}", first.name)?;
            return self.rows.iter().try_for_each(|row| row.write(out));
        }
        let (own, _) = names(first);
        let object_type = if is_record(index) { RECORD } else { ARRAY };
        writeln!(out, "[{index:04X}]\nParameterName={own}\nObjectType={object_type}\nSubNumber={}\n", self.rows.len())?;
        for row in &self.rows {
            let sub = row.entry.object().sub;
            let name = if sub == 0 { names(row.entry).1 } else { row.entry.name.to_owned() };
            writeln!(out, "[{index:04X}sub{sub:X}]\nParameterName={name}")?;
            row.write(out)?;
        }
        Ok(())
    }
}

impl Row {
    /// Writes all entries except the name.
    fn write(&self, out: &mut String) -> std::fmt::Result {
        let mappable = self.entry.mappable();
        writeln!(out, "ObjectType={VAR}\nDataType=0x{:04X}", type_index(self.entry.data_type()))?;
        if let Some((low, high)) = self.entry.limits {
            writeln!(out, "LowLimit={low}\nHighLimit={high}")?;
        }
        writeln!(out, "AccessType={}", access_type(self.entry.access(), mappable))?;
        if let Some(default) = &self.default {
            writeln!(out, "DefaultValue={default}")?;
        }
        writeln!(out, "PDOMapping={}\n", u8::from(mappable != Mappable::No))
    }
}

/// Returns the capitalised names of an object and of its sub-index 0, which one table row combines.
fn names(entry: &Entry) -> (&'static str, String) {
    let (object, own) = entry.name.split_once(": ").unwrap_or((entry.name, "highest sub-index"));
    let mut letters = own.chars();
    let first = letters.next().map(|letter| letter.to_ascii_uppercase());
    (object, first.into_iter().chain(letters).collect())
}

/// Returns whether CiA 301 or the device profile defines a record at an index; all others are arrays.
const fn is_record(index: u16) -> bool {
    matches!(index, 0x1018 | 0x1400..=0x1BFF | 0x6300 | 0x6301)
}

/// Returns the index of a data type (CiA 301 7.4.7.1).
const fn type_index(data_type: DataType) -> u16 {
    match data_type {
        DataType::I8 => 0x0002,
        DataType::I16 => 0x0003,
        DataType::I32 => 0x0004,
        DataType::U8 => 0x0005,
        DataType::U16 => 0x0006,
        DataType::U32 => 0x0007,
        DataType::Text(_) => 0x0009,
    }
}

/// Returns the access by SDO and PDO: `rww` can be mapped into RPDOs only, `rwr` into TPDOs only.
const fn access_type(access: Access, mappable: Mappable) -> &'static str {
    match (access, mappable) {
        (Access::Ro, _) => "ro",
        (Access::Rw, Mappable::No) => "rw",
        (Access::Rw, Mappable::Rpdo) => "rww",
        (Access::Rw, Mappable::Tpdo) => "rwr",
    }
}

/// Formats a default value for the sheet; `None` if there is none.
fn default(data_type: DataType, initial: Initial<'_>) -> Option<String> {
    match initial {
        Initial::Individual => None,
        Initial::NodeIdPlus(base) => Some(format!("$NODEID+0x{base:X}")),
        Initial::Fixed(Value::Text(text)) => Some(String::from_utf8_lossy(text).into_owned()),
        Initial::Fixed(Value::Number(number)) => Some(match data_type {
            DataType::I8 => (number as u8 as i8).to_string(),
            DataType::I16 => (number as u16 as i16).to_string(),
            DataType::I32 => (number as i32).to_string(),
            DataType::U32 => format!("0x{number:08X}"),
            DataType::U8 | DataType::U16 | DataType::Text(_) => number.to_string(),
        }),
    }
}

#[cfg(test)]
#[path = "eds_tests.rs"]
mod tests;
