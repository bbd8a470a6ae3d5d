//! Communication faults in user input: `{ lose = "220", count = 3 }`.

use std::sync::Arc;

use protocol_core::frame::{Frame, Id, MAX_LEN};
use protocol_core::time::Duration;
use serde::{Deserialize, Serialize};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{Object, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::given::{given, given_object};
use super::identifier::IdentifierOrAll;
use super::{Identifier, Invalid, Pattern};
use crate::bus::{ALWAYS, Corruption, Delay, Fault, FaultKind, FaultState, FrameFilter, Masks};

/// The default maximum wait of a swapped frame for the sender's next frame.
const SWAP_WITHIN: Duration = Duration::from_secs(1);

/// The maximum length of a fault's name.
const NAME_MAX: usize = 64;

/// A communication fault: exactly one of `lose`, `delay`, `repeat`, `swap`, `corrupt`, `insert`, `masquerade`,
/// `destroy` and `omit`, with its parameters.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = CommunicationFault)]
pub struct FaultRequest {
    /// The receivers do not receive frames with this identifier, although the frames are on the bus.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub lose: Option<Identifier>,
    /// Frames with this identifier reach the sending controller late, by `ms` or `burst_ms`.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub delay: Option<Identifier>,
    /// Frames with this identifier are followed by `times` copies, at intervals of `after_ms`.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub repeat: Option<Identifier>,
    /// Frames with this identifier are exchanged with the next frame of their sender, or sent after `within_ms`.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub swap: Option<Identifier>,
    /// Frames with this identifier are sent with changed `data`, `dlc` or `identifier`, and a valid CRC.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub corrupt: Option<Identifier>,
    /// An additional frame that no device sends, as in "220#0F00 0020"; cyclic with `every_ms`.
    #[serde(default, deserialize_with = "given")]
    pub insert: Option<String>,
    /// Like insert, but with an identifier of a device on the bus: the frame appears to come from this device.
    #[serde(default, deserialize_with = "given")]
    pub masquerade: Option<String>,
    /// A bit error destroys attempts to send frames with this identifier. The controller retries; 32 errors in a row
    /// take the controller bus-off.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub destroy: Option<Identifier>,
    /// The receivers detect an error in the last but one bit of a frame with this identifier and discard the frame. All
    /// other nodes accept the frame, and the sender retransmits the frame.
    #[serde(default, deserialize_with = "given")]
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub omit: Option<Identifier>,
    /// The name of the fault; by default its kind and identifier, as in lose-220.
    #[serde(default, deserialize_with = "given")]
    pub name: Option<String>,
    /// The bits of the identifier to compare; all by default.
    #[serde(default, deserialize_with = "given")]
    pub mask: Option<Identifier>,
    /// Whether the identifier has 29 bits; by default true for eight digits or a value above 7FF.
    #[serde(default, deserialize_with = "given")]
    pub extended: Option<bool>,
    /// The device or client whose frames are affected; all by default.
    #[serde(default, deserialize_with = "given")]
    pub sender: Option<String>,
    /// For lose and omit: the affected devices and clients; all by default, but required for omit.
    #[serde(default, deserialize_with = "given")]
    pub receivers: Option<Vec<String>>,
    /// The maximum number of affected frames; unlimited by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 1, maximum = 4294967295_i64)]
    pub count: Option<u32>,
    /// The probability that a frame is affected, from 0 to 1; 1 by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 0, maximum = 1)]
    pub probability: Option<f64>,
    /// The seed of the random choices; 0 by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(maximum = 4294967295_i64)]
    pub seed: Option<u32>,
    /// The time until the fault begins, in milliseconds; 0 by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(maximum = 86400000)]
    pub from_ms: Option<u32>,
    /// The duration of the fault, in milliseconds; unlimited by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 1, maximum = 86400000)]
    pub for_ms: Option<u32>,
    /// For delay: the delay in milliseconds, or the smallest and the largest delay.
    #[serde(default, deserialize_with = "given")]
    pub ms: Option<Millis>,
    /// For delay: the period of bursts, in milliseconds. Frames wait for the next multiple of the period.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 1, maximum = 86400000)]
    pub burst_ms: Option<u32>,
    /// For delay: later frames with the same identifier may overtake the frame; false by default.
    #[serde(default, deserialize_with = "given")]
    pub overtake: Option<bool>,
    /// For repeat: the number of copies; 1 by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 1, maximum = 1000)]
    pub times: Option<u32>,
    /// For repeat: the interval between copies, in milliseconds; 0 by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(maximum = 86400000)]
    pub after_ms: Option<u32>,
    /// For swap: the maximum wait for the next frame, in milliseconds; 1000 by default.
    #[serde(default, deserialize_with = "given")]
    #[schema(maximum = 86400000)]
    pub within_ms: Option<u32>,
    /// For insert and masquerade: the period, in milliseconds; by default, the frame is sent once.
    #[serde(default, deserialize_with = "given")]
    #[schema(minimum = 1, maximum = 86400000)]
    pub every_ms: Option<u32>,
    /// For corrupt: the changed bits of the data, in hex, first byte first.
    #[serde(default, deserialize_with = "given_object")]
    pub data: Option<DataMasks>,
    /// For corrupt: the changed bits of the data length code.
    #[serde(default, deserialize_with = "given_object")]
    pub dlc: Option<DlcMasks>,
    /// For corrupt: the changed bits of the identifier.
    #[serde(default, deserialize_with = "given_object")]
    pub identifier: Option<IdentifierMasks>,
}

/// A time in milliseconds, or its minimum and maximum.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(untagged, expecting = "ms must be a number of milliseconds, or [MIN, MAX]")]
pub enum Millis {
    /// A time.
    #[schema(value_type = MillisOfDay)]
    One(u32),
    /// The smallest and the largest time.
    Between([u32; 2]),
}

/// The schema of a time of up to a day, in milliseconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct MillisOfDay;

impl PartialSchema for MillisOfDay {
    fn schema() -> RefOr<Schema> {
        Object::builder().schema_type(Type::Integer).minimum(Some(0)).maximum(Some(86_400_000)).into()
    }
}

impl ToSchema for MillisOfDay {}

/// Changed bits of the data, in hex as in "00 80".
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DataMasks {
    /// Bits that become 1.
    #[serde(default)]
    pub set: String,
    /// Bits that become 0.
    #[serde(default)]
    pub clear: String,
    /// Bits that are inverted.
    #[serde(default)]
    pub toggle: String,
}

/// Changed bits of the data length code.
#[derive(Clone, Copy, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DlcMasks {
    /// Bits that become 1.
    #[serde(default)]
    #[schema(maximum = 15)]
    pub set: u8,
    /// Bits that become 0.
    #[serde(default)]
    #[schema(maximum = 15)]
    pub clear: u8,
    /// Bits that are inverted.
    #[serde(default)]
    #[schema(maximum = 15)]
    pub toggle: u8,
}

/// Changed bits of the identifier.
#[derive(Clone, Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentifierMasks {
    /// Bits that become 1.
    #[serde(default)]
    #[schema(value_type = Option<Identifier>)]
    pub set: Option<Identifier>,
    /// Bits that become 0.
    #[serde(default)]
    #[schema(value_type = Option<Identifier>)]
    pub clear: Option<Identifier>,
    /// Bits that are inverted.
    #[serde(default)]
    #[schema(value_type = Option<Identifier>)]
    pub toggle: Option<Identifier>,
}

/// A communication fault and its effect so far.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct FaultRecord {
    /// The name of the fault.
    pub name: String,
    /// The fault in words.
    pub fault: String,
    /// The number of affected frames.
    pub struck: u64,
    /// Whether the count or the duration of the fault is exhausted.
    pub is_over: bool,
}

impl From<FaultState> for FaultRecord {
    fn from(FaultState { fault, struck, is_over }: FaultState) -> Self {
        Self { name: fault.name.as_ref().to_owned(), fault: fault.to_string(), struck, is_over }
    }
}

/// The keys of the fault kinds, each with the accepted parameters besides the common parameters. `filter` stands for
/// `mask`, `extended` and `sender`.
const PARAMETERS: [(&str, &[&str]); 9] = [
    ("lose", &["receivers", "filter"]),
    ("delay", &["ms", "burst_ms", "overtake", "filter"]),
    ("repeat", &["times", "after_ms", "filter"]),
    ("swap", &["within_ms", "filter"]),
    ("corrupt", &["data", "dlc", "identifier", "filter"]),
    ("insert", &["every_ms"]),
    ("masquerade", &["every_ms"]),
    ("destroy", &["filter"]),
    ("omit", &["receivers", "filter"]),
];

impl FaultRequest {
    /// Returns the keys of the fault kinds.
    pub fn kinds() -> impl Iterator<Item = &'static str> {
        PARAMETERS.iter().map(|(kind, _)| *kind)
    }

    /// Converts the request to a fault, with an empty name if none was given.
    ///
    /// # Errors
    /// [`Invalid`] if the request has no kind or several kinds, a parameter of another kind, or a value out of range.
    pub fn fault(&self) -> Result<Fault, Invalid> {
        let (kind, identifier) = self.kind()?;
        self.check_parameters(kind)?;
        let frames = identifier.map(|identifier| self.filter(identifier)).transpose()?.unwrap_or_default();
        let effect = match (kind, self.frame(kind)?) {
            (_, Some(frame)) => FaultKind::Insert { frame, every: self.every_ms.map(millis) },
            (kind, None) => self.effect(kind)?,
        };
        if self.receivers.as_ref().is_some_and(Vec::is_empty) {
            return Err(Invalid("receivers must not be empty".to_owned()));
        }
        let mut fault = Fault::new(self.name.as_deref().unwrap_or_default(), effect);
        fault.frames = frames;
        fault.count = self.count;
        fault.seed = self.seed.unwrap_or_default().into();
        fault.from = millis(self.from_ms.unwrap_or_default());
        fault.lasts = self.for_ms.map(millis);
        if let Some(name) = self.name.as_ref().filter(|name| !is_name(name)) {
            return Err(Invalid(format!("name '{name}': must be 1 to {NAME_MAX} letters, digits and '-'")));
        }
        if let Some(probability) = self.probability {
            if !(0.0..=1.0).contains(&probability) {
                return Err(Invalid(format!("probability {probability}: must be from 0 to 1")));
            }
            fault.probability = (probability * f64::from(ALWAYS)).round() as u32;
            if fault.probability == 0 && probability > 0.0 {
                return Err(Invalid(format!("probability {probability}: must be 0 or at least 0.000001")));
            }
        }
        fault.check().map_err(|error| Invalid(error.to_string()))?;
        Ok(fault)
    }

    /// Returns the key of the kind, and the identifier of the affected frames; `None` for an inserted frame.
    fn kind(&self) -> Result<(&'static str, Option<&Identifier>), Invalid> {
        let given = [
            ("lose", self.lose.as_ref().map(Some)),
            ("delay", self.delay.as_ref().map(Some)),
            ("repeat", self.repeat.as_ref().map(Some)),
            ("swap", self.swap.as_ref().map(Some)),
            ("corrupt", self.corrupt.as_ref().map(Some)),
            ("insert", self.insert.as_ref().map(|_| None)),
            ("masquerade", self.masquerade.as_ref().map(|_| None)),
            ("destroy", self.destroy.as_ref().map(Some)),
            ("omit", self.omit.as_ref().map(Some)),
        ];
        let mut given = given.into_iter().filter_map(|(kind, identifier)| Some((kind, identifier?)));
        let kinds = Self::kinds().collect::<Vec<_>>().join(", ");
        match (given.next(), given.next()) {
            (Some(kind), None) => Ok(kind),
            (Some((one, _)), Some((other, _))) => {
                Err(Invalid(format!("{one} and {other}: a fault has exactly one of {kinds}")))
            }
            (None, _) => {
                Err(Invalid(format!("a fault needs one of {kinds}, as in {{\"lose\": \"220\", \"count\": 3}}")))
            }
        }
    }

    /// Refuses parameters that the kind does not accept.
    fn check_parameters(&self, kind: &str) -> Result<(), Invalid> {
        let given = [
            ("receivers", self.receivers.is_some()),
            ("ms", self.ms.is_some()),
            ("burst_ms", self.burst_ms.is_some()),
            ("overtake", self.overtake.is_some()),
            ("times", self.times.is_some()),
            ("after_ms", self.after_ms.is_some()),
            ("within_ms", self.within_ms.is_some()),
            ("every_ms", self.every_ms.is_some()),
            ("data", self.data.is_some()),
            ("dlc", self.dlc.is_some()),
            ("identifier", self.identifier.is_some()),
        ];
        let filter =
            [("mask", self.mask.is_some()), ("extended", self.extended.is_some()), ("sender", self.sender.is_some())];
        let allowed = PARAMETERS.iter().find(|(known, _)| *known == kind).map_or(&[][..], |(_, keys)| keys);
        let given = given.map(|(key, is_given)| (key, key, is_given));
        let filter = filter.map(|(key, is_given)| (key, "filter", is_given));
        for (key, class, _) in given.into_iter().chain(filter).filter(|(.., is_given)| *is_given) {
            if !allowed.contains(&class) {
                let kinds = PARAMETERS.iter().filter(|(_, keys)| keys.contains(&class)).map(|(kind, _)| *kind);
                return Err(Invalid(format!("{key} is only valid with {}", kinds.collect::<Vec<_>>().join(", "))));
            }
        }
        Ok(())
    }

    /// Returns the frame filter for an identifier or for `all`.
    fn filter(&self, identifier: &Identifier) -> Result<FrameFilter, Invalid> {
        let sender = self.sender.as_deref().map(Arc::from);
        let is_all = matches!(identifier, Identifier::Text(text) if text == "all");
        if is_all {
            return match (&self.mask, self.extended) {
                (None, None) => Ok(FrameFilter { sender, ..FrameFilter::default() }),
                _ => Err(Invalid("mask and extended are only valid with an identifier, not with \"all\"".to_owned())),
            };
        }
        let extended = self.extended.or_else(|| identifier.needs_29_bits().then_some(true));
        let id = identifier.id(extended)?;
        let is_extended = matches!(id, Id::Extended(_));
        let mask = self.mask.as_ref().map(|mask| mask.id(Some(is_extended)).map_err(within("mask"))).transpose()?;
        Ok(FrameFilter { id: Some(id), mask: mask.as_ref().map(bits), sender })
    }

    /// Returns the frame to insert, if any.
    fn frame(&self, kind: &str) -> Result<Option<Frame>, Invalid> {
        let Some(text) = self.insert.as_ref().or(self.masquerade.as_ref()) else { return Ok(None) };
        let frame = text.parse::<Pattern>().ok().and_then(|pattern| pattern.frame());
        let refuse = || Invalid(format!("{kind}: '{text}' is not a frame as in \"220#0F00 0020\""));
        frame.map(Some).ok_or_else(refuse)
    }

    fn effect(&self, kind: &str) -> Result<FaultKind, Invalid> {
        let receivers = || self.receivers.iter().flatten().map(|name| Arc::from(name.as_str())).collect();
        Ok(match kind {
            "lose" => FaultKind::Lose { receivers: receivers() },
            "omit" => FaultKind::Omit { receivers: receivers() },
            "delay" => {
                let delay = match (&self.ms, self.burst_ms) {
                    (Some(Millis::One(ms)), None) => Delay::Constant(millis(*ms)),
                    (Some(Millis::Between([from, to])), None) => Delay::Uniform(millis(*from), millis(*to)),
                    (None, Some(period)) => Delay::Burst(millis(period)),
                    _ => return Err(Invalid("delay needs either ms or burst_ms, not both".to_owned())),
                };
                FaultKind::Delay { delay, overtake: self.overtake.unwrap_or_default() }
            }
            "repeat" => {
                FaultKind::Repeat { times: self.times.unwrap_or(1), after: millis(self.after_ms.unwrap_or_default()) }
            }
            "swap" => FaultKind::Swap { within: self.within_ms.map_or(SWAP_WITHIN, millis) },
            "corrupt" => FaultKind::Corrupt(self.corruption()?),
            _ => FaultKind::Destroy,
        })
    }

    fn corruption(&self) -> Result<Corruption, Invalid> {
        let mut corruption = Corruption::default();
        if let Some(DlcMasks { set, clear, toggle }) = self.dlc {
            corruption.dlc = Masks { set, clear, toggle };
        }
        if let Some(DataMasks { set, clear, toggle }) = &self.data {
            corruption.data = Masks { set: bytes(set)?, clear: bytes(clear)?, toggle: bytes(toggle)? };
        }
        if let Some(IdentifierMasks { set, clear, toggle }) = &self.identifier {
            let bits = |mask: &Option<Identifier>| match mask {
                Some(mask) => mask.id(Some(true)).map(|id| bits(&id)).map_err(within("identifier")),
                None => Ok(0),
            };
            corruption.id = Masks { set: bits(set)?, clear: bits(clear)?, toggle: bits(toggle)? };
        }
        Ok(corruption)
    }
}

/// Returns a function that prefixes a refusal with the key of the refused value.
fn within(key: &'static str) -> impl FnOnce(Invalid) -> Invalid {
    move |Invalid(reason)| Invalid(format!("{key}: {reason}"))
}

/// Returns whether a text is a valid fault name; `all` is reserved for all faults.
fn is_name(name: &str) -> bool {
    let is_short = (1..=NAME_MAX).contains(&name.len());
    is_short && name != "all" && name.bytes().all(|letter| letter.is_ascii_alphanumeric() || letter == b'-')
}

fn millis(ms: u32) -> Duration {
    Duration::from_millis(ms.into())
}

fn bits(id: &Id) -> u32 {
    match id {
        Id::Standard(id) => id.as_raw().into(),
        Id::Extended(id) => id.as_raw(),
    }
}

/// Parses up to eight hex bytes; missing bytes are 0.
fn bytes(text: &str) -> Result<[u8; MAX_LEN], Invalid> {
    let refuse = || Invalid(format!("data: '{text}' is not up to 8 bytes in hex as in \"00 80\""));
    let digits: Vec<u32> = text
        .split_whitespace()
        .flat_map(str::chars)
        .map(|digit| digit.to_digit(16))
        .collect::<Option<_>>()
        .ok_or_else(refuse)?;
    if digits.len() > 2 * MAX_LEN || !digits.len().is_multiple_of(2) {
        return Err(refuse());
    }
    let mut bytes = [0; MAX_LEN];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = (pair[0] << 4 | pair[1]) as u8;
    }
    Ok(bytes)
}

#[cfg(test)]
#[path = "fault_tests.rs"]
mod tests;
