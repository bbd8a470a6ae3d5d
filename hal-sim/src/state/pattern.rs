//! Patterns of frames, in scenarios and in the control interface: `1A0#0F00 0020`. Bytes are exact, `?` matches any hex
//! digit, and `..` at the end matches any further bytes.

use std::fmt;
use std::str::FromStr;

use protocol_core::frame::{ExtendedId, Frame, Id, MAX_LEN, StandardId, extended, standard};

use super::{Invalid, raw};

const ACCEPTED: &str = "accepted: IDENTIFIER#DATA in hex, as in \"1A0#0F00 0020\"; 3 digits up to 7FF, or 8 digits up to 1FFFFFFF; up to 8 bytes";

/// Hex digits with wildcards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Digits {
    value: u32,
    /// The bits that must match.
    mask: u32,
}

const DATA_ACCEPTED: &str = "accepted: up to 8 bytes in hex, as in \"0F00 0020\", or R or R0 to R8 for a remote frame; when waiting for a frame, also ? for any digit, and .. at the end for any further bytes";

/// A regular expression for the data of a frame: bytes, or a remote frame.
pub const DATA: &str = r"^[ \t]*((([0-9A-Fa-f][ \t]*){2}){0,8}|R[ \t]*([0-8][ \t]*)?)$";

/// A regular expression for data patterns: bytes, which may end in a wildcard, or a remote frame.
pub const DATA_PATTERN: &str = r"^[ \t]*((([0-9A-Fa-f?][ \t]*){2}){0,8}(\.[ \t]*\.[ \t]*)?|R[ \t]*([0-8][ \t]*)?)$";

/// A pattern of frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    is_extended: bool,
    id: Digits,
    content: Content,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Content {
    /// Any frames, also remote frames.
    Any,
    /// Data frames with these bytes. With `true`, any further bytes may follow.
    Data(Vec<Digits>, bool),
    /// Remote frames with this length.
    Remote(u8),
}

impl Digits {
    /// Parses up to eight hex digits or `?` wildcards.
    fn parse(text: &str) -> Option<Self> {
        text.chars().try_fold(Self { value: 0, mask: 0 }, |Self { value, mask }, digit| match digit {
            '?' => Some(Self { value: value << 4, mask: mask << 4 }),
            _ => digit.to_digit(16).map(|digit| Self { value: value << 4 | digit, mask: mask << 4 | 0xF }),
        })
    }

    const fn fit(self, value: u32) -> bool {
        (value ^ self.value) & self.mask == 0
    }

    const fn are_exact(self, digits: u32) -> bool {
        self.mask.count_ones() == 4 * digits
    }

    /// Writes the lowest `digits` digits and wildcards.
    fn write(self, f: &mut fmt::Formatter<'_>, digits: u32) -> fmt::Result {
        (0..digits).rev().try_for_each(|place| {
            let shift = 4 * place;
            if self.mask >> shift & 0xF == 0 { write!(f, "?") } else { write!(f, "{:X}", self.value >> shift & 0xF) }
        })
    }
}

impl FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = |why: &str| Err(format!("'{text}': {why}; {ACCEPTED}"));
        let (id, content) = match text.split_once(['#', ':']) {
            Some((id, content)) => (id.trim(), Some(content)),
            None => (text.trim(), None),
        };
        let id = id.strip_prefix("0x").or_else(|| id.strip_prefix("0X")).unwrap_or(id);
        let (is_extended, max) = match id.len() {
            3 => (false, u32::from(StandardId::MAX.as_raw())),
            8 => (true, ExtendedId::MAX.as_raw()),
            _ => return refuse("invalid identifier"),
        };
        let Some(digits) = Digits::parse(id).filter(|digits| digits.value <= max) else {
            return refuse("invalid identifier");
        };
        let content = match content.map(parse_content) {
            None => Content::Any,
            Some(Ok(content)) => content,
            Some(Err(why)) => return refuse(why),
        };
        Ok(Self { is_extended, id: digits, content })
    }
}

fn parse_content(text: &str) -> Result<Content, &'static str> {
    let text: String = text.chars().filter(|letter| !matches!(letter, ' ' | '\t')).collect();
    if let Some(length) = text.strip_prefix('R') {
        let length = match length.as_bytes() {
            [] => Some(0),
            [digit @ b'0'..=b'8'] => Some(digit - b'0'),
            _ => None,
        };
        return length.map(Content::Remote).ok_or("invalid length of a remote frame");
    }
    let (bytes, is_open) = text.strip_suffix("..").map_or((&*text, false), |bytes| (bytes, true));
    if !bytes.is_ascii() || !bytes.len().is_multiple_of(2) {
        return Err("an incomplete byte");
    }
    let pairs = (0..bytes.len()).step_by(2).map(|place| Digits::parse(&bytes[place..place + 2]));
    let bytes = pairs.collect::<Option<Vec<Digits>>>().ok_or("invalid hex digits")?;
    match bytes.len() {
        0..=MAX_LEN => Ok(Content::Data(bytes, is_open)),
        _ => Err("more than 8 bytes"),
    }
}

impl Pattern {
    /// Creates a pattern for an identifier. `None` for `data` matches any frame, also a remote frame.
    ///
    /// # Errors
    /// [`Invalid`] if `data` is not valid.
    pub fn of_data(id: Id, data: Option<&str>) -> Result<Self, Invalid> {
        let (value, is_extended) = raw(id);
        let mask = if is_extended { u32::MAX } else { 0xFFF };
        let content = match data {
            None => Content::Any,
            Some(text) => parse_content(text)
                .map_err(|why| Invalid(format!("data \"{}\": {why}; {DATA_ACCEPTED}", text.escape_debug())))?,
        };
        Ok(Self { is_extended, id: Digits { value, mask }, content })
    }

    /// Returns whether a frame matches.
    pub fn matches(&self, frame: &Frame) -> bool {
        self.has_id_of(frame) && self.differences(frame).is_some_and(|bytes| bytes.is_empty())
    }

    /// Returns whether the pattern matches remote frames alone.
    pub const fn is_remote(&self) -> bool {
        matches!(self.content, Content::Remote(_))
    }

    /// Returns whether the pattern matches 29-bit identifiers.
    pub const fn is_extended(&self) -> bool {
        self.is_extended
    }

    /// Returns whether the identifier of a frame matches.
    pub fn has_id_of(&self, frame: &Frame) -> bool {
        let (value, is_extended) = raw(frame.id());
        is_extended == self.is_extended && self.id.fit(value)
    }

    /// Returns the indices of the bytes that do not match, including missing and surplus bytes. `None` if the pattern
    /// has data and the frame is remote, or the reverse, or if both are remote with different lengths.
    pub fn differences(&self, frame: &Frame) -> Option<Vec<usize>> {
        match (&self.content, frame.is_remote()) {
            (Content::Any, _) => Some(Vec::new()),
            (Content::Remote(length), true) if frame.len() == *length => Some(Vec::new()),
            (Content::Data(bytes, is_open), false) => {
                let data = frame.data();
                let end = if *is_open { bytes.len() } else { bytes.len().max(data.len()) };
                let differs = |place: &usize| match (bytes.get(*place), data.get(*place)) {
                    (Some(wanted), Some(byte)) => !wanted.fit((*byte).into()),
                    _ => true,
                };
                Some((0..end).filter(differs).collect())
            }
            _ => None,
        }
    }

    /// Describes the difference if frame and pattern differ only in length.
    pub fn difference_in_length(&self, frame: &Frame) -> Option<String> {
        let (wanted, is_least) = match (&self.content, frame.is_remote()) {
            (Content::Data(bytes, is_open), false) => (bytes.len(), *is_open),
            (Content::Remote(length), true) => (usize::from(*length), false),
            _ => return None,
        };
        let found = usize::from(frame.len());
        let common = found.min(wanted);
        let is_equal = self.differences(frame).is_none_or(|bytes| bytes.iter().all(|place| *place >= common));
        let is_other = if is_least { found < wanted } else { found != wanted };
        let bytes = |count: usize| if count == 1 { "1 byte".to_owned() } else { format!("{count} bytes") };
        (self.has_id_of(frame) && is_equal && is_other).then(|| {
            let tip = if found > wanted && !frame.is_remote() { "; append \"..\" to accept further bytes" } else { "" };
            let wanted = format!("{}{}", bytes(wanted), if is_least { " or more" } else { "" });
            format!("differs only in its length: {} instead of {wanted}{tip}", bytes(found))
        })
    }

    /// Returns the identifier of the pattern; `None` if the identifier has a wildcard.
    pub fn identifier(&self) -> Option<Id> {
        match self.is_extended {
            true => self.id.are_exact(8).then(|| extended(self.id.value).into()),
            false => self.id.are_exact(3).then(|| standard(self.id.value as u16).into()),
        }
    }

    /// Returns the only frame that matches; `None` if the pattern has a wildcard.
    pub fn frame(&self) -> Option<Frame> {
        let id = self.identifier()?;
        match &self.content {
            Content::Remote(length) => Some(Frame::remote(id, *length)),
            Content::Data(bytes, false) if bytes.iter().all(|byte| byte.are_exact(2)) => {
                let bytes: Vec<u8> = bytes.iter().map(|byte| (byte.value & 0xFF) as u8).collect();
                Frame::of(id, &bytes)
            }
            Content::Any | Content::Data(..) => None,
        }
    }
}

/// Writes the pattern in the notation of the manuals: `1A0: 0F 00 ?? ..`.
impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.id.write(f, if self.is_extended { 8 } else { 3 })?;
        match &self.content {
            Content::Any => Ok(()),
            Content::Remote(length) => write!(f, ": R{length}"),
            Content::Data(bytes, is_open) => {
                write!(f, ":")?;
                for byte in bytes {
                    write!(f, " ")?;
                    byte.write(f, 2)?;
                }
                if *is_open { write!(f, " ..") } else { Ok(()) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pattern(text: &str) -> Pattern {
        text.parse().unwrap_or_else(|error| panic!("{error}"))
    }

    fn matches(wanted: &str, frame: &str) -> bool {
        pattern(wanted).matches(&pattern(frame).frame().unwrap_or_else(|| panic!("{frame}")))
    }

    #[test]
    fn one_frame_in_every_spelling() {
        let frame = pattern("1A0#0F00 0020").frame();
        assert_eq!(frame.map(|frame| frame.to_string()).as_deref(), Some("1A0: 0F 00 00 20"));
        for text in ["1A0#0F000020", "1a0#0f 00 00 20", " 1A0: 0F 00 00 20 ", "1A0 # 0F0 00 020"] {
            assert_eq!(pattern(text).frame(), frame, "{text}");
        }
        assert_eq!(pattern("000001A0#").frame().map(|frame| frame.to_string()).as_deref(), Some("000001A0:"));
        assert_eq!(pattern("720#R1").frame().map(|frame| frame.to_string()).as_deref(), Some("720: R1"));
    }

    #[test]
    fn wildcards() {
        assert!(matches("1A0#0F00 ????", "1A0#0F00 1234") && matches("1A0#0?00", "1A0#0F00"));
        assert!(!matches("1A0#0F00 ????", "1A0#0F00") && !matches("1A0#0F00", "1A0#0F00 00"));
        assert!(matches("1A0#0F..", "1A0#0F") && matches("1A0#0F ..", "1A0#0F00 1234") && !matches("1A0#0F..", "1A0#"));
        assert!(matches("1A0", "1A0#") && matches("1A0#..", "1A0#01") && !matches("1A0#", "1A0#01"));
        assert!(matches("7??#00", "720#00") && !matches("7??#00", "00000720#00") && !matches("7??#00", "0A0#00"));
        assert!(matches("18EEFF??", "18EEFF80#01"));
    }

    #[test]
    fn remote_frames_match_an_identifier_alone_and_their_length() {
        assert!(matches("1A0", "1A0#R") && matches("1A?", "1A0#R4") && matches("18EEFF80", "18EEFF80#R8"));
        assert!(matches("1A0#R1", "1A0#R1") && !matches("1A0#R1", "1A0#R2") && !matches("1A0#R", "1A0#"));
        assert!(!matches("1A0#..", "1A0#R") && !matches("1A0#", "1A0#R") && !matches("1A0#??", "1A0#R1"));
    }

    #[test]
    fn what_is_no_frame() {
        for (text, why) in [
            ("", "invalid identifier"),
            ("1A#00", "invalid identifier"),
            ("1A00#00", "invalid identifier"),
            ("800#00", "invalid identifier"),
            ("20000000#00", "invalid identifier"),
            ("+A0#00", "invalid identifier"),
            ("1A0#0", "an incomplete byte"),
            ("1A0#0x10", "invalid hex digits"),
            ("1A0#é", "an incomplete byte"),
            ("1A0#00..00", "invalid hex digits"),
            ("1A0#000102030405060708", "more than 8 bytes"),
            ("1A0#R9", "invalid length"),
        ] {
            let error = text.parse::<Pattern>().expect_err(text);
            assert!(error.contains(why) && error.contains("accepted: IDENTIFIER#DATA"), "{text}: {error}");
            assert!(error.contains("3 digits up to 7FF, or 8 digits up to 1FFFFFFF"), "{error}");
        }
        for text in ["1A0", "1A0#..", "1A0#0?", "1A?#00"] {
            assert_eq!(pattern(text).frame(), None, "{text}");
        }
    }

    proptest! {
        /// Any text is parsed or refused, and a printed frame is parsed as itself.
        #[test]
        fn nothing_panics(text in "[0-9A-Fa-f?#:.R é]{0,24}", id in 0_u16..0x800, data in prop::collection::vec(0_u8.., 0..=8)) {
            if let Ok(read) = text.parse::<Pattern>() {
                prop_assert_eq!(&read.to_string().parse::<Pattern>(), &Ok(read.clone()));
            }
            let frame = StandardId::new(id).and_then(|id| Frame::of(id.into(), &data));
            prop_assert_eq!(pattern(&frame.map_or_else(String::new, |frame| frame.to_string())).frame(), frame);
        }
    }
}
