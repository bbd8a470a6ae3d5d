//! What "save" stores, a record for each group: the values of the dictionary's stored objects in the order of the table
//! (CiA 301 7.5.2.13; SPEC 6).

use heapless::VecView;

use super::dictionary::{DataType, Dictionary, Entry, Group, Row, Value};

/// Appends the values of a group's stored objects as `value_of` gives them, one after the other; a text is preceded by its
/// length. `None` when one is missing, or when there is no room for it.
pub(crate) fn encode<'a, B: Copy>(
    dictionary: Dictionary<B>,
    group: Group,
    value_of: impl Fn(&'static Row<B>) -> Option<Value<'a>>,
    payload: &mut VecView<u8>,
) -> Option<()> {
    for row in dictionary.stored(group) {
        let number;
        let bytes = match value_of(row)? {
            Value::Number(value) => {
                number = value.to_le_bytes();
                number.get(..usize::from(row.entry.data_type.size()))?
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

/// The stored values, object by object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stored<'a, B: 'static> {
    dictionary: Dictionary<B>,
    group: Group,
    payload: &'a [u8],
}

impl<'a, B: Copy> Stored<'a, B> {
    /// Takes a payload; `None` unless it has a value for every stored object and nothing else.
    #[must_use]
    pub(crate) fn decode(dictionary: Dictionary<B>, group: Group, payload: &'a [u8]) -> Option<Self> {
        let mut rest = payload;
        for row in dictionary.stored(group) {
            take(&row.entry, &mut rest)?;
        }
        rest.is_empty().then_some(Self { dictionary, group, payload })
    }

    /// Returns the objects and their values.
    pub(crate) fn values(self) -> impl Iterator<Item = (&'static Row<B>, Value<'a>)> {
        let mut rest = self.payload;
        self.dictionary.stored(self.group).map_while(move |row| Some((row, take(&row.entry, &mut rest)?)))
    }
}

/// Takes one value off the front.
fn take<'a>(entry: &Entry, rest: &mut &'a [u8]) -> Option<Value<'a>> {
    let size = match entry.data_type {
        DataType::Text(max) => {
            let (&len, behind) = rest.split_first()?;
            *rest = behind;
            usize::from((len <= max).then_some(len)?)
        }
        number => usize::from(number.size()),
    };
    let (bytes, behind) = rest.split_at_checked(size)?;
    *rest = behind;
    Some(Value::of(entry.data_type, bytes))
}
