//! Communication faults in user input: `{ lose = "220", count = 3 }`.

use std::sync::Arc;

use protocol_core::frame::{Id, MAX_LEN, StandardId};
use protocol_core::time::Duration;
use serde::{Deserialize, Serialize};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{Object, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::identifier::{IdentifierOrAll, raw};
use super::schema::FAULT_KINDS;
use super::{Identifier, Invalid, Pattern};
use crate::bus::{ALWAYS, Corruption, Delay, Fault, FaultKind, FaultState, FrameFilter, Masks};

/// The default maximum wait of a swapped frame for the sender's next frame.
const SWAP_WITHIN: Duration = Duration::from_secs(1);

/// The maximum length of a fault's name.
const NAME_MAX: usize = 64;

/// A communication fault: exactly one of `lose`, `delay`, `repeat`, `swap`, `corrupt`, `insert`, `masquerade`,
/// `destroy` and `omit`, with its parameters.
#[derive(Clone, Debug, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = CommunicationFault)]
pub struct FaultRequest {
    /// The receivers do not receive frames with this identifier, although the frames are on the bus.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub lose: Option<Identifier>,
    /// Frames with this identifier reach the sending controller late, by `ms` or `burst_ms`.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub delay: Option<Identifier>,
    /// Frames with this identifier are followed by `times` copies, at intervals of `after_ms`.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub repeat: Option<Identifier>,
    /// Frames with this identifier are exchanged with the next frame of their sender, or sent after `within_ms`.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub swap: Option<Identifier>,
    /// Frames with this identifier are sent with changed `data`, `dlc` or `identifier`, and a valid CRC.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub corrupt: Option<Identifier>,
    /// An additional frame that no device sends, as in "220#0F00 0020"; cyclic with `every_ms`.
    pub insert: Option<String>,
    /// Like insert, but with an identifier of a device on the bus: the frame appears to come from this device.
    pub masquerade: Option<String>,
    /// A bit error destroys attempts to send frames with this identifier. The controller retries; 32 errors in a row
    /// take the controller bus-off.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub destroy: Option<Identifier>,
    /// The receivers detect an error in the last but one bit of a frame with this identifier and discard the frame. All
    /// other nodes accept the frame, and the sender retransmits the frame.
    #[schema(value_type = Option<IdentifierOrAll>)]
    pub omit: Option<Identifier>,
    /// The name of the fault; by default its kind and identifier, as in lose-220.
    pub name: Option<String>,
    /// The bits of the identifier to compare; all by default.
    pub mask: Option<Identifier>,
    /// Whether the identifier has 29 bits; by default true for eight digits or a value above 7FF.
    pub extended: Option<bool>,
    /// The device or client whose frames are affected; all by default.
    pub sender: Option<String>,
    /// For lose and omit: the affected devices and clients; all by default, but required for omit.
    pub receivers: Option<Vec<String>>,
    /// The maximum number of affected frames; unlimited by default.
    #[schema(minimum = 1, maximum = 4294967295_i64)]
    pub count: Option<u32>,
    /// The probability that a frame is affected, from 0 to 1; 1 by default.
    #[schema(minimum = 0, maximum = 1)]
    pub probability: Option<f64>,
    /// The seed of the random choices; 0 by default.
    #[schema(maximum = 4294967295_i64)]
    pub seed: Option<u32>,
    /// The time until the fault begins, in milliseconds; 0 by default.
    #[schema(maximum = 86400000)]
    pub from_ms: Option<u32>,
    /// The duration of the fault, in milliseconds; unlimited by default.
    #[schema(minimum = 1, maximum = 86400000)]
    pub for_ms: Option<u32>,
    /// For delay: the delay in milliseconds, or the smallest and the largest delay.
    pub ms: Option<Millis>,
    /// For delay: the period of bursts, in milliseconds. Frames wait for the next multiple of the period.
    #[schema(minimum = 1, maximum = 86400000)]
    pub burst_ms: Option<u32>,
    /// For delay: later frames with the same identifier may overtake the frame; false by default.
    pub overtake: Option<bool>,
    /// For repeat: the number of copies; 1 by default.
    #[schema(minimum = 1, maximum = 1000)]
    pub times: Option<u32>,
    /// For repeat: the interval between copies, in milliseconds; 0 by default.
    #[schema(maximum = 86400000)]
    pub after_ms: Option<u32>,
    /// For swap: the maximum wait for the next frame, in milliseconds; 1000 by default.
    #[schema(maximum = 86400000)]
    pub within_ms: Option<u32>,
    /// For insert and masquerade: the period, in milliseconds; by default, the frame is sent once.
    #[schema(minimum = 1, maximum = 86400000)]
    pub every_ms: Option<u32>,
    /// For corrupt: the changed bits of the data, in hex, first byte first.
    pub data: Option<DataMasks>,
    /// For corrupt: the changed bits of the data length code.
    pub dlc: Option<DlcMasks>,
    /// For corrupt: the changed bits of the identifier.
    pub identifier: Option<IdentifierMasks>,
}

/// A time in milliseconds, or its minimum and maximum.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
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
#[derive(Clone, Debug, Default, Serialize, Deserialize, ToSchema)]
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
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize, ToSchema)]
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
#[derive(Clone, Debug, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentifierMasks {
    /// Bits that become 1.
    pub set: Option<Identifier>,
    /// Bits that become 0.
    pub clear: Option<Identifier>,
    /// Bits that are inverted.
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

/// The kinds that affect the frames of an identifier.
const FILTERED: &[&str] = &["lose", "delay", "repeat", "swap", "corrupt", "destroy", "omit"];

/// The parameters that only some kinds accept, each with these kinds.
const PARAMETERS: [(&str, &[&str]); 14] = [
    ("receivers", &["lose", "omit"]),
    ("ms", &["delay"]),
    ("burst_ms", &["delay"]),
    ("overtake", &["delay"]),
    ("times", &["repeat"]),
    ("after_ms", &["repeat"]),
    ("within_ms", &["swap"]),
    ("every_ms", &["insert", "masquerade"]),
    ("data", &["corrupt"]),
    ("dlc", &["corrupt"]),
    ("identifier", &["corrupt"]),
    ("mask", FILTERED),
    ("extended", FILTERED),
    ("sender", FILTERED),
];

impl FaultRequest {
    /// Returns the keys of the fault kinds.
    pub fn kinds() -> impl Iterator<Item = &'static str> {
        FAULT_KINDS.into_iter()
    }

    /// Converts the request to a fault, with an empty name if none was given.
    ///
    /// # Errors
    /// [`Invalid`] if the request has no kind or several kinds, a parameter of another kind, or a value out of range.
    pub fn fault(&self) -> Result<Fault, Invalid> {
        let kind = self.kind()?;
        let identifiers = [&self.lose, &self.delay, &self.repeat, &self.swap, &self.corrupt, &self.destroy, &self.omit];
        let identifier = identifiers.into_iter().flatten().next();
        let frames = identifier.map(|identifier| self.filter(kind, identifier)).transpose()?.unwrap_or_default();
        let effect = self.effect(kind)?;
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
            return Err(Invalid(format!(
                "name '{name}': must be 1 to {NAME_MAX} letters, digits and '-', but not all"
            )));
        }
        if let Some(probability) = self.probability {
            fault.probability = (probability * f64::from(ALWAYS)).round() as u32;
            if fault.probability == 0 && probability > 0.0 {
                return Err(Invalid(format!("probability {probability}: must be 0 or at least 0.000001")));
            }
        }
        fault.check().map_err(|error| Invalid(error.to_string()))?;
        Ok(fault)
    }

    /// Returns the key of the kind. Refuses several kinds, and parameters that the kind does not accept.
    fn kind(&self) -> Result<&'static str, Invalid> {
        let keys = serde_json::to_value(self).unwrap_or_default();
        let is_given = |key: &str| !keys[key].is_null();
        let mut given = FAULT_KINDS.into_iter().filter(|kind| is_given(kind));
        let kinds = FAULT_KINDS.join(", ");
        let kind = match (given.next(), given.next()) {
            (Some(kind), None) => kind,
            (Some(one), Some(other)) => {
                return Err(Invalid(format!("{one} and {other}: a fault has exactly one of {kinds}")));
            }
            (None, _) => {
                return Err(Invalid(format!(
                    "a fault needs one of {kinds}, as in {{\"lose\": \"220\", \"count\": 3}}"
                )));
            }
        };
        match PARAMETERS.iter().find(|(key, kinds)| is_given(key) && !kinds.contains(&kind)) {
            Some((key, kinds)) => Err(Invalid(format!("{key} is only valid with {}", kinds.join(", ")))),
            None => Ok(kind),
        }
    }

    /// Returns the frame filter for an identifier or for `all`.
    fn filter(&self, kind: &'static str, identifier: &Identifier) -> Result<FrameFilter, Invalid> {
        let sender = self.sender.as_deref().map(Arc::from);
        let is_all = matches!(identifier, Identifier::Text(text) if text == "all");
        if is_all {
            return match (&self.mask, self.extended) {
                (None, None) => Ok(FrameFilter { sender, ..FrameFilter::default() }),
                _ => Err(Invalid("mask and extended are only valid with an identifier, not with \"all\"".to_owned())),
            };
        }
        let extended = self.extended.or_else(|| identifier.needs_29_bits().then_some(true));
        let or_all = |Invalid(reason)| Invalid(reason + "; all selects every identifier");
        let id = identifier.id(extended).map_err(or_all).map_err(within(kind))?;
        let is_extended = matches!(id, Id::Extended(_));
        let mask = self.mask.as_ref().map(|mask| mask.id(Some(is_extended)).map_err(within("mask"))).transpose()?;
        Ok(FrameFilter { id: Some(id), mask: mask.map(|mask| raw(mask).0), sender })
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
                    (None, None) => return Err(Invalid("delay needs ms or burst_ms, such as ms=20".to_owned())),
                    _ => return Err(Invalid("delay needs either ms or burst_ms, not both".to_owned())),
                };
                FaultKind::Delay { delay, overtake: self.overtake.unwrap_or_default() }
            }
            "repeat" => {
                FaultKind::Repeat { times: self.times.unwrap_or(1), after: millis(self.after_ms.unwrap_or_default()) }
            }
            "swap" => FaultKind::Swap { within: self.within_ms.map_or(SWAP_WITHIN, millis) },
            "corrupt" => FaultKind::Corrupt(self.corruption()?),
            "destroy" => FaultKind::Destroy,
            _ => {
                let text = self.insert.as_ref().or(self.masquerade.as_ref()).map_or("", String::as_str);
                let frame = text.parse::<Pattern>().ok().and_then(|pattern| pattern.frame());
                let refuse = || Invalid(format!("{kind}: '{text}' is not a frame as in \"220#0F00 0020\""));
                FaultKind::Insert { frame: frame.ok_or_else(refuse)?, every: self.every_ms.map(millis) }
            }
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
                Some(mask) => mask.id(Some(true)).map(|id| raw(id).0).map_err(within("identifier")),
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

/// Parses up to eight hex bytes; missing bytes are 0.
fn bytes(text: &str) -> Result<[u8; MAX_LEN], Invalid> {
    let data = Pattern::of_data(StandardId::ZERO.into(), Some(text)).ok().and_then(|pattern| pattern.frame());
    data.filter(|data| !data.is_remote())
        .map(|data| *data.bytes())
        .ok_or_else(|| Invalid(format!("data: '{text}' is not up to 8 bytes in hex as in \"00 80\"")))
}

#[cfg(test)]
#[path = "fault_tests.rs"]
mod tests;
