//! The manifest of results: the plan, the version of pve-sim, and the machine.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::cores::processors;

/// The version of the format of results files.
pub(super) const FORMAT: u32 = 1;

/// The first line of a results file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// [`FORMAT`].
    pub(super) format: u32,
    /// The version of pve-sim.
    pub(super) version: String,
    /// The commit of pve-sim; `None` if unknown at build time.
    pub(super) commit: Option<String>,
    /// The plan as named on the command line.
    pub(super) plan: String,
    /// The CRC-64 of the plan and its scenario, in hex.
    pub(super) plan_hash: String,
    /// The title of the plan.
    pub(super) title: String,
    /// The seeds of the runs.
    pub(super) seeds: Vec<u64>,
    /// The seed of `--seed`, which replaced the seeds of the plan.
    pub(super) seed: Option<u64>,
    /// The part of `--shard`; `None` for all rows.
    pub(super) shard: Option<Shard>,
    /// The number of rows of the whole campaign.
    pub(super) rows: usize,
    /// The limits and the observation time of the plan.
    pub(super) limits: LimitsUs,
    /// True if cells were forked at the instant of the fault; otherwise each cell ran from 0 ms.
    pub(super) forked: bool,
    /// The system, the processor architecture and the number of cores of each machine.
    pub(super) machine: String,
    /// The rows missing from all merged files; `None` if no row is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) missing: Option<String>,
}

/// The limits and the observation time of a plan, in microseconds. A limit is `None` if the plan lacks its oracle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LimitsUs {
    pub(super) detected_us: Option<u64>,
    pub(super) safe_us: Option<u64>,
    pub(super) observe_us: u64,
}

impl Manifest {
    /// Returns whether the results of two manifests belong to the same campaign.
    pub(super) fn is_of_campaign_of(&self, other: &Self) -> bool {
        let common = |manifest: &Self| Self {
            shard: None,
            machine: String::new(),
            missing: None,
            plan: String::new(),
            ..manifest.clone()
        };
        common(self) == common(other)
    }
}

/// Returns the system, the processor architecture and the number of cores of this machine.
pub(super) fn machine() -> String {
    format!("{} {}, {} cores", std::env::consts::OS, std::env::consts::ARCH, processors())
}

/// Returns the hash of a plan and its scenario.
pub(super) fn hash(plan: &str, scenario: &str) -> String {
    let crc = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    let mut digest = crc.digest();
    for text in [plan, "\0", scenario] {
        digest.update(text.as_bytes());
    }
    format!("{:016x}", digest.finalize())
}

/// A part of a campaign. Part K of N has the rows whose number modulo N is K − 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Shard {
    part: usize,
    of: usize,
}

impl Shard {
    /// Returns whether a row belongs to the part.
    pub(super) const fn has(self, row: usize) -> bool {
        row % self.of == self.part - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| text.parse::<usize>().ok().filter(|number| *number > 0);
        let parts = text.split_once('/').and_then(|(part, of)| Some((number(part)?, number(of)?)));
        let parts = parts.filter(|(part, of)| part <= of).map(|(part, of)| Self { part, of });
        parts.ok_or_else(|| "must be K/N, part K of N, as in 1/4".to_owned())
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.part, self.of)
    }
}

impl TryFrom<String> for Shard {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_belongs_to_one_shard() {
        let shards: Vec<Shard> = ["1/3", "2/3", "3/3"].map(|text| text.parse().expect("a shard")).to_vec();
        for row in 0..10 {
            assert_eq!(shards.iter().filter(|shard| shard.has(row)).count(), 1, "{row}");
        }
        assert!(shards[1].has(1) && shards[1].has(4));
        for text in ["", "1", "0/3", "4/3", "1/0", "a/b", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
        assert_eq!(serde_json::to_string(&shards[0]).ok().as_deref(), Some("\"1/3\""));
    }

    #[test]
    fn the_hash_covers_plan_and_scenario() {
        assert_eq!(hash("a", "b").len(), 16);
        assert_ne!(hash("a", "b"), hash("a", "c"));
        assert_ne!(hash("ab", ""), hash("a", "b"));
    }
}
