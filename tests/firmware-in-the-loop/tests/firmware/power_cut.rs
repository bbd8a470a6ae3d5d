//! The power is cut while parameters are stored: afterwards all of them are old or all are new (SPEC 6).
//!
//! The instants are random, the same in each run. Half of them are in a store that writes words only, the others in one
//! that moves what the flash holds and erases a sector, and half of those in the erase: it takes nearly all of the time,
//! and the new values are complete before it begins.

use std::ops::Range;

use firmware_in_the_loop::board::{Board, NUCLEO_F429ZI};
use firmware_in_the_loop::content;
use protocol_core::time::Instant;

use super::client::{ImageClient, SAVE, VALVE, download, frame};

/// How many cuts a test makes.
const CUTS: u64 = 50;
/// One instruction between two operations of the flash takes less; in microseconds.
const CLOSE: u64 = 2;

/// How long after the last operation the answer is out, in microseconds.
const TAIL: u64 = 1000;

/// Index, sub-index, size, old and new value of what is changed.
const PARAMETERS: [(u16, u8, u8, u32, u32); 5] = [
    (0x1005, 0, 4, 0x80, 0x81),
    (0x1017, 0, 2, 0, 30_000),
    (0x1028, 1, 4, 0x8000_0000, 0xA1),
    (0x1800, 2, 1, 0xFF, 5),
    (0x1400, 1, 4, 0x220, 0x8000_0220),
];

/// A valve that has saved the old values and holds the new ones, and the request to save them.
struct Scene {
    client: ImageClient,
    flash: Vec<u8>,
}

impl Scene {
    fn new(board: &'static Board, worn: bool) -> Self {
        let saved = content::stored_after(&VALVE, &[frame("620: 23 10 10 01 73 61 76 65")]);
        let flash = if worn { content::worn(&saved) } else { saved };
        Self { client: ImageClient::with_memory(board, &flash), flash }
    }

    /// From the power on; says when saving was asked for.
    fn set(&mut self) -> Instant {
        let client = &mut self.client;
        let board = client.rig.board;
        client.rig.boards.power(board, false);
        client.connections().flash.lock().restore(&self.flash);
        client.aside.clear();
        client.rig.power_cycle();
        client.expect_boot();
        for (index, sub, size, _, new) in PARAMETERS {
            client.write(index, sub, size, new);
        }
        client.listen_ms(2);
        let asked = client.rig.boards.world.now();
        client.rig.send(protocol_core::frame::Frame::full(frame("620: 00").id(), download(0x1010, 1, 4, SAVE)));
        asked
    }

    /// When what goes on in the flash during an uncut store, in microseconds from the request.
    fn operations(&mut self) -> Vec<(Range<u64>, bool)> {
        let asked = self.set();
        let client = &mut self.client;
        client.expect("5A0: 60 10 10 01 00 00 00 00");
        let boards = &client.rig.boards;
        let board = client.rig.board;
        let flash = boards.connections(board).flash.lock();
        let at = |nanos: u64| (boards.instant(board, nanos).as_micros()).checked_sub(asked.as_micros());
        let span = |operation: &firmware_in_the_loop::flash::Operation| {
            Some((at(operation.from)?..at(operation.until)?, operation.is_erase()))
        };
        flash.journal().iter().filter_map(span).collect()
    }

    /// Cuts so long after the request; whether the answer was out.
    fn cut(&mut self, after_us: u64) -> bool {
        let asked = self.set();
        let client = &mut self.client;
        let until = Instant::from_micros(asked.as_micros() + after_us);
        let mut answered = false;
        while let Some(frame) = client.rig.receive(until) {
            assert_eq!(frame.to_string(), "5A0: 60 10 10 01 00 00 00 00");
            answered = true;
        }
        client.rig.power_cycle();
        answered
    }

    /// Whether the new values are there, and nothing else is the matter.
    fn found_new(&mut self) -> bool {
        let client = &mut self.client;
        client.expect_boot();
        let found = PARAMETERS.map(|(index, sub, ..)| client.read(index, sub));
        assert_eq!(client.read(0x1001, 0), 0, "a fault is active");
        assert_eq!(client.read(0x2024, 0), 0, "there was an internal error");
        let (old, new) = (PARAMETERS.map(|(.., old, _)| old), PARAMETERS.map(|(.., new)| new));
        assert!(found == old || found == new, "mixed: {found:X?}");
        found == new
    }
}

/// Random instants within the operations of a kind, the gaps around them included, and behind the last one.
pub fn cuts(board: &'static Board, worn: bool, seed: u64) {
    let mut scene = Scene::new(board, worn);
    let operations = scene.operations();
    let (erases, writes): (Vec<_>, Vec<_>) = operations.into_iter().partition(|(_, erase)| *erase);
    assert_eq!(erases.len(), usize::from(worn), "{erases:?}");
    assert!(writes.len() > 20, "{writes:?}");
    let end = writes.iter().map(|(span, _)| span.end).max().unwrap_or_default();
    let mut random = fastrand::Rng::with_seed(seed);
    let (mut old, mut new) = (0, 0);
    for number in 0..CUTS {
        let kind = if worn && number % 2 == 0 { &erases } else { &writes };
        let (span, _) = kind[random.usize(..kind.len())].clone();
        let at = match number % 10 {
            // The record is complete, the answer is not out yet, or just so.
            9 => end + random.u64(..TAIL),
            _ => random.u64(span.start.saturating_sub(CLOSE)..=span.end + CLOSE),
        };
        let answered = scene.cut(at);
        let is_new = scene.found_new();
        assert!(is_new || !answered, "saved and answered, but not there: cut {number} at {at} us");
        *(if is_new { &mut new } else { &mut old }) += 1;
    }
    assert!(old >= CUTS / 5 && new >= CUTS / 20, "{old} old, {new} new: cut before all, or after all");
    scene.client.end_without_reset();
}

#[test]
fn while_words_are_written() {
    cuts(&NUCLEO_F429ZI, false, 1);
}

#[test]
fn while_words_are_written_once_more() {
    cuts(&NUCLEO_F429ZI, false, 2);
}

#[test]
fn while_a_sector_is_erased() {
    cuts(&NUCLEO_F429ZI, true, 3);
}

#[test]
fn while_a_sector_is_erased_once_more() {
    cuts(&NUCLEO_F429ZI, true, 4);
}
