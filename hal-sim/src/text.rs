//! Escaping of user input in messages.

/// Returns a text in one line: its control characters are escaped.
#[must_use]
pub fn in_one_line(text: &str) -> String {
    let escaped = |char: char| if char.is_control() { char.escape_default().to_string() } else { char.to_string() };
    text.chars().map(escaped).collect()
}
