//! Communication faults and their effects in words.

use std::fmt::{self, Display, Formatter};
use std::sync::Arc;

use protocol_core::frame::Digits;
use protocol_core::time::Duration;

use super::fault::{ALWAYS, Corruption, Delay, Fault, FaultEffect, FaultKind, FrameFilter, Masks};

/// A time, written as whole milliseconds or with three decimals.
struct Ms(Duration);

/// Names, separated by commas.
struct Names<'a>(&'a [Arc<str>]);

/// Bytes, written in hex without the trailing zero bytes.
struct Hex<'a>(&'a [u8]);

impl Display for Ms {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let micros = self.0.as_micros();
        match micros % 1000 {
            0 => write!(f, "{} ms", micros / 1000),
            rest => write!(f, "{}.{rest:03} ms", micros / 1000),
        }
    }
}

impl Display for Names<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join(", "))
    }
}

impl Display for Hex<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let used = self.0.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        self.0[..used].iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}

impl Fault {
    /// Returns a name made of the kind and the identifier, if any: `lose-220`.
    #[must_use]
    pub fn default_name(&self) -> String {
        let id = match &self.kind {
            FaultKind::Insert { frame, .. } => Some(frame.id()),
            _ => self.frames.id,
        };
        match id {
            None => word(&self.kind).to_owned(),
            Some(id) => format!("{}-{}", word(&self.kind), Digits(id)),
        }
    }
}

/// Writes the fault as text, as in `lose 220 for boom, count 3, from 100 ms`.
impl Display for Fault {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match &self.kind {
            FaultKind::Insert { frame, .. } => write!(f, "insert {frame}")?,
            kind => write!(f, "{} {}", word(kind), self.frames)?,
        }
        parameters(&self.kind, f)?;
        if let Some(count) = self.count {
            write!(f, ", count {count}")?;
        }
        if self.probability < ALWAYS {
            write!(f, ", probability {}", f64::from(self.probability) / f64::from(ALWAYS))?;
        }
        if self.from.as_ticks() > 0 {
            write!(f, ", from {}", Ms(self.from))?;
        }
        self.lasts.map_or(Ok(()), |lasts| write!(f, ", for {}", Ms(lasts)))
    }
}

impl Display for FrameFilter {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.id {
            None => f.write_str("all")?,
            Some(id) => Digits(id).fmt(f)?,
        }
        if let Some(mask) = self.mask {
            write!(f, " mask {mask:X}")?;
        }
        self.sender.as_ref().map_or(Ok(()), |sender| write!(f, " of {sender}"))
    }
}

/// Writes the effect in words, to follow the affected frame.
impl Display for FaultEffect {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost(receivers) if receivers.is_empty() => f.write_str("lost for all receivers"),
            Self::Lost(receivers) => write!(f, "lost for {}", Names(receivers)),
            Self::Delayed(late) => write!(f, "delayed by {}", Ms(*late)),
            Self::Repeated(1) => f.write_str("repeated once"),
            Self::Repeated(times) => write!(f, "repeated {times} times"),
            Self::Swapped => f.write_str("held back for the next frame of its sender"),
            Self::Corrupted(frame) => write!(f, "sent as {frame}"),
            Self::Inserted => f.write_str("inserted"),
            Self::Destroyed => f.write_str("destroyed"),
            Self::Omitted(receivers) => write!(f, "omitted for {}", Names(receivers)),
        }
    }
}

const fn word(kind: &FaultKind) -> &'static str {
    match kind {
        FaultKind::Lose { .. } => "lose",
        FaultKind::Delay { .. } => "delay",
        FaultKind::Repeat { .. } => "repeat",
        FaultKind::Swap { .. } => "swap",
        FaultKind::Corrupt(_) => "corrupt",
        FaultKind::Insert { .. } => "insert",
        FaultKind::Destroy => "destroy",
        FaultKind::Omit { .. } => "omit",
    }
}

fn parameters(kind: &FaultKind, f: &mut Formatter<'_>) -> fmt::Result {
    match kind {
        FaultKind::Lose { receivers } | FaultKind::Omit { receivers } if !receivers.is_empty() => {
            write!(f, " for {}", Names(receivers))
        }
        FaultKind::Delay { delay, overtake } => {
            match delay {
                Delay::Constant(late) => write!(f, " by {}", Ms(*late))?,
                Delay::Uniform(from, to) => write!(f, " by {} to {}", Ms(*from), Ms(*to))?,
                Delay::Burst(period) => write!(f, " into bursts every {}", Ms(*period))?,
            }
            f.write_str(if *overtake { ", overtaken by later ones" } else { "" })
        }
        FaultKind::Repeat { times, after } => {
            write!(f, " {}", FaultEffect::Repeated(*times).to_string().trim_start_matches("repeated "))?;
            if after.as_ticks() > 0 { write!(f, " every {}", Ms(*after)) } else { Ok(()) }
        }
        FaultKind::Swap { within } => write!(f, " within {}", Ms(*within)),
        FaultKind::Corrupt(Corruption { id, dlc, data }) => {
            masks(f, "identifier", id, |mask| format!("{mask:X}"), 0)?;
            masks(f, "dlc", dlc, |mask| mask.to_string(), 0)?;
            masks(f, "data", data, |mask| Hex(mask).to_string(), [0; 8])
        }
        FaultKind::Insert { every: Some(every), .. } => write!(f, " every {}", Ms(*every)),
        _ => Ok(()),
    }
}

fn masks<T: PartialEq>(
    f: &mut Formatter<'_>,
    what: &str,
    Masks { set, clear, toggle }: &Masks<T>,
    text: impl Fn(&T) -> String,
    none: T,
) -> fmt::Result {
    let given = [("set", set), ("clear", clear), ("toggle", toggle)].into_iter().filter(|(_, mask)| **mask != none);
    given.into_iter().try_for_each(|(name, mask)| write!(f, ", {what} {name} {}", text(mask)))
}
