//! A device on a memory with any content, whose power is cut at any of its writes.

use std::array;
use std::collections::BTreeMap;
use std::sync::OnceLock;

use hal_sim::memory::{ERASED, Flash, SECTOR, SIZE, TornErase, WORD};
use hal_sim::{BitRate, Duration, Kind, Memory, Setup};
use protocol_core::memory::{Image, RecordKey, seal};

use super::bytes::Bytes;
use super::rig::Rig;
use super::{STEPS_MAX, kind, ledger, rules, steps};

/// The version of the records of all devices.
const VERSION: u8 = 1;

/// The number of words left in a nearly full sector. A few records take more.
const WORDS_LEFT: usize = 150;

/// The maximum number of records that are stored there later.
const RECORDS_LATER: usize = 16;

/// The maximum number of patches of a content.
const PATCHES_MAX: u8 = 32;

/// Attacks a device on a memory of any content.
pub fn flash(bytes: &[u8]) {
    let mut bytes = Bytes(bytes);
    let kind = kind(bytes.u8());
    let flash = content(&mut bytes, kind);
    let mut rig = Rig::new(BitRate::Kbit250);
    rig.add(Setup { bit_rate: Some(BitRate::Kbit250), ..Setup::new(kind) }, Memory::with_flash(flash), false);
    rig.power_on(0);
    rig.follow_bit_rate(0);
    let ending = bytes.u8();
    for _ in 0..STEPS_MAX {
        if bytes.is_empty() {
            break;
        }
        steps::act(&mut rig, &mut bytes);
    }
    rules::last_word(&mut rig, 0, ending.into());
}

/// Returns a well-formed content with patches.
fn content(bytes: &mut Bytes<'_>, kind: Kind) -> Flash {
    let [what, patches, torn_erase, noise] = bytes.array();
    let mut flash = match what % 4 {
        0 => Flash::new(),
        1 => made(kind).used.clone(),
        2 => made(kind).nearly_full[usize::from(what >> 2) % RECORDS_LATER].clone(),
        _ => any_records(bytes),
    };
    let mut image = flash.image();
    for _ in 0..patches % PATCHES_MAX {
        patch(&mut image, bytes);
    }
    let damaged = Flash::from_image(image).expect("of its size");
    assert_told(flash, &damaged);
    flash = damaged;
    flash.set_torn_erase(TornErase::ALL[usize::from(torn_erase) % TornErase::ALL.len()]);
    flash.seed_noise(noise.into());
    if let Some(operations) = torn_erase.checked_sub(0x80) {
        flash.cut_power_after(operations.into());
    }
    flash
}

/// Asserts that a flipped bit loses no record without a report.
fn assert_told(intact: Flash, damaged: &Flash) {
    let flipped: u32 = intact.image().iter().zip(damaged.image()).map(|(is, was)| (is ^ was).count_ones()).sum();
    let [before, after] = [intact, damaged.clone()].map(|flash| Memory::with_flash(flash).peek_image());
    if flipped > 1 || after.is_damaged() {
        return;
    }
    for key in RecordKey::ALL {
        let is_there = |image: &Image| !matches!(image.payload(key, VERSION), Ok(None));
        assert!(is_there(&after) || !is_there(&before), "{key:?} is lost, and nobody knows");
    }
}

/// Damages the content somewhere.
fn patch(image: &mut [u8], bytes: &mut Bytes<'_>) {
    let at = usize::from(bytes.u16()) % SIZE;
    let what = bytes.u8();
    let len = usize::from(what >> 3) * WORD;
    let range = at..(at + len.max(1)).min(SIZE);
    match what & 7 {
        0 => image[at] ^= 1 << (what >> 3 & 7),
        1 => image[range].fill(0),
        2 => image[range].fill(ERASED),
        3 => image[range].fill(bytes.u8()),
        4 => image[range].iter_mut().for_each(|cell| *cell = bytes.u8()),
        5 => image[at / SECTOR * SECTOR..][..SECTOR].fill(ERASED),
        6 => {
            let (front, back) = image.split_at_mut(SECTOR);
            front.swap_with_slice(back);
        }
        _ => {
            let mut noise = fastrand::Rng::with_seed(at as u64);
            image[at / SECTOR * SECTOR..][..SECTOR].iter_mut().for_each(|cell| *cell = noise.u8(..));
        }
    }
}

/// Returns records with any content, each intact or with a wrong checksum. A record with a wrong checksum or another
/// version must not be read. Parameters are left out: their values are checked when a client writes them, and an intact
/// record is trusted.
fn any_records(bytes: &mut Bytes<'_>) -> Flash {
    let mut memory = Memory::in_ram();
    let mut stored = BTreeMap::new();
    for _ in 0..bytes.u8() % 8 {
        let key =
            bytes.one_of(&[RecordKey::Factory, RecordKey::LocalLayer, RecordKey::RestoreFlag, RecordKey::FaultLog]);
        let [how, len] = bytes.array();
        let payload: Vec<u8> = (0..len % 128).map(|_| bytes.u8()).collect();
        let version = if how & 0x80 == 0 { VERSION } else { how };
        let Ok(mut record) = seal(version, &payload) else { continue };
        let is_intact = how & 0xC0 != 0x40;
        if let Some(checksum) = record.last_mut().filter(|_| !is_intact) {
            *checksum ^= 1;
        }
        memory.store(key, &record).expect("a healthy flash");
        stored.insert(key, (is_intact && version == VERSION).then_some(payload));
    }
    let image = memory.peek_image();
    for (key, payload) in stored {
        assert_eq!(image.payload(key, VERSION).ok().flatten(), payload.as_deref(), "{key:?}");
    }
    memory.flash().clone()
}

/// The contents of the memories of each kind, which are created once.
struct Made {
    /// The memory of a device whose clients have stored everything, some of it twice.
    used: Flash,
    /// The same memory in a nearly full sector, after more and more records.
    nearly_full: [Flash; RECORDS_LATER],
}

fn made(kind: Kind) -> &'static Made {
    static MADE: [OnceLock<Made>; Kind::ALL.len()] = [const { OnceLock::new() }; Kind::ALL.len()];
    let number = Kind::ALL.iter().position(|other| *other == kind).expect("a kind");
    MADE[number].get_or_init(|| {
        let used = use_up(kind);
        Made { nearly_full: fill(&used), used }
    })
}

fn use_up(kind: Kind) -> Flash {
    let mut rig = Rig::new(BitRate::Kbit250);
    rig.add(Setup { bit_rate: Some(BitRate::Kbit250), ..Setup::new(kind) }, Memory::in_ram(), true);
    rig.power_on(0);
    for internal_fault in [true, false] {
        let node = rig.units[0].node;
        rig.world.set_plant(node, hal_sim::Change::InternalFault(internal_fault)).expect("a word of all products");
        ledger::save(&mut rig, 0);
        ledger::write_by_uds(&mut rig, 0, 0x83);
        ledger::store_by_lss(&mut rig, 0, 0x21, Some(BitRate::Kbit250));
        rig.run(Duration::from_secs(12));
    }
    ledger::load(&mut rig, 0);
    rig.world.memory(rig.units[0].node).flash().clone()
}

/// Stores the local layer until the sector is nearly full, and then further records. Without a local layer there is
/// nothing to store.
fn fill(used: &Flash) -> [Flash; RECORDS_LATER] {
    let mut memory = Memory::with_flash(used.clone());
    let image = memory.read_image();
    let local_layer = image.payload(RecordKey::LocalLayer, VERSION).ok().flatten();
    let record = local_layer.map(|payload| seal(VERSION, payload).expect("a record"));
    let store = |memory: &mut Memory| {
        if let Some(record) = &record {
            memory.store(RecordKey::LocalLayer, record).expect("a healthy flash");
        }
    };
    while record.is_some() && memory.flash().words_in_use() < SECTOR / WORD - WORDS_LEFT {
        store(&mut memory);
    }
    array::from_fn(|_| {
        let flash = memory.flash().clone();
        store(&mut memory);
        flash
    })
}
