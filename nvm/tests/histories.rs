//! Random histories of stores with power cuts, on flashes with words of 1 to 32 bytes. A cut leaves a record old or new
//! and all others unchanged; no word is written twice (SPEC 6). On some flashes a torn word cannot be read.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use nvm::{BUFFER, Contents, ERASED, Records};
use protocol_core::memory::{Memory as _, RecordKey, StoreError, seal};

const SECTOR: usize = 2048;

/// Two sectors in RAM with words of `W` bytes.
#[derive(Clone)]
struct Flash<const W: usize> {
    cells: Vec<u8>,
    /// Words written since the last erase of their sector.
    written: Vec<bool>,
    /// Words that cannot be read.
    torn: Vec<bool>,
    /// Whether torn words may be unreadable, as with error correction.
    corrects_errors: bool,
    /// A byte that stays 0 after an erase.
    stuck: Option<usize>,
    /// The number of word operations until the power is cut.
    power_for: Option<u64>,
    /// The number of word operations until one fails; the flash then works again.
    fails_after: Option<u64>,
    random: fastrand::Rng,
}

impl<const W: usize> Flash<W> {
    fn new(corrects_errors: bool, seed: u64) -> Self {
        let words = 2 * SECTOR / W;
        Self {
            cells: vec![ERASED; 2 * SECTOR],
            written: vec![false; words],
            torn: vec![false; words],
            corrects_errors,
            stuck: None,
            power_for: None,
            fails_after: None,
            random: fastrand::Rng::with_seed(seed),
        }
    }

    /// Returns whether the next operation succeeds.
    fn is_done(&mut self) -> Result<bool, NorFlashErrorKind> {
        match self.fails_after.take() {
            None => {}
            Some(0) => return Ok(false),
            Some(left) => self.fails_after = Some(left - 1),
        }
        match &mut self.power_for {
            None => Ok(true),
            Some(0) => {
                self.power_for = Some(u64::MAX);
                Ok(false)
            }
            Some(u64::MAX) => Err(NorFlashErrorKind::Other),
            Some(left) => {
                *left -= 1;
                Ok(true)
            }
        }
    }

    fn is_dead(&self) -> bool {
        self.power_for == Some(u64::MAX)
    }
}

impl<const W: usize> ErrorType for Flash<W> {
    type Error = NorFlashErrorKind;
}

impl<const W: usize> ReadNorFlash for Flash<W> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let start = offset as usize;
        let words = start / W..(start + bytes.len()).div_ceil(W);
        if self.is_dead() || self.torn[words].contains(&true) {
            return Err(NorFlashErrorKind::Other);
        }
        bytes.copy_from_slice(&self.cells[start..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.cells.len()
    }
}

impl<const W: usize> NorFlash for Flash<W> {
    const WRITE_SIZE: usize = W;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        assert_eq!((from as usize % SECTOR, to - from), (0, SECTOR as u32));
        let is_done = self.is_done()?;
        let torn = self.random.usize(..5);
        let reached = self.random.usize(..SECTOR);
        for at in from as usize..to as usize {
            let place = at - from as usize;
            let is_erased = is_done || (torn == 0 && place < reached) || (torn == 1 && place > reached);
            self.cells[at] = match torn {
                _ if is_erased => ERASED,
                2 => 0,
                3 => self.random.u8(..),
                4 => self.cells[at] | self.random.u8(..),
                _ => self.cells[at],
            };
            self.written[at / W] = !is_done;
            self.torn[at / W] = !is_done && self.corrects_errors && self.random.bool();
        }
        if let Some(stuck) = self.stuck {
            self.cells[stuck] = 0;
        }
        if is_done { Ok(()) } else { Err(NorFlashErrorKind::Other) }
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        assert!((offset as usize).is_multiple_of(W) && bytes.len().is_multiple_of(W));
        for (word, content) in bytes.chunks_exact(W).enumerate() {
            let word = offset as usize / W + word;
            assert!(!self.written[word], "word {word} of {W} bytes is written twice");
            let is_done = self.is_done()?;
            if !is_done && self.random.bool() {
                // The cut was between two words.
                return Err(NorFlashErrorKind::Other);
            }
            self.written[word] = true;
            for (cell, byte) in self.cells[word * W..][..W].iter_mut().zip(content) {
                *cell = if is_done { *byte } else { *byte | self.random.u8(..) };
            }
            if !is_done {
                // A word that reads as erased cannot be distinguished from an erased one.
                self.written[word] = self.cells[word * W..][..W].iter().any(|cell| *cell != ERASED);
                self.torn[word] = self.written[word] && self.corrects_errors && self.random.bool();
                return Err(NorFlashErrorKind::Other);
            }
        }
        Ok(())
    }
}

/// The contents: each record, and the setting.
type Held = (Vec<Option<Vec<u8>>>, Option<Vec<u8>>);

fn held<const W: usize>(flash: &mut Flash<W>) -> Held {
    let mut buffer = [0; BUFFER];
    let mut contents = Contents::empty();
    let read = Records::new(flash, &mut buffer).read(&mut contents);
    assert_eq!(read, Ok(()), "it makes sense");
    let record = |key| contents.image.sealed(key).expect("nothing is damaged").map(<[u8]>::to_vec);
    (RecordKey::ALL.into_iter().map(record).collect(), contents.setting.map(|setting| setting.to_vec()))
}

/// Returns the content of a record: noise mixed with bytes that read as erased.
fn content(random: &mut fastrand::Rng) -> Vec<u8> {
    let (length, erased) = (random.usize(..100), random.u8(..4));
    (0..length).map(|_| if random.u8(..4) < erased { ERASED } else { random.u8(..) }).collect()
}

/// Plays a history; returns the number of failed operations.
fn play<const W: usize>(corrects_errors: bool, seed: u64) -> u32 {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut flash = Flash::<W>::new(corrects_errors, seed);
    let (mut before, mut hits) = (held(&mut flash), 0);
    for step in 0..random.u32(1..120) {
        let key = RecordKey::ALL[random.usize(..6)];
        let payload = content(&mut random);
        let setting = &payload[..payload.len().min(8)];
        let record = seal(1, &payload).expect("a record");
        let (choice, mut after) = (random.u32(..20), before.clone());
        match choice {
            0 => after.0.fill(None),
            1 => after.1 = Some(setting.to_vec()),
            _ => after.0[key.position()] = Some(record.to_vec()),
        }
        let place = Some(random.u64(..80));
        match random.u8(..4) {
            0 | 1 => flash.power_for = place,
            2 => flash.fails_after = place,
            _ => {}
        }
        let fails = flash.fails_after.is_some();
        let mut buffer = [0; BUFFER];
        let mut records = Records::new(&mut flash, &mut buffer);
        let done: Result<(), StoreError> = match choice {
            0 => records.clear(),
            1 => records.store_setting(setting),
            _ => records.store(key, &record),
        };
        let is_hit = flash.is_dead() || (fails && flash.fails_after.is_none());
        (flash.power_for, flash.fails_after) = (None, None);
        hits += u32::from(is_hit);
        let found = held(&mut flash);
        let what = format!("words of {W} bytes, seed {seed}, step {step}, choice {choice}, {done:?}, hit: {is_hit}");
        assert!(done.is_ok() || is_hit, "{what}");
        assert!(found == after || (done.is_err() && found == before), "{what}");
        before = found;
    }
    hits
}

#[test]
fn a_cut_or_failure_leaves_everything_old_or_new() {
    let histories = std::env::var("NVM_HISTORIES").map_or(60, |count| count.parse().expect("a number"));
    for corrects_errors in [false, true] {
        let mut hits = 0;
        for seed in 0..histories {
            hits += play::<1>(corrects_errors, seed);
            hits += play::<2>(corrects_errors, seed);
            hits += play::<4>(corrects_errors, seed);
            hits += play::<8>(corrects_errors, seed);
            hits += play::<32>(corrects_errors, seed);
        }
        assert!(hits > 1000, "{hits}");
    }
}

/// A power cut between any two words of a store, for contents of all lengths.
#[test]
fn a_cut_between_two_words_leaves_the_old_content() {
    for length in 0..60 {
        let mut flash = Flash::<4>::new(false, 1);
        let store = |flash: &mut Flash<4>, byte| {
            let record = seal(1, &vec![byte; length]).expect("a record");
            let mut buffer = [0; BUFFER];
            Records::new(flash, &mut buffer).store(RecordKey::LocalLayer, &record).expect("it does not fail");
            record.to_vec()
        };
        let old = store(&mut flash, 0x20);
        let before = flash.clone();
        let new = store(&mut flash, 0x33);
        let written: Vec<usize> = (0..flash.cells.len()).filter(|at| before.cells[*at] != flash.cells[*at]).collect();
        let words = written[0] / 4..written[written.len() - 1] / 4 + 1;
        for cut in words {
            let mut cut_flash = flash.clone();
            cut_flash.cells[cut * 4..].fill(ERASED);
            let found = held(&mut cut_flash).0[RecordKey::LocalLayer.position()].clone();
            assert!(found.as_ref() == Some(&old) || found.as_ref() == Some(&new), "{length} bytes, cut at word {cut}");
        }
    }
}

/// After an interrupted first store the memory has no entry. An entry could distinguish the remains of an interrupted
/// erase from noise.
#[test]
fn a_cut_first_store_and_a_cut_clear_are_no_damage() {
    for seed in 0..200 {
        let mut flash = Flash::<4>::new(false, seed);
        let mut buffer = [0; BUFFER];
        let record = seal(1, b"never kept").expect("a record");
        flash.power_for = Some(seed % 4);
        assert!(Records::new(&mut flash, &mut buffer).store(RecordKey::LocalLayer, &record).is_err());
        flash.power_for = Some(seed / 4 % 5);
        let _ = Records::new(&mut flash, &mut buffer).clear();
        flash.power_for = None;
        assert_eq!(held(&mut flash).0, vec![None; RecordKey::ALL.len()], "seed {seed}");
    }
}

#[test]
fn noise_can_be_cleared() {
    for sector in 0..2 {
        let mut flash = Flash::<4>::new(false, 1);
        flash.cells[sector * SECTOR..][..SECTOR].fill(0);
        let mut buffer = [0; BUFFER];
        let mut records = Records::new(&mut flash, &mut buffer);
        assert!(records.read(&mut Contents::empty()).is_err(), "it makes no sense");
        records.clear().expect("it does not fail");
        assert_eq!(records.read(&mut Contents::empty()), Ok(()));
    }
}

/// A word that stays written after an erase costs its space, but no store.
#[test]
fn a_stuck_word_stops_no_move() {
    for stuck in (SECTOR..2 * SECTOR).step_by(136) {
        let mut flash = Flash::<4>::new(false, 1);
        flash.stuck = Some(stuck);
        for round in 0..60_u8 {
            let key = RecordKey::ALL[usize::from(round) % 6];
            let record = seal(1, &[round; 100]).expect("a record");
            let mut buffer = [0; BUFFER];
            Records::new(&mut flash, &mut buffer).store(key, &record).expect("there is room");
            assert_eq!(held(&mut flash).0[key.position()].as_deref(), Some(&*record), "byte {stuck}, round {round}");
        }
    }
}
