//! The object dictionary (CiA 301 7.4): a const table for each product.
//!
//! The table determines look-up, access with its abort codes, PDO mapping, "save" and the default values. The compiler
//! splits the table. Its [`Entries`] do not depend on the product, so services that need only them are compiled once
//! for all products of an image. Each entry has a tag, `behind`, at the same position. The tag selects the code that
//! serves the object.

use crate::wire::sdo::{AbortCode, Multiplexer};

/// The maximum length of a text object. The longest text, the manufacturer software version, has 47 characters.
pub const TEXT_MAX: usize = 64;

/// The type of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataType {
    /// UNSIGNED8
    U8,
    /// UNSIGNED16
    U16,
    /// UNSIGNED32
    U32,
    /// INTEGER8
    I8,
    /// INTEGER16
    I16,
    /// INTEGER32
    I32,
    /// VISIBLE_STRING of at most this many characters.
    Text(u8),
}

/// The SDO access to an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
}

/// The kind of PDO into which an object can be mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mappable {
    /// None.
    No,
    /// RPDO.
    Rpdo,
    /// TPDO.
    Tpdo,
}

/// The default of a stored object. It applies while the memory holds no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefaultValue {
    /// A number, as the raw bits of its type.
    Number(u32),
    /// A number plus the node ID, `$NODEID+…` in an EDS.
    NodeIdPlus(u32),
    /// A text that the product supplies.
    Product,
}

/// The value of an object in a new device, for an EDS.
#[cfg(feature = "names")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initial<'a> {
    /// The same value in every device of the product.
    Fixed(Value<'a>),
    /// A number plus the node ID, `$NODEID+…` in an EDS.
    NodeIdPlus(u32),
    /// No common value: a serial number differs in each device, and a new device has no error entries.
    Individual,
}

/// A group of objects that a sub-index of 0x1010 stores together (CiA 301 7.5.2.13).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// All stored objects.
    All,
    /// The objects 0x1000–0x1FFF.
    Communication,
    /// The objects 0x6000–0x9FFF.
    Application,
}

impl Group {
    const fn has(self, index: u16) -> bool {
        match self {
            Self::All => true,
            Self::Communication => matches!(index, 0x1000..=0x1FFF),
            Self::Application => matches!(index, 0x6000..=0x9FFF),
        }
    }
}

/// The description of an object, packed into eight bytes, because a product has about 80 objects.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Index and sub-index, the sort key of the entries, in the upper 24 bits; the [`flags`] in the lowest byte.
    packed: u32,
    /// The maximum length of a text, the default of a stored object, or the value of a constant.
    number: u32,
    /// The name in an EDS. Sub-index 0 of an object with sub-indices also carries the name of the object, before a
    /// colon ("Identity object: highest sub-index").
    #[cfg(feature = "names")]
    pub name: &'static str,
    /// The minimum and maximum; `None` for the full range of the type, and for a text.
    #[cfg(feature = "names")]
    pub limits: Option<(i32, i32)>,
}

/// The flags in the lowest byte of an entry.
mod flags {
    pub(super) const ALL: u32 = 0xFF;
    /// The data type. The lower two bits of a number are the binary logarithm of its size in bytes.
    pub(super) const TYPE: u32 = 0b111;
    pub(super) const U8: u32 = 0b000;
    pub(super) const U16: u32 = 0b001;
    pub(super) const U32: u32 = 0b010;
    pub(super) const I8: u32 = 0b100;
    pub(super) const I16: u32 = 0b101;
    pub(super) const I32: u32 = 0b110;
    pub(super) const TEXT: u32 = 0b111;
    /// Set for an object that SDO can write.
    pub(super) const WRITABLE: u32 = 1 << 3;
    /// The kind of PDO into which the object can be mapped.
    pub(super) const MAPPABLE: u32 = 0b11 << 4;
    pub(super) const RPDO: u32 = 0b01 << 4;
    pub(super) const TPDO: u32 = 0b10 << 4;
    /// The kind of default of a stored object; 0 for an object that "save" does not store.
    pub(super) const DEFAULT: u32 = 0b11 << 6;
    pub(super) const NUMBER: u32 = 0b01 << 6;
    pub(super) const NODE_ID_PLUS: u32 = 0b10 << 6;
    pub(super) const PRODUCT: u32 = 0b11 << 6;
}

impl Entry {
    /// Creates an entry, without its name unless the feature `names` is on.
    #[cfg_attr(not(feature = "names"), allow(unused_variables))]
    const fn new(object: Multiplexer, data_type: DataType, access: Access, name: &'static str) -> Self {
        let (data_type, number) = match data_type {
            DataType::U8 => (flags::U8, 0),
            DataType::U16 => (flags::U16, 0),
            DataType::U32 => (flags::U32, 0),
            DataType::I8 => (flags::I8, 0),
            DataType::I16 => (flags::I16, 0),
            DataType::I32 => (flags::I32, 0),
            DataType::Text(max) => (flags::TEXT, max as u32),
        };
        let access = match access {
            Access::Ro => 0,
            Access::Rw => flags::WRITABLE,
        };
        Self {
            packed: key(object) << 8 | access | data_type,
            number,
            #[cfg(feature = "names")]
            name,
            #[cfg(feature = "names")]
            limits: None,
        }
    }

    /// Returns the index and sub-index.
    #[inline]
    #[must_use]
    pub const fn object(&self) -> Multiplexer {
        Multiplexer::new((self.packed >> 16) as u16, self.sub())
    }

    /// Returns the sub-index.
    #[inline]
    #[must_use]
    pub const fn sub(&self) -> u8 {
        (self.packed >> 8) as u8
    }

    /// Returns the data type.
    #[must_use]
    pub const fn data_type(&self) -> DataType {
        match self.packed & flags::TYPE {
            flags::U8 => DataType::U8,
            flags::U16 => DataType::U16,
            flags::U32 => DataType::U32,
            flags::I8 => DataType::I8,
            flags::I16 => DataType::I16,
            flags::I32 => DataType::I32,
            _ => DataType::Text(self.number as u8),
        }
    }

    /// Returns whether the object is a text.
    #[inline]
    #[must_use]
    pub const fn is_text(&self) -> bool {
        self.packed & flags::TYPE == flags::TEXT
    }

    /// Returns the size of a number in bytes, or the maximum length of a text.
    #[inline]
    #[must_use]
    pub const fn size(&self) -> u8 {
        if self.is_text() { self.number as u8 } else { 1_u8.wrapping_shl(self.packed & 0b11) }
    }

    /// Checks the length of a value for the object.
    ///
    /// # Errors
    /// Returns [`AbortCode::TOO_LONG`] or, for numbers only, [`AbortCode::TOO_SHORT`].
    pub(super) fn check_length(&self, len: usize) -> Result<(), AbortCode> {
        let size = usize::from(self.size());
        if len > size {
            Err(AbortCode::TOO_LONG)
        } else if len < size && !self.is_text() {
            Err(AbortCode::TOO_SHORT)
        } else {
            Ok(())
        }
    }

    /// Decodes a value of the object from its bytes. Missing bytes of a number are 0.
    #[inline]
    #[must_use]
    pub fn value<'a>(&self, bytes: &'a [u8]) -> Value<'a> {
        if self.is_text() { Value::Text(bytes) } else { Value::Number(number(bytes)) }
    }

    /// Returns the SDO access.
    #[inline]
    #[must_use]
    pub const fn access(&self) -> Access {
        if self.packed & flags::WRITABLE == 0 { Access::Ro } else { Access::Rw }
    }

    /// Returns the kind of PDO into which the object can be mapped.
    #[must_use]
    pub const fn mappable(&self) -> Mappable {
        match self.packed & flags::MAPPABLE {
            flags::RPDO => Mappable::Rpdo,
            flags::TPDO => Mappable::Tpdo,
            _ => Mappable::No,
        }
    }

    /// Returns whether "save" stores the object.
    #[inline]
    #[must_use]
    pub const fn is_stored(&self) -> bool {
        self.packed & flags::DEFAULT != 0
    }

    /// Returns the default; `None` for an object that "save" does not store.
    #[must_use]
    pub const fn default(&self) -> Option<DefaultValue> {
        match self.packed & flags::DEFAULT {
            flags::NUMBER => Some(DefaultValue::Number(self.number)),
            flags::NODE_ID_PLUS => Some(DefaultValue::NodeIdPlus(self.number)),
            flags::PRODUCT => Some(DefaultValue::Product),
            _ => None,
        }
    }

    /// Returns the number that [`with`](Row::with) has set, such as the value of a constant.
    #[inline]
    pub(super) const fn number(&self) -> u32 {
        self.number
    }
}

/// A row of the dictionary: the description of an object, and its tag `behind`. The tag selects the code that serves
/// the object.
///
/// Services match on the tag, not on the index, so that the compiler refuses a tag without code.
#[derive(Clone, Copy, Debug)]
pub struct Row<B> {
    entry: Entry,
    behind: B,
}

impl<B: Copy> Row<B> {
    /// Creates the row of a read-only object, not mappable and not stored.
    #[must_use]
    pub const fn ro(index: u16, sub: u8, data_type: DataType, behind: B, name: &'static str) -> Self {
        Self { entry: Entry::new(Multiplexer::new(index, sub), data_type, Access::Ro, name), behind }
    }

    /// Creates the row of a read-write object, not mappable and not stored.
    #[must_use]
    pub const fn rw(index: u16, sub: u8, data_type: DataType, behind: B, name: &'static str) -> Self {
        Self { entry: Entry::new(Multiplexer::new(index, sub), data_type, Access::Rw, name), behind }
    }

    /// Makes the object mappable.
    #[must_use]
    pub const fn mappable(self, mappable: Mappable) -> Self {
        self.flagged(match mappable {
            Mappable::No => 0,
            Mappable::Rpdo => flags::RPDO,
            Mappable::Tpdo => flags::TPDO,
        })
    }

    /// Sets the minimum and maximum for the EDS. Only the code that serves the object enforces them. Has no effect
    /// unless the feature `names` is on.
    #[must_use]
    #[cfg_attr(not(feature = "names"), allow(unused_variables))]
    pub const fn within(self, low: i32, high: i32) -> Self {
        #[cfg(feature = "names")]
        return Self { entry: Entry { limits: Some((low, high)), ..self.entry }, ..self };
        #[cfg(not(feature = "names"))]
        self
    }

    /// Makes "save" store the object, with this default.
    ///
    /// # Panics
    /// Panics for a numeric default of a text; in a const this is a compile error.
    #[must_use]
    pub const fn stored(self, default: DefaultValue) -> Self {
        match default {
            DefaultValue::Number(number) => self.with(number).flagged(flags::NUMBER),
            DefaultValue::NodeIdPlus(base) => self.with(base).flagged(flags::NODE_ID_PLUS),
            DefaultValue::Product => self.flagged(flags::PRODUCT),
        }
    }

    /// Sets the number of the entry, such as the value of a constant.
    ///
    /// # Panics
    /// Panics for a text; in a const this is a compile error.
    #[must_use]
    pub(super) const fn with(self, number: u32) -> Self {
        assert!(!self.entry.is_text(), "the number of a text entry must be its length");
        Self { entry: Entry { number, ..self.entry }, ..self }
    }

    const fn flagged(self, flags: u32) -> Self {
        Self { entry: Entry { packed: self.entry.packed | flags, ..self.entry }, ..self }
    }
}

const fn key(object: Multiplexer) -> u32 {
    (object.index as u32) << 8 | object.sub as u32
}

/// The rows of an object dictionary, split into entries and tags.
#[derive(Clone, Copy, Debug)]
pub struct Table<B, const N: usize> {
    entries: [Entry; N],
    behind: [B; N],
}

impl<B: Copy, const N: usize> Table<B, N> {
    /// Splits rows sorted by index and sub-index.
    ///
    /// # Panics
    /// Panics for rows that are not strictly ascending, and for 0 or more than 255 rows; in a const this is a compile
    /// error.
    #[must_use]
    #[allow(
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects,
        clippy::panic,
        reason = "runs only in the compiler"
    )]
    pub const fn new(rows: [Row<B>; N]) -> Self {
        assert!(N <= u8::MAX as usize, "a position must fit a byte");
        let mut table = Self { entries: [rows[0].entry; N], behind: [rows[0].behind; N] };
        let mut i = 1;
        while i < N {
            let Row { entry, behind } = rows[i];
            assert!(
                key(rows[i - 1].entry.object()) < key(entry.object()),
                "the rows must be sorted by index and sub-index"
            );
            table.entries[i] = entry;
            table.behind[i] = behind;
            i += 1;
        }
        table
    }
}

/// An object in the dictionary.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The description of the object.
    pub entry: &'static Entry,
    /// The position of the object in the dictionary.
    pub position: u8,
}

/// The entries of an object dictionary, sorted by index and sub-index.
#[derive(Clone, Copy, Debug)]
pub struct Entries(&'static [Entry]);

impl Entries {
    /// Returns all objects in order.
    pub fn iter(self) -> impl Iterator<Item = Place> {
        self.0.iter().zip(0..).map(|(entry, position)| Place { entry, position })
    }

    /// Returns the stored objects of a group in order.
    pub fn stored(self, group: Group) -> impl Iterator<Item = Place> {
        self.iter().filter(move |place| place.entry.is_stored() && group.has(place.entry.object().index))
    }

    /// Returns the object at a position; `None` beyond the end.
    pub(super) fn place(self, position: u8) -> Option<Place> {
        self.0.get(usize::from(position)).map(|entry| Place { entry, position })
    }

    /// Finds an object.
    ///
    /// # Errors
    /// Returns [`AbortCode::NO_OBJECT`] if no object has the index, and [`AbortCode::NO_SUB`] if the index has no such
    /// sub-index.
    pub fn find(self, object: Multiplexer) -> Result<Place, AbortCode> {
        let least = key(object) << 8;
        let position = self.0.partition_point(|entry| entry.packed < least);
        match self.0.get(position) {
            Some(entry) if entry.packed & !flags::ALL == least => Ok(Place { entry, position: position as u8 }),
            _ if self.0.iter().any(|entry| entry.object().index == object.index) => Err(AbortCode::NO_SUB),
            _ => Err(AbortCode::NO_OBJECT),
        }
    }
}

/// An object dictionary: the entries and their tags.
#[derive(Clone, Copy, Debug)]
pub struct Dictionary<B: 'static> {
    entries: &'static [Entry],
    behind: &'static [B],
}

impl<B: Copy> Dictionary<B> {
    /// Creates the dictionary from a table.
    #[must_use]
    pub const fn new<const N: usize>(table: &'static Table<B, N>) -> Self {
        Self { entries: &table.entries, behind: &table.behind }
    }

    /// Returns the entries.
    #[inline]
    #[must_use]
    pub const fn entries(self) -> Entries {
        Entries(self.entries)
    }

    /// Returns the tag of the object at a position; `None` beyond the end.
    #[inline]
    pub fn behind(self, position: u8) -> Option<B> {
        self.behind.get(usize::from(position)).copied()
    }
}

/// The value of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    /// The raw bits of a number. The bits beyond its type are 0.
    Number(u32),
    /// A text.
    Text(&'a [u8]),
}

impl Value<'_> {
    /// Returns the number; `None` for a text.
    #[must_use]
    pub const fn number(self) -> Option<u32> {
        match self {
            Self::Number(number) => Some(number),
            Self::Text(_) => None,
        }
    }
}

/// Decodes a little-endian number. Missing bytes are 0.
#[inline]
pub(super) fn number(bytes: &[u8]) -> u32 {
    let mut number = [0; 4];
    for (to, from) in number.iter_mut().zip(bytes) {
        *to = *from;
    }
    u32::from_le_bytes(number)
}
