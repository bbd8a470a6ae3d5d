//! Bit rot (SPEC 6): with any bit of the flash turned over the valve boots, and each record is the newest, an older one
//! that is intact, or taken as absent, which is told; never a wrong value.

use hal_sim::memory::{Flash, SIZE, WORD};
use hal_sim::{Memory, NodeId};
use protocol_core::actuator::Color;
use protocol_core::memory::{Image, RecordKey, seal};
use tests::BusRig;

use super::records::VERSION;

/// The records of a valve.
const KEYS: [RecordKey; 5] =
    [RecordKey::Factory, RecordKey::LocalLayer, RecordKey::Parameters, RecordKey::RestoreFlag, RecordKey::FaultLog];

/// A valve at node 0x21 that has stored everything there is.
struct Stored {
    flash: Flash,
    /// Every payload that each record ever had, the newest last.
    versions: [Vec<Vec<u8>>; KEYS.len()],
}

const SAVE: u32 = u32::from_le_bytes(*b"save");
const LOAD: u32 = u32::from_le_bytes(*b"load");

impl Stored {
    /// Each record but the factory's was stored more than once.
    fn with_history() -> Self {
        let (mut rig, valve) = BusRig::booted();
        let mut stored = Self { flash: Flash::new(), versions: Default::default() };
        stored.note(&rig, valve);
        let node_id = 0x20;
        assert!(rig.write(node_id, (0x1011, 1, 4, LOAD)));
        stored.note(&rig, valve);
        rig.world.power(valve, false);
        rig.boot(valve);
        stored.note(&rig, valve);
        for type_ in [11, 22] {
            assert!(rig.write(node_id, (0x1800, 2, 1, type_)));
            assert!(rig.write(node_id, (0x1010, 1, 4, SAVE)));
            stored.note(&rig, valve);
        }
        for internal_fault in [true, false, true, false] {
            rig.sense(valve, |inputs| inputs.internal_fault = internal_fault);
            rig.run_for(11_000);
            stored.note(&rig, valve);
        }
        rig.take();
        rig.send("7E5: 04 01 00 00 00 00 00 00");
        rig.exchange("7E5: 11 21 00 00 00 00 00 00", "7E4: 11 00 00 00 00 00 00 00");
        rig.exchange("7E5: 17 00 00 00 00 00 00 00", "7E4: 17 00 00 00 00 00 00 00");
        stored.note(&rig, valve);
        let counts = stored.versions.each_ref().map(Vec::len);
        assert_eq!(counts, [1, 2, 3, 2, 2]);
        stored
    }

    /// The same, and the flash holds the newest of each record only.
    fn newest_only(&self) -> Self {
        let mut memory = Memory::in_ram();
        for (key, versions) in KEYS.into_iter().zip(&self.versions) {
            memory.store(key, &seal(VERSION, versions.last().unwrap()).unwrap()).unwrap();
        }
        let versions = self.versions.each_ref().map(|versions| vec![versions.last().unwrap().clone()]);
        Self { flash: memory.flash().clone(), versions }
    }

    fn note(&mut self, rig: &BusRig, valve: NodeId) {
        self.flash = rig.world.memory(valve).flash().clone();
        let image = Memory::with_flash(self.flash.clone()).read_image();
        for (key, versions) in KEYS.into_iter().zip(&mut self.versions) {
            if let Some(payload) = image.payload(key, VERSION).unwrap()
                && versions.last().is_none_or(|last| last != payload)
            {
                versions.push(payload.to_vec());
            }
        }
    }

    /// Reads the flash after something was done to it: no record is wrong.
    #[track_caller]
    fn read(&self, rotten: &Flash, what: &str) -> Image {
        let image = Memory::with_flash(rotten.clone()).read_image();
        for (key, versions) in KEYS.into_iter().zip(&self.versions) {
            match image.payload(key, VERSION) {
                Ok(Some(payload)) => assert!(versions.iter().any(|version| version == payload), "{key:?}, {what}"),
                Ok(None) => assert!(image.is_damaged(), "{key:?} is lost and nobody knows, {what}"),
                Err(_) => {}
            }
        }
        image
    }

    /// Turns bits over, each for itself. The images that came of it, each once and with a flash that gives it.
    fn turn_over(&self, bits: impl Iterator<Item = usize>) -> Vec<(Image, Flash)> {
        let mut images: Vec<(Image, Flash)> = Vec::new();
        for bit in bits {
            let mut rotten = self.flash.clone();
            rotten.flip_bit(bit);
            let image = self.read(&rotten, &format!("bit {bit}"));
            assert!(!image.is_damaged(), "one bit is not the whole memory: {bit}");
            if !images.iter().any(|(known, _)| *known == image) {
                images.push((image, rotten));
            }
        }
        images
    }

    /// The bits of all words that are written.
    fn bits_in_use(&self) -> impl Iterator<Item = usize> {
        let image = self.flash.image();
        let words = image.chunks_exact(WORD).enumerate().filter(|(_, word)| *word != [0xFF; WORD]);
        words.flat_map(|(at, _)| at * WORD * 8..(at + 1) * WORD * 8).collect::<Vec<_>>().into_iter()
    }
}

fn lost(image: &Image) -> Vec<RecordKey> {
    KEYS.into_iter().filter(|key| image.payload(*key, VERSION).is_err()).collect()
}

/// The valve boots, with this EMCY for what is lost.
fn boot(flash: &Flash, image: &Image) -> (BusRig, NodeId, u16) {
    let (mut rig, valve) = BusRig::with_flash(flash.clone());
    let frames = rig.boot(valve);
    let node_id = match image.payload(RecordKey::LocalLayer, VERSION) {
        Ok(Some(layer)) => u16::from(layer[0]),
        _ => 0x20,
    };
    let mut expected =
        vec![format!("{:03X}: 00", 0x700 + node_id), format!("{:03X}:{}", 0x080 + node_id, " 00".repeat(8))];
    if !lost(image).is_empty() {
        // The internal error is the third fault; the log may be what was lost.
        let before = image.payload(RecordKey::FaultLog, VERSION).ok().flatten().map_or(0, |log| log[2]);
        expected.push(format!("{:03X}: 00 10 01 {:02X} 00 00 00 00", 0x080 + node_id, before + 1));
    }
    assert_eq!(frames, expected, "lost: {:?}", lost(image));
    let red = rig.outputs(valve).led.color == Color::Red;
    assert_eq!(red, !lost(image).is_empty());
    (rig, valve, node_id)
}

#[test]
fn a_flipped_bit_in_any_record_with_an_older_one_behind_it() {
    let stored = Stored::with_history();
    let images = stored.turn_over(stored.bits_in_use());
    // The newest of everything; the factory record lost; of each other the one before.
    assert_eq!(images.len(), 1 + KEYS.len(), "{images:?}");
    for (image, flash) in &images {
        assert!(lost(image).iter().all(|key| *key == RecordKey::Factory));
        boot(flash, image);
    }
}

#[test]
fn a_flipped_bit_in_the_only_version_of_a_record_is_told() {
    let stored = Stored::with_history().newest_only();
    let images = stored.turn_over(stored.bits_in_use());
    let mut all_lost: Vec<_> = images.iter().map(|(image, _)| lost(image)).collect();
    all_lost.sort();
    let mut expected = vec![vec![]];
    expected.extend(KEYS.map(|key| vec![key]));
    assert_eq!(all_lost, expected, "one at a time, and each");
    for (image, flash) in &images {
        let (mut rig, _, node_id) = boot(flash, image);
        let node_id = u8::try_from(node_id).unwrap();
        // What is not lost is as it was, what is lost has its default.
        let lost = lost(image);
        let saved = if lost == [RecordKey::Parameters] { 0xFF } else { 22 };
        assert_eq!(rig.read(node_id, 0x1800, 2), Some(saved));
        assert_eq!(rig.read(node_id, 0x1018, 4), Some(0x5B2E_0100));
        let count = if lost == [RecordKey::FaultLog] { 1 } else { 2 + u32::from(!lost.is_empty()) };
        assert_eq!(rig.read(node_id, 0x2024, 0), Some(count));
        // A fault of the memory lasts until that record is written again: "save" is one, the log writes itself.
        assert_eq!(rig.read(node_id, 0x1001, 0), Some(u32::from(!lost.is_empty())));
        rig.send(&format!("{:03X}: 23 10 10 01 73 61 76 65", 0x600 + u16::from(node_id)));
        rig.run_for(1000);
        let over = lost == [RecordKey::Parameters] || lost == [RecordKey::FaultLog];
        let cleared = format!("{:03X}:{}", 0x080 + u16::from(node_id), " 00".repeat(8));
        assert_eq!(rig.take().contains(&cleared), over, "{lost:?}");
        let lasts = u32::from(!lost.is_empty() && !over);
        assert_eq!(rig.read(node_id, 0x1001, 0), Some(lasts), "{lost:?}");
    }
}

#[test]
fn a_flipped_bit_in_what_is_not_written() {
    let stored = Stored::with_history();
    let in_use: std::collections::BTreeSet<usize> = stored.bits_in_use().collect();
    // All of the words that come next, and some of all others.
    let end = in_use.iter().rev().find(|bit| **bit < SIZE * 4).unwrap() + 1;
    let bits = (end..end + 20 * WORD * 8).chain((0..SIZE * 8).step_by(331)).filter(|bit| !in_use.contains(bit));
    for bit in bits {
        let mut rotten = stored.flash.clone();
        rotten.flip_bit(bit);
        let image = stored.read(&rotten, &format!("bit {bit}"));
        assert!(!image.is_damaged() && lost(&image).is_empty(), "bit {bit}");
        // A record is stored in spite of it, in its way or not.
        let mut memory = Memory::with_flash(rotten);
        memory.store(RecordKey::Parameters, &seal(VERSION, &[bit as u8; 90]).unwrap()).unwrap();
        let image = memory.read_image();
        assert_eq!(image.payload(RecordKey::Parameters, VERSION), Ok(Some(&[bit as u8; 90][..])), "bit {bit}");
        assert!(lost(&image).is_empty());
    }
}

#[test]
fn whole_words_gone_wrong_never_give_a_wrong_value() {
    let stored = Stored::with_history();
    let bits: Vec<usize> = stored.bits_in_use().collect();
    for seed in 0..400 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut rotten = stored.flash.clone();
        for _ in 0..random.usize(1..=6) {
            let word = bits[random.usize(..bits.len())] / 32 * 32;
            for bit in 0..32 {
                if random.bool() {
                    rotten.flip_bit(word + bit);
                }
            }
        }
        let (mut rig, valve) = BusRig::with_flash(rotten.clone());
        let image = Memory::with_flash(rotten).read_image();
        for (key, versions) in KEYS.into_iter().zip(&stored.versions) {
            if let Ok(Some(payload)) = image.payload(key, VERSION) {
                assert!(versions.iter().any(|version| version == payload), "{key:?}, seed {seed}");
            }
        }
        let frames = rig.boot(valve);
        assert!(frames.len() >= 2 && rig.world.is_powered(valve), "seed {seed}: {frames:?}");
    }
}
