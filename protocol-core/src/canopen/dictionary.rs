//! The object dictionary (CiA 301 7.4): one const table a product, the single source of truth.
//!
//! From the table come look-up, access checks and their aborts, what can be mapped, what "save" stores, and the defaults.

use crate::wire::sdo::{AbortCode, Multiplexer};

/// The length of the longest text that an object can hold: a manufacturer software version has 47 characters.
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
    /// VISIBLE_STRING of up to so many characters.
    Text(u8),
}

impl DataType {
    /// The size of a number in bytes; for a text the most that it can be.
    #[inline]
    #[must_use]
    pub const fn size(self) -> u8 {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
            Self::Text(size) => size,
        }
    }

    /// Whether it is a text.
    #[inline]
    #[must_use]
    pub const fn is_text(self) -> bool {
        matches!(self, Self::Text(_))
    }

    /// Whether so many bytes can be a value of this type.
    ///
    /// # Errors
    /// [`AbortCode::TOO_LONG`] or [`AbortCode::TOO_SHORT`].
    #[inline(always)]
    pub fn check_length(self, len: usize) -> Result<(), AbortCode> {
        let size = usize::from(self.size());
        if len > size {
            Err(AbortCode::TOO_LONG)
        } else if len < size && !self.is_text() {
            Err(AbortCode::TOO_SHORT)
        } else {
            Ok(())
        }
    }
}

/// Who may do what with an object over SDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read only.
    Ro,
    /// Read and write.
    Rw,
}

/// Into which PDO an object can be mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mappable {
    /// Into none.
    No,
    /// Into an RPDO.
    Rpdo,
    /// Into a TPDO.
    Tpdo,
}

/// The value of an object before anything was stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DefaultValue {
    /// A number, in the raw bits of its type.
    Number(u32),
    /// A number plus the node ID, `$NODEID+…` of an EDS.
    NodeIdPlus(u32),
    /// Given by the product: identity, texts, what it measures.
    Product,
}

/// What an object of a new device reads, as an EDS says it.
#[cfg(feature = "names")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initial<'a> {
    /// The same value in every device of the product.
    Fixed(Value<'a>),
    /// A number plus the node ID, `$NODEID+…` of an EDS.
    NodeIdPlus(u32),
    /// Nothing that can be said of every device: a serial number, an entry that does not exist yet.
    Individual,
}

/// A group of objects that "save" stores as one (CiA 301 7.5.2.13).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// All that "save" stores.
    All,
    /// 0x1000–0x1FFF
    Communication,
    /// 0x6000–0x9FFF
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

/// The description of one object.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Index and sub-index as the sort key of the rows: a look-up compares seven of them.
    key: u32,
    /// The type.
    pub data_type: DataType,
    /// The access over SDO.
    pub access: Access,
    /// The kind of PDO that it can be mapped into.
    pub mappable: Mappable,
    /// Whether "save" stores it.
    pub stored: bool,
    /// The value before anything was stored.
    pub default: DefaultValue,
    /// The name in an EDS. That of sub-index 0 of an object with sub-indices is the object's own, a colon, and the
    /// sub-index's: "Identity object: highest sub-index".
    #[cfg(feature = "names")]
    pub name: &'static str,
}

impl Entry {
    /// Returns index and sub-index.
    #[inline]
    #[must_use]
    pub const fn object(&self) -> Multiplexer {
        Multiplexer::new((self.key >> 8) as u16, self.key as u8)
    }
}

/// One row of an object dictionary: an object's description, and what lies behind it.
///
/// A service matches on `behind`, never on an index: a row that nothing serves does not compile, nor does code that serves
/// no row.
#[derive(Clone, Copy, Debug)]
pub struct Row<B> {
    /// The description.
    pub entry: Entry,
    /// What lies behind the object.
    pub behind: B,
}

impl<B: Copy> Row<B> {
    /// A read-only row: not mappable, not stored, its value given by the product.
    #[must_use]
    pub const fn ro(index: u16, sub: u8, data_type: DataType, behind: B, name: &'static str) -> Self {
        Self::new(Multiplexer::new(index, sub), data_type, Access::Ro, behind, name)
    }

    /// A row that can be read and written; otherwise as [`ro`](Self::ro).
    #[must_use]
    pub const fn rw(index: u16, sub: u8, data_type: DataType, behind: B, name: &'static str) -> Self {
        Self::new(Multiplexer::new(index, sub), data_type, Access::Rw, behind, name)
    }

    /// The name is dropped without the feature `names`.
    #[cfg_attr(not(feature = "names"), allow(unused_variables))]
    const fn new(object: Multiplexer, data_type: DataType, access: Access, behind: B, name: &'static str) -> Self {
        let entry = Entry {
            key: key(object),
            data_type,
            access,
            mappable: Mappable::No,
            stored: false,
            default: DefaultValue::Product,
            #[cfg(feature = "names")]
            name,
        };
        Self { entry, behind }
    }

    /// The same row, mappable.
    #[must_use]
    pub const fn mappable(self, mappable: Mappable) -> Self {
        Self { entry: Entry { mappable, ..self.entry }, ..self }
    }

    /// The same row, stored by "save", with this default.
    #[must_use]
    pub const fn stored(self, default: DefaultValue) -> Self {
        Self { entry: Entry { stored: true, default, ..self.entry }, ..self }
    }

    const fn key(&self) -> u32 {
        self.entry.key
    }
}

const fn key(object: Multiplexer) -> u32 {
    (object.index as u32) << 8 | object.sub as u32
}

/// An object dictionary: rows sorted by index and sub-index.
#[derive(Clone, Copy, Debug)]
pub struct Dictionary<B: 'static>(&'static [Row<B>]);

impl<B: Copy> Dictionary<B> {
    /// Takes sorted rows; in a const, rows that are not sorted do not compile.
    ///
    /// # Panics
    /// When the rows are not strictly ascending.
    #[must_use]
    #[allow(
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects,
        clippy::panic,
        reason = "runs in the compiler alone"
    )]
    pub const fn new(rows: &'static [Row<B>]) -> Self {
        let mut i = 1;
        while i < rows.len() {
            assert!(rows[i - 1].key() < rows[i].key(), "the rows must be sorted by index and sub-index");
            i += 1;
        }
        Self(rows)
    }

    /// Returns all rows in their order.
    #[cfg(feature = "names")]
    pub fn rows(self) -> impl Iterator<Item = &'static Row<B>> {
        self.0.iter()
    }

    /// Returns the rows of a group that "save" stores.
    pub fn stored(self, group: Group) -> impl Iterator<Item = &'static Row<B>> {
        self.0.iter().filter(move |row| row.entry.stored && group.has(row.entry.object().index))
    }

    /// Returns the row of an object.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`] without such an index, [`AbortCode::NO_SUB`] without such a sub-index.
    #[inline]
    pub fn find(self, object: Multiplexer) -> Result<&'static Row<B>, AbortCode> {
        match self.0.binary_search_by_key(&key(object), Row::key) {
            Ok(position) => self.0.get(position).ok_or(AbortCode::NO_OBJECT),
            Err(_) if self.0.iter().any(|row| row.entry.object().index == object.index) => Err(AbortCode::NO_SUB),
            Err(_) => Err(AbortCode::NO_OBJECT),
        }
    }
}

/// The value of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value<'a> {
    /// A number, in the low bits of its type's size.
    Number(u32),
    /// A text.
    Text(&'a [u8]),
}

impl<'a> Value<'a> {
    /// The value of a type in little-endian bytes; missing bytes of a number are zero.
    #[inline]
    #[must_use]
    pub fn of(data_type: DataType, bytes: &'a [u8]) -> Self {
        if data_type.is_text() {
            return Self::Text(bytes);
        }
        let mut number = [0; 4];
        for (to, from) in number.iter_mut().zip(bytes) {
            *to = *from;
        }
        Self::Number(u32::from_le_bytes(number))
    }

    /// The number; `None` for a text.
    #[must_use]
    pub const fn number(self) -> Option<u32> {
        match self {
            Self::Number(number) => Some(number),
            Self::Text(_) => None,
        }
    }
}
