//! Escaping of user input in messages.

/// Escapes the control characters of a text, so that the text fits on one line.
#[must_use]
pub fn in_one_line(text: &str) -> String {
    let escaped = |char: char| if char.is_control() { char.escape_default().to_string() } else { char.to_string() };
    text.chars().map(escaped).collect()
}
