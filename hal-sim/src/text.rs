//! Escaping of user input in messages.

/// Escapes the control characters of a text, so that the text fits on one line, and the noncharacters that XML forbids.
#[must_use]
pub fn in_one_line(text: &str) -> String {
    let is_escaped = |char: char| char.is_control() || matches!(char, '\u{FFFE}' | '\u{FFFF}');
    let escaped = |char: char| if is_escaped(char) { char.escape_default().to_string() } else { char.to_string() };
    text.chars().map(escaped).collect()
}
