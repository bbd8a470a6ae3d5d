//! State files that something has happened to.

use super::written;

/// Where the flash begins in a file, and the bytes of its two sectors.
pub(crate) const HEADER: usize = 16;
const SECTOR: usize = 16 * 1024;
const ERASED: u8 = 0xFF;
/// How far one flipped bit is from the next.
const STRIDE: usize = 37;

/// Files, each with what happened to it.
type Files = Vec<(String, Vec<u8>)>;

/// A copy with a change.
fn changed(good: &[u8], change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut bytes = good.to_vec();
    change(&mut bytes);
    bytes
}

/// Returns how far a file is written.
fn used(bytes: &[u8]) -> usize {
    bytes.iter().rposition(|byte| *byte != ERASED).expect("something is stored") + 1
}

/// Files that are none of this kind, or not whole.
pub(crate) fn of_the_file(kind: &str, other: &str) -> Files {
    let good = written(kind, "set");
    let mut files = Files::new();
    let mut add = |name: &str, content: Vec<u8>| files.push((name.to_owned(), content));
    add("nothing was ever stored", [&good[..HEADER], &[ERASED; 2 * SECTOR][..]].concat());
    add(&format!("that of a {other}"), written(other, "set"));
    add("empty", Vec::new());
    add("text", b"not a state file\n".to_vec());
    for (at, name) in [(0, "magic"), (4, "version"), (8, "kind"), (9, "layout"), (12, "size")] {
        add(&format!("header: {name}"), changed(&good, |bytes| bytes[at] ^= 0x40));
    }
    for length in [HEADER - 1, HEADER, used(&good), HEADER + SECTOR, good.len() - 1] {
        add(&format!("cut to {length} bytes"), good[..length].to_vec());
    }
    add("one byte more", [&good[..], &[0]].concat());
    let mut noise = Noise(1);
    add("noise in the place of the flash", changed(&good, |bytes| bytes[HEADER..].fill_with(|| noise.next())));
    files
}

/// Whole files of this kind, in whose flash something is otherwise than it was written.
pub(crate) fn of_the_flash(kind: &str) -> Files {
    let good = written(kind, "set");
    let used = used(&good);
    let mut files = Files::new();
    let mut add = |name: &str, content: Vec<u8>| files.push((name.to_owned(), content));
    let changed = |change: &dyn Fn(&mut [u8])| changed(&good, change);

    for at in (HEADER..used).step_by(STRIDE).chain([HEADER, used, HEADER + SECTOR - 1, HEADER + SECTOR]) {
        add(&format!("bit {} of {at} flipped", at % 8), changed(&|bytes| bytes[at] ^= 1 << (at % 8)));
    }
    for words in 1..=4 {
        let cut = used - 4 * words;
        add(&format!("the last {words} words not written"), changed(&|bytes| bytes[cut..used].fill(ERASED)));
        add(
            &format!("word {cut} half written"),
            changed(&|bytes| {
                bytes[cut + 4..used].fill(ERASED);
                bytes[cut..cut + 4].iter_mut().for_each(|byte| *byte |= 0x5A);
            }),
        );
    }
    let mut noise = Noise(1);
    let first = HEADER..HEADER + SECTOR;
    let second = HEADER + SECTOR..HEADER + 2 * SECTOR;
    let both = HEADER..HEADER + 2 * SECTOR;
    for (name, range) in [("first sector", first.clone()), ("second sector", second.clone()), ("both sectors", both)] {
        for (what, byte) in [("all 00", 0), ("all A5", 0xA5), ("erased", ERASED)] {
            add(&format!("{name} {what}"), changed(&|bytes| bytes[range.clone()].fill(byte)));
        }
        let mut bytes = good.clone();
        bytes[range].fill_with(|| noise.next());
        add(&format!("{name} noise"), bytes);
    }
    for (name, range) in
        [("front", HEADER..HEADER + (used - HEADER) / 8 * 4), ("end", HEADER + (used - HEADER) / 8 * 4..used)]
    {
        add(&format!("the {name} of what is written erased"), changed(&|bytes| bytes[range.clone()].fill(ERASED)));
    }
    add(
        "the sectors changed places",
        changed(&|bytes| {
            let (front, back) = bytes[HEADER..].split_at_mut(SECTOR);
            front.swap_with_slice(back);
        }),
    );

    // The erase of the sector that was left, cut.
    let full = written(kind, "full");
    for (name, range) in [("first", first), ("second", second)] {
        let mut bytes = full.clone();
        let middle = range.start + SECTOR / 2;
        bytes[range.start..middle].fill(ERASED);
        add(&format!("full, {name} sector half erased"), bytes.clone());
        bytes[middle..middle + 4].fill(0x3C);
        add(&format!("full, {name} sector half erased, then a word of anything"), bytes);
        let mut bytes = full.clone();
        bytes[range].iter_mut().for_each(|byte| *byte |= noise.next() & noise.next());
        add(&format!("full, {name} sector faded"), bytes);
    }
    files
}

/// Bytes of anything, the same each time (xorshift).
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> u8 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        (self.0 >> 24) as u8
    }
}
