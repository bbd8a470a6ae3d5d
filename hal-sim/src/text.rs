//! Texts of users in messages.

/// Returns a text in one line: control characters, which a user may have written, are escaped.
#[must_use]
pub fn in_one_line(text: &str) -> String {
    let escaped = |char: char| if char.is_control() { char.escape_default().to_string() } else { char.to_string() };
    text.chars().map(escaped).collect()
}
