//! Converts plant words of the command line to the JSON of the control interface.

use std::str::FromStr;

use hal_sim::state::json_of;
use hal_sim::world::Change;
use serde_json::Value;

/// A plant word with its value, as in `supply_mv=8000`. The simulator validates both.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlantWord {
    /// The word, such as `supply_mv`.
    pub name: String,
    /// The text of the value.
    pub value: String,
}

impl FromStr for PlantWord {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, value)) if !name.is_empty() => Ok(Self { name: name.to_owned(), value: value.to_owned() }),
            _ => Err("must be WORD=VALUE, as in supply_mv=8000".to_owned()),
        }
    }
}

impl PlantWord {
    /// Converts the value to JSON. A value that the console accepts keeps its meaning; any other value is parsed as
    /// JSON or, if it is not JSON, becomes a string.
    pub(super) fn json(&self) -> Value {
        match Change::parse(&self.name, &self.value) {
            Some(change) => json_of(change),
            None => serde_json::from_str(&self.value).unwrap_or_else(|_| self.value.as_str().into()),
        }
    }
}
