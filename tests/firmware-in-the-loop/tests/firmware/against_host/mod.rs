//! Image and host device under the same random traffic, legal and hostile: each frame of the image has to be the host's,
//! in its order and at its time.
//!
//! ```text
//! traffic    random steps
//! recorder   plays the steps on the emulated board, and records what happened to its image
//! host       the host device in the place of the image
//! mailboxes  the host device's CAN controller
//! compare    ties between image and host, and the fewest steps to a difference
//! ```
//!
//! The image acts up to [`host::REACTION`] after the event that it acts on; the host acts when it is told to. Two events
//! that close together (a frame, a timer, a start of frame) may act in either order. Where image and host differ, the
//! host plays again with other delays within that limit, and has to agree then: that is a tie. A position may be as old
//! as that limit. At a power cut both memories hold the same, unless a record was being written.
//!
//! Not in the traffic: destroyed frames other than by claims that collide; bus-off; the loss of an address, because the
//! delay of a cannot-claim is drawn from the clock; a preset of a shaft that turns, because the offset depends on the
//! microsecond.
//!
//! `AGAINST_HOST_EPISODES` sets the number of episodes, `AGAINST_HOST_SEED` the first seed.

mod compare;
mod host;
mod mailboxes;
mod recorder;
mod traffic;

use firmware_in_the_loop::content;
use firmware_in_the_loop::rig::Device;
use protocol_core::device::{Kind, Protocol, hat, pve};

use super::budgets::print;
use compare::{Verdict, compare, listing, shrink};
use recorder::Recorder;

/// The number of episodes of each kind.
const EPISODES: u64 = 2;
/// The number of batches of steps in an episode.
const BATCHES: usize = 600;
/// The fewest frames of an episode on average: below, nothing was compared.
const FRAMES: u64 = 250;

fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |value| value.parse().unwrap_or_else(|_| panic!("{name} is no number")))
}

fn sends_the_frames_of_the_host(kind: Kind) {
    let node_id = if kind.protocol() == Protocol::Isobus { 0x83 } else { 0x20 };
    let device = Device { kind, node_id, serial: None };
    let (first, episodes) = (variable("AGAINST_HOST_SEED", 1), variable("AGAINST_HOST_EPISODES", EPISODES));
    let content = content::stored_by(&device);
    // A new board for each episode: a seed plays the same, whatever was played before.
    let recorder = || Recorder::new(&content, kind.bit_rates()[0]);
    let (mut frames, mut ties, mut seconds) = (0, 0, 0.0);
    for seed in first..first + episodes {
        let mut random = fastrand::Rng::with_seed(seed << 8 | u64::from(kind.number()));
        let steps = traffic::steps(&device, BATCHES, &mut random);
        let runs = recorder().play(&steps);
        seconds += runs.iter().map(|run| run.end as f64 / 1e6).sum::<f64>();
        match compare(&device, &runs) {
            Verdict::Same(compared, tied) => (frames, ties) = (frames + compared, ties + tied),
            Verdict::Differs(run, difference) => {
                let found = listing(&runs[run], &difference);
                let fewest = shrink(&device, &mut recorder(), steps, found);
                panic!("{kind}, seed {seed}: {}\n{fewest}", difference.what);
            }
        }
    }
    print(&format!("{kind}, seeds from {first}: {episodes} episodes, {frames} frames, {ties} ties, {seconds:.0} s"));
    assert!(episodes > 0 && frames >= FRAMES * episodes, "hardly anything was compared");
}

#[test]
fn pvea_canopen() {
    sends_the_frames_of_the_host(Kind::Pve(pve::Kind::PveaCanopen));
}

#[test]
fn pveo_canopen() {
    sends_the_frames_of_the_host(Kind::Pve(pve::Kind::PveoCanopen));
}

#[test]
fn pvea_isobus() {
    sends_the_frames_of_the_host(Kind::Pve(pve::Kind::PveaIsobus));
}

#[test]
fn pveo_isobus() {
    sends_the_frames_of_the_host(Kind::Pve(pve::Kind::PveoIsobus));
}

#[test]
fn hat1000() {
    sends_the_frames_of_the_host(Kind::Hat(hat::Kind::Hat1000));
}

#[test]
fn hat3000() {
    sends_the_frames_of_the_host(Kind::Hat(hat::Kind::Hat3000));
}
