//! The record for each group of parameters that "save" stores (CiA 301 7.5.2.13; SPEC 6). It contains the values of the
//! group's stored objects, in the order of the table.

use heapless::VecView;

use super::dictionary::{Entries, Entry, Group, Place, Value};

/// Appends the values of a group's stored objects, which `value_of` reads. A text is preceded by its length. Returns
/// `None` if a value is missing or does not fit.
pub(crate) fn encode<'a>(
    entries: Entries,
    group: Group,
    value_of: &dyn Fn(Place) -> Option<Value<'a>>,
    payload: &mut VecView<u8>,
) -> Option<()> {
    for place in entries.stored(group) {
        let number;
        let bytes = match value_of(place)? {
            Value::Number(value) => {
                number = value.to_le_bytes();
                number.get(..usize::from(place.entry.size()))?
            }
            Value::Text(text) => {
                payload.push(u8::try_from(text.len()).ok()?).ok()?;
                text
            }
        };
        payload.extend_from_slice(bytes).ok()?;
    }
    Some(())
}

/// The stored values of a group, to be read object by object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stored<'a>(&'a [u8]);

impl<'a> Stored<'a> {
    /// Checks a payload. Returns `None` unless the payload contains exactly one value for every stored object of the
    /// group.
    #[must_use]
    pub(crate) fn decode(entries: Entries, group: Group, payload: &'a [u8]) -> Option<Self> {
        let mut rest = payload;
        for place in entries.stored(group) {
            take(place.entry, &mut rest)?;
        }
        rest.is_empty().then_some(Self(payload))
    }

    /// Reads the next value. `entry` must describe the next stored object.
    pub(crate) fn next_of(&mut self, entry: &Entry) -> Option<Value<'a>> {
        take(entry, &mut self.0)
    }
}

/// Removes the value of `entry` from the front of `rest` and decodes it. Returns `None` if `rest` is too short, or if a
/// text is too long for its object.
fn take<'a>(entry: &Entry, rest: &mut &'a [u8]) -> Option<Value<'a>> {
    let mut size = entry.size();
    if entry.is_text() {
        let (&len, behind) = rest.split_first()?;
        *rest = behind;
        size = (len <= size).then_some(len)?;
    }
    let (bytes, behind) = rest.split_at_checked(size.into())?;
    *rest = behind;
    Some(entry.value(bytes))
}
