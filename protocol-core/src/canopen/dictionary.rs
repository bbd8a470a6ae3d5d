//! The object dictionary (CiA 301 7.4): one const table a product, the single source of truth.
//!
//! From the table come look-up, access checks and their aborts, what can be mapped, what "save" stores, and the defaults.
//! What the objects hold lies with the product, behind [`Objects`].

use crate::time::Instant;
use crate::wire::sdo::{AbortCode, Multiplexer};

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

/// What an object holds before anything was stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Default {
    /// A number, in the raw bits of its type.
    Number(u32),
    /// A number plus the node ID, `$NODEID+…` of an EDS.
    NodeIdPlus(u32),
    /// Given by the product: identity, texts, what it measures.
    Product,
}

/// One row of an object dictionary.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// What the rows are sorted by; kept, because looking a row up compares seven of them.
    key: u32,
    /// Where it lies.
    pub object: Multiplexer,
    /// Its type.
    pub data_type: DataType,
    /// Who may do what.
    pub access: Access,
    /// Into which PDO it can be mapped.
    pub mappable: Mappable,
    /// Whether "save" stores it.
    pub stored: bool,
    /// What it holds at first.
    pub default: Default,
    /// What it is called in an EDS.
    #[cfg(feature = "names")]
    pub name: &'static str,
}

impl Entry {
    /// A row that is not mappable, not stored and given by the product. The name is dropped without the feature `names`.
    #[must_use]
    #[cfg_attr(not(feature = "names"), allow(unused_variables))]
    pub const fn new(index: u16, sub: u8, data_type: DataType, access: Access, name: &'static str) -> Self {
        let object = Multiplexer::new(index, sub);
        Self {
            key: key(object),
            object,
            data_type,
            access,
            mappable: Mappable::No,
            stored: false,
            default: Default::Product,
            #[cfg(feature = "names")]
            name,
        }
    }

    /// The same row, mappable.
    #[must_use]
    pub const fn mappable(self, mappable: Mappable) -> Self {
        Self { mappable, ..self }
    }

    /// The same row, stored by "save", with this default.
    #[must_use]
    pub const fn stored(self, default: Default) -> Self {
        Self { stored: true, default, ..self }
    }

    /// The same row with this default.
    #[must_use]
    pub const fn default(self, value: u32) -> Self {
        Self { default: Default::Number(value), ..self }
    }

    const fn key(&self) -> u32 {
        self.key
    }
}

const fn key(object: Multiplexer) -> u32 {
    (object.index as u32) << 8 | object.sub as u32
}

/// An object dictionary: rows sorted by index and sub-index.
#[derive(Clone, Copy, Debug)]
pub struct Table(&'static [Entry]);

impl Table {
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
    pub const fn new(entries: &'static [Entry]) -> Self {
        let mut i = 1;
        while i < entries.len() {
            assert!(entries[i - 1].key() < entries[i].key(), "the rows must be sorted by index and sub-index");
            i += 1;
        }
        Self(entries)
    }

    /// All rows.
    #[must_use]
    pub const fn entries(self) -> &'static [Entry] {
        self.0
    }

    /// The rows that "save" stores.
    pub fn stored(self) -> impl Iterator<Item = &'static Entry> {
        self.0.iter().filter(|entry| entry.stored)
    }

    /// The row of an object.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`] without such an index, [`AbortCode::NO_SUB`] without such a sub-index.
    #[inline]
    pub fn find(self, object: Multiplexer) -> Result<&'static Entry, AbortCode> {
        match self.0.binary_search_by_key(&key(object), Entry::key) {
            Ok(position) => self.0.get(position).ok_or(AbortCode::NO_OBJECT),
            Err(_) if self.0.iter().any(|entry| entry.object.index == object.index) => Err(AbortCode::NO_SUB),
            Err(_) => Err(AbortCode::NO_OBJECT),
        }
    }
}

/// What an object holds.
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

/// When a write has taken effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    /// It has.
    Now,
    /// When the non-volatile memory holds it: the answer waits for
    /// [`SdoServer::stored`](super::sdo_server::SdoServer::stored).
    WhenStored,
}

/// The objects of a product, behind its table.
pub trait Objects {
    /// The table.
    fn table(&self) -> Table;

    /// What an object of the table holds.
    ///
    /// # Errors
    /// An abort code when there is nothing to be read now.
    fn read(&self, object: Multiplexer) -> Result<Value<'_>, AbortCode>;

    /// Writes an object of the table; the value has the object's type and length.
    ///
    /// # Errors
    /// An abort code, with nothing changed, when the value or the state forbids it.
    fn write(&mut self, object: Multiplexer, value: Value<'_>, now: Instant) -> Result<Written, AbortCode>;
}
