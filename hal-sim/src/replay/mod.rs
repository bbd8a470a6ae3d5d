//! `pve-sim replay`: compares a recording of devices with simulated devices, in virtual time.
//!
//! ```text
//! mod           the replay in rounds, from the recording to the outcome
//! entries       the entries of the log, without the jumps of its clock
//! timeline      the power-up of each device
//! identifier    identifiers of devices and of address claims
//! replay_bus    the simulated devices on a bus, in virtual time
//! attribution   the log frames that belong to the replayed devices
//! item          a logged or a sent frame
//! frame_matcher pairs of logged and sent frames of one identifier
//! fields        the position fields of a frame
//! position      the tolerance of a position
//! report        differences as text
//! ```
//!
//! A log does not contain power-ups. Each simulated device is powered on so that its first frame (boot-up or address
//! claim) ends at the same time as in the log. A device without this frame in the log is powered on before the log, so
//! that its cyclic messages have the phase of the log. A client sends the frames of other nodes so that they end at the
//! logged times. Such a frame may lose an arbitration that it won in the log, and is then late by the length of one
//! frame.
//!
//! A log frame from a replayed device may remain unrecognised, for example a PDO with a changed COB-ID. The client then
//! sends this frame, and soon the simulated device sends the same identifier. The next round repeats the replay with
//! this identifier attributed to the devices.

mod attribution;
mod entries;
mod fields;
mod frame_matcher;
mod identifier;
mod item;
mod position;
mod replay_bus;
mod report;
mod timeline;

pub use report::{Difference, What};

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt::Display;
use std::path::PathBuf;

use protocol_core::frame::Frame;
use protocol_core::time::{Duration, Instant, after, since};

use self::entries::{Entries, Placed};
use self::frame_matcher::{CANNOT_CLAIM, FrameMatcher, tolerance_of};
use self::identifier::{id_of_key, is_cannot_claim, is_claim};
use self::item::{Item, PATIENCE};
use self::replay_bus::ReplayBus;
use self::timeline::Timeline;
use crate::devices::{NamedDevice, NamedLink};
use crate::log::Entry;
use crate::recording::{Logged, ReadError};

/// The maximum number of rounds. Each round after the first repeats the replay with the identifiers found before.
const ROUNDS: usize = 4;

/// The maximum number of reported differences, and of reported unreadable entries.
const TOLD: usize = 1000;

/// The interval, in virtual time, at which logged and sent frames are paired.
const PAIRING: Duration = Duration::from_millis(100);

/// The options of a replay. The devices must have unique names and must not conflict.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayOptions {
    /// The recording.
    pub file: PathBuf,
    /// The devices to simulate, with new memories.
    pub devices: Vec<NamedDevice>,
    /// The links between valves and sensors.
    pub links: Vec<NamedLink>,
    /// The time tolerance of a frame.
    pub tolerance: Duration,
    /// True to skip all entries before the first boot-up or address claim of any simulated device.
    pub from_boot_up: bool,
    /// The seed of all random values. A simulation with this seed, the same devices and the same links wrote the
    /// recording.
    pub seed: u64,
}

/// The outcome of a replay.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// The number of log frames compared with frames from the simulated devices.
    pub compared: u64,
    /// The number of log frames sent to the simulated devices.
    pub played: u64,
    /// The number of skipped error frames in the log.
    pub error_frames: u64,
    /// The number of entries that [`ReplayOptions::from_boot_up`] skipped.
    pub skipped: u64,
    /// The reported differences, in chronological order.
    pub told: Vec<Difference>,
    /// The total number of differences.
    pub differences: u64,
    /// The reported unreadable entries of the log, with their causes.
    pub unread: Vec<String>,
    /// The number of the log entry that determined the power-up of each device; `None` for a device powered up before
    /// the log.
    pub power_ups: Vec<Option<u64>>,
}

impl Outcome {
    /// Returns whether the whole log was readable and the simulated devices match it.
    #[must_use]
    pub fn is_as_logged(&self) -> bool {
        self.differences == 0 && self.unread.is_empty()
    }
}

/// The reason why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct ReplayError {
    path: PathBuf,
    reason: Refusal,
}

/// The reason without the name of the file: a read error or a message.
type Refusal = Box<dyn Error + Send + Sync>;

/// Replays a recording.
///
/// # Errors
/// [`ReplayError`] if the recording cannot be read or contains nothing to compare.
pub fn replay(options: &ReplayOptions) -> Result<Outcome, ReplayError> {
    let replayed = Timeline::find(options).and_then(|timeline| play_rounds(options, &timeline, ROUNDS));
    replayed.map_err(|reason| ReplayError { path: options.file.clone(), reason })
}

/// Repeats the replay until all identifiers of the simulated devices are known, for at most `rounds` rounds.
fn play_rounds(options: &ReplayOptions, timeline: &Timeline, rounds: usize) -> Result<Outcome, Refusal> {
    let mut own = BTreeSet::new();
    let mut misplayed = BTreeSet::new();
    for _ in 0..rounds {
        let mut player = Player::new(options, timeline, own);
        player.play()?;
        misplayed = std::mem::take(&mut player.misplayed);
        if misplayed.is_empty() {
            return match player.silent().filter(|_| player.outcome.is_as_logged()) {
                Some(name) => Err(format!("no frame from {name} in the log").into()),
                None => Ok(player.outcome),
            };
        }
        own = player.own;
        own.extend(&misplayed);
    }
    let ids: Vec<String> = misplayed.into_iter().map(id_of_key).collect();
    let ids = ids.join(", ");
    Err(format!("the devices still sent identifiers of other nodes after {ROUNDS} rounds: {ids}").into())
}

/// One round of a replay.
struct Player<'a> {
    options: &'a ReplayOptions,
    timeline: &'a Timeline,
    bus: ReplayBus,
    /// The known identifiers of the simulated devices, apart from those derived from node IDs, as [keys](Frame::key).
    own: BTreeSet<u32>,
    /// The time of the last log frame of each identifier that was sent to the simulated devices.
    played: BTreeMap<u32, Instant>,
    /// The time of the last frame of each identifier from the simulated devices.
    sent: BTreeMap<u32, Instant>,
    /// The identifiers of frames that were sent to the simulated devices, but belong to them.
    misplayed: BTreeSet<u32>,
    matchers: BTreeMap<u32, FrameMatcher>,
    /// The indices of the simulated devices that have sent a frame.
    heard: BTreeSet<usize>,
    /// The time at which recorded and sent frames were last matched.
    paired: Instant,
    /// The [shifts](Placed::shift) of the log time, with the times from which they apply.
    shifts: Vec<(Instant, i64)>,
    outcome: Outcome,
}

impl<'a> Player<'a> {
    fn new(options: &'a ReplayOptions, timeline: &'a Timeline, own: BTreeSet<u32>) -> Self {
        Self {
            bus: ReplayBus::new(options, timeline),
            options,
            timeline,
            own,
            played: BTreeMap::new(),
            sent: BTreeMap::new(),
            misplayed: BTreeSet::new(),
            matchers: BTreeMap::new(),
            heard: BTreeSet::new(),
            paired: Instant::from_ticks(0),
            shifts: Vec::new(),
            outcome: Outcome { power_ups: timeline.entries(), ..Outcome::default() },
        }
    }

    fn play(&mut self) -> Result<(), Refusal> {
        let mut end = Instant::from_ticks(0);
        for entry in Entries::open(&self.options.file)? {
            let Placed { logged, shift, jump } = match entry {
                Ok(placed) => placed,
                Err(error @ ReadError::NoEntry { .. }) => {
                    self.name(&error);
                    continue;
                }
                Err(ReadError::Io(error)) => return Err(error.into()),
            };
            let Some(at) = self.timeline.instant(&logged) else {
                self.outcome.skipped += 1;
                continue;
            };
            if self.shifts.last().is_none_or(|(_, last)| *last != shift) {
                self.shifts.push((at, shift));
            }
            if let Some(jump) = jump {
                self.name(&format_args!("{}: {jump}", logged.number));
            }
            if since(end, at) > self.options.tolerance {
                self.name(&format_args!("{}: time earlier than that of the previous entry", logged.number));
            }
            end = end.max(at);
            match logged.record.entry {
                Entry::Frame(frame) => self.take(&logged, frame, at),
                Entry::Error(_) => self.outcome.error_frames += 1,
            }
            if since(at, self.paired) >= PAIRING {
                self.paired = at;
                self.pair(self.bus.now().min(at), None);
            }
        }
        let latest = after(end, self.options.tolerance);
        self.bus.run_before(latest);
        self.collect();
        // The last frame of the log may be a cannot-claim that the simulated device sends later.
        self.bus.run_before(after(latest, CANNOT_CLAIM));
        self.bus.sent.retain(|item| is_cannot_claim(&item.frame));
        self.collect();
        self.pair(Instant::MAX, Some(end));
        self.outcome.told.sort_by_key(|difference| (difference.at, difference.number));
        Ok(())
    }

    /// Records the message about an unreadable entry or an invalid time.
    fn name(&mut self, what: &dyn Display) {
        if self.outcome.unread.len() < TOLD {
            self.outcome.unread.push(format!("{}:{what}", self.options.file.display()));
        }
    }

    /// Processes a log frame: queues a frame from a simulated device for comparison, and sends any other frame.
    fn take(&mut self, logged: &Logged, frame: Frame, at: Instant) {
        self.bus.run_to_start(&frame, at);
        self.collect();
        if self.timeline.is_first(logged.number) || self.bus.is_own(&frame, &self.own, self.timeline) {
            self.outcome.compared += 1;
            let item = Item { at, frame, number: Some(logged.number), device: None, fields: Vec::new() };
            self.matchers.entry(frame.key()).or_default().logged.push_back(item);
        } else {
            self.outcome.played += 1;
            self.played.insert(frame.key(), at);
            self.note_misplayed(frame.key());
            self.bus.send(frame);
        }
    }

    fn collect(&mut self) {
        for item in std::mem::take(&mut self.bus.sent) {
            self.heard.extend(item.device);
            let key = item.frame.key();
            self.sent.insert(key, item.at);
            self.note_misplayed(key);
            self.matchers.entry(key).or_default().sent.push_back(item);
        }
    }

    /// Records an identifier that was sent to the simulated devices and by one of them, unless it is known to be the
    /// device's own. The two frames must be close: another node may use an identifier that the device had before.
    fn note_misplayed(&mut self, key: u32) {
        let (Some(played), Some(sent)) = (self.played.get(&key), self.sent.get(&key)) else { return };
        let tolerance = self.options.tolerance;
        let is_close = since(*played, *sent) <= tolerance && since(*sent, *played) <= tolerance + PATIENCE;
        if is_close && !is_claim(key) && !self.own.contains(&key) {
            self.misplayed.insert(key);
        }
    }

    /// Pairs the logged and sent frames up to `known`. Sent frames before the first entry of the log or after `end` are
    /// not reported as additional.
    fn pair(&mut self, known: Instant, end: Option<Instant>) {
        let tolerance = self.options.tolerance;
        for matcher in self.matchers.values_mut() {
            while let Some(verdict) = matcher.next(known, tolerance, &self.bus.positions) {
                let Some(what) = verdict.what else { continue };
                let sent = verdict.sent.as_ref();
                let tolerance = sent.map_or(tolerance, |item| tolerance_of(&item.frame, tolerance));
                let latest = after(verdict.at, tolerance);
                let is_outside = end.is_some_and(|end| latest > end) || latest < self.timeline.opened();
                if what == What::Additional && is_outside {
                    continue;
                }
                self.outcome.differences += 1;
                if self.outcome.told.len() < TOLD {
                    let at = self.timeline.time(verdict.at, &self.shifts);
                    self.outcome.told.push(self.bus.difference(what, &verdict, at));
                }
            }
        }
        self.bus.positions.forget(known);
    }

    /// Returns the name of the first simulated device that has sent no frame, for example a blank device without LSS
    /// requests. Nothing was compared for this device.
    fn silent(&self) -> Option<&'a str> {
        let options = self.options;
        let mut devices = options.devices.iter().enumerate();
        devices.find(|(place, _)| !self.heard.contains(place)).map(|(_, device)| device.name.as_str())
    }
}

#[cfg(test)]
mod tests;
