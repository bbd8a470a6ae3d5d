//! CAN identifiers in user input: numbers or hex strings.

use protocol_core::frame::{ExtendedId, Id, StandardId};
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{AnyOf, Object, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::Invalid;
use super::schema::IDENTIFIER;

/// An identifier: a number, or a hex string with or without `0x`, as in `"220"`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Identifier {
    /// A number.
    Number(u32),
    /// A hex string; eight digits make a 29-bit identifier.
    Text(String),
}

impl Identifier {
    /// Returns the 11-bit or 29-bit identifier. If `extended` is `None`, a string of eight digits has 29 bits, as in a
    /// candump log, and any other value has 11 bits.
    ///
    /// # Errors
    /// [`Invalid`] if the value is not an identifier of this length.
    pub fn id(&self, extended: Option<bool>) -> Result<Id, Invalid> {
        let (number, is_long) = match self {
            Self::Number(number) => (Some(*number), false),
            Self::Text(text) => {
                let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")).unwrap_or(text);
                let is_hex = (1..=8).contains(&digits.len()) && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
                (u32::from_str_radix(digits, 16).ok().filter(|_| is_hex), digits.len() == 8)
            }
        };
        let id = match extended.unwrap_or(is_long) {
            true => number.and_then(ExtendedId::new).map(Id::Extended),
            false if is_long => None,
            false => number.and_then(|number| u16::try_from(number).ok()).and_then(StandardId::new).map(Id::Standard),
        };
        id.ok_or_else(|| {
            let accepted = match extended {
                Some(true) => "0 to 536870911, or a hex string as in \"0CFE3027\"",
                _ => "0 to 2047, or a hex string as in \"220\"; 29-bit identifiers need eight digits, or extended set to true",
            };
            Invalid(format!("id {self} is not valid; accepted: {accepted}"))
        })
    }

    /// Returns whether the identifier is valid only with 29 bits.
    pub fn needs_29_bits(&self) -> bool {
        self.id(Some(true)).is_ok() && self.id(None).is_err()
    }
}

impl std::fmt::Display for Identifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Text(text) => write!(f, "\"{}\"", text.escape_debug()),
        }
    }
}

/// Returns the numeric value of an identifier, and whether it has 29 bits.
#[must_use]
pub fn raw(id: Id) -> (u32, bool) {
    match id {
        Id::Standard(id) => (id.as_raw().into(), false),
        Id::Extended(id) => (id.as_raw(), true),
    }
}

/// Formats an identifier with three or eight hex digits.
pub(crate) fn digits(id: Id) -> String {
    match id {
        Id::Standard(id) => format!("{:03X}", id.as_raw()),
        Id::Extended(id) => format!("{:08X}", id.as_raw()),
    }
}

/// The schema of an identifier or the word `all`.
#[derive(Clone, Copy, Debug)]
pub struct IdentifierOrAll;

impl PartialSchema for IdentifierOrAll {
    fn schema() -> RefOr<Schema> {
        let all = Object::builder().schema_type(Type::String).enum_values(Some(["all"]));
        AnyOf::builder().item(Identifier::schema()).item(all).into()
    }
}

impl ToSchema for IdentifierOrAll {}

impl PartialSchema for Identifier {
    fn schema() -> RefOr<Schema> {
        let number =
            Object::builder().schema_type(Type::Integer).minimum(Some(0)).maximum(Some(ExtendedId::MAX.as_raw()));
        let text = Object::builder().schema_type(Type::String).pattern(Some(IDENTIFIER)).examples([json!("220")]);
        let description = "An identifier: a number, or a hex string with or without 0x. A string of eight digits is a 29-bit identifier.";
        AnyOf::builder().item(number).item(text).description(Some(description)).into()
    }
}

impl ToSchema for Identifier {}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(given: &str, extended: Option<bool>) -> Result<String, String> {
        let identifier: Identifier = serde_json::from_str(given).expect(given);
        match identifier.id(extended) {
            Ok(Id::Standard(id)) => Ok(format!("{:03X}", id.as_raw())),
            Ok(Id::Extended(id)) => Ok(format!("{:08X}", id.as_raw())),
            Err(Invalid(reason)) => Err(reason),
        }
    }

    #[test]
    fn a_text_is_hexadecimal_and_a_number_is_a_number() {
        for given in ["544", "\"220\"", "\"0x220\"", "\"0X220\"", "\"0220\""] {
            assert_eq!(id(given, None).as_deref(), Ok("220"), "{given}");
            assert_eq!(id(given, Some(false)).as_deref(), Ok("220"), "{given}");
            assert_eq!(id(given, Some(true)).as_deref(), Ok("00000220"), "{given}");
        }
        assert_eq!(id("\"00000220\"", None).as_deref(), Ok("00000220"));
        assert_eq!(id("\"0x0CFE3027\"", None).as_deref(), Ok("0CFE3027"));
        assert_eq!(id("\"CFE3027\"", Some(true)).as_deref(), Ok("0CFE3027"));
    }

    #[test]
    fn another_identifier_is_refused_with_what_is_accepted() {
        for given in ["2048", "\"800\"", "\"\"", "\"0x\"", "\"22G\"", "\"+22\"", "\"2 2\"", "\"000000220\"", "\"é\""] {
            let reason = id(given, None).expect_err(given);
            assert!(reason.starts_with(&format!("id {given} is not valid; accepted: 0 to 2047, ")), "{reason}");
        }
        for given in ["536870912", "\"20000000\"", "\"0x\""] {
            let reason = id(given, Some(true)).expect_err(given);
            assert!(reason.starts_with(&format!("id {given} is not valid; accepted: 0 to 536870911, ")), "{reason}");
        }
        id("\"00000220\"", Some(false)).expect_err("it has 29 bits");
    }
}
