//! State files: kept, refused, and put aside.

use std::fs;
use std::path::{Path, PathBuf};

use protocol_core::memory::{Image, Record, RecordKey, StoreError, seal};
use tempfile::TempDir;

use hal_sim::Memory;
use hal_sim::memory::{Flash, SIZE};

use super::{MemoryFileError, StateFile};

const KIND: u32 = 1;
const OTHER_KIND: u32 = 6;
const HEADER: usize = 16;

fn record(payload: &[u8]) -> Record {
    seal(1, payload).unwrap()
}

fn directory() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn in_file(dir: &Path, name: &str, kind: u32) -> Result<Memory, MemoryFileError> {
    StateFile::open(dir, name, kind)?.memory()
}

fn open(dir: &TempDir) -> Memory {
    in_file(dir.path(), "valve", KIND).unwrap()
}

fn parameters(image: &Image) -> Option<&[u8]> {
    image.payload(RecordKey::Parameters, 1).unwrap()
}

fn path(dir: &TempDir) -> PathBuf {
    dir.path().join("valve.nvm")
}

/// Returns the names in the directory, except for the locks.
fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| !name.ends_with(".lock"));
    names.sort();
    names
}

#[test]
fn what_was_stored_is_there_the_next_time() {
    let dir = directory();
    let mut memory = open(&dir);
    assert!(memory.read_image().is_new());
    memory.store(RecordKey::Parameters, &record(b"kept")).unwrap();
    drop(memory);
    let mut memory = open(&dir);
    assert_eq!(parameters(&memory.read_image()), Some(&b"kept"[..]));
    assert_eq!(memory.take_warnings(), [""; 0]);
    assert_eq!(names(dir.path()), ["valve.nvm"]);
}

#[test]
fn the_clone_of_a_memory_leaves_the_file_to_the_original() {
    let dir = directory();
    let mut memory = open(&dir);
    memory.store(RecordKey::Parameters, &record(b"kept")).unwrap();
    let mut clone = memory.clone();
    assert_eq!(parameters(&clone.read_image()), Some(&b"kept"[..]));
    clone.store(RecordKey::Parameters, &record(b"in RAM")).unwrap();
    assert_eq!(parameters(&clone.read_image()), Some(&b"in RAM"[..]));
    drop(memory);
    // The file is unlocked and unchanged since the original, although the clone exists.
    assert_eq!(parameters(&open(&dir).read_image()), Some(&b"kept"[..]));
}

#[test]
fn the_file_is_a_header_and_the_flash() {
    let dir = directory();
    let mut memory = open(&dir);
    memory.store(RecordKey::Parameters, &record(b"kept")).unwrap();
    let bytes = fs::read(path(&dir)).unwrap();
    assert_eq!(bytes.len(), HEADER + SIZE);
    assert_eq!(bytes[..HEADER], *b"PNVM\x01\0\0\0\x01\x01\0\0\0\x80\0\0");
    assert!(bytes[HEADER..] == *memory.flash().image());
}

/// Earlier programs treat the layout version as a part of the kind, and refuse the file unchanged.
#[test]
fn a_file_of_a_later_program_is_refused_and_left_alone() {
    let dir = directory();
    open(&dir).store(RecordKey::Parameters, &record(b"kept")).unwrap();
    let mut bytes = fs::read(path(&dir)).unwrap();
    bytes[9] += 1;
    fs::write(path(&dir), &bytes).unwrap();
    let error = in_file(dir.path(), "valve", KIND).unwrap_err();
    assert_eq!(error.to_string(), format!("{}: written by a newer pve-sim", path(&dir).display()));
    assert!(fs::read(path(&dir)).unwrap() == bytes);
}

#[test]
fn a_directory_that_is_not_there_is_made() {
    let dir = directory();
    let deep = dir.path().join("a/b");
    in_file(&deep, "valve", KIND).unwrap();
    assert_eq!(names(&deep), ["valve.nvm"]);
}

#[test]
fn a_file_of_another_kind_is_refused_and_left_alone() {
    let dir = directory();
    open(&dir).store(RecordKey::Parameters, &record(b"kept")).unwrap();
    let before = fs::read(path(&dir)).unwrap();
    let error = in_file(dir.path(), "valve", OTHER_KIND).unwrap_err();
    let line = error.to_string();
    assert!(line.contains("valve.nvm") && line.contains("of a pvea-canopen, not of a hat3000"), "{line}");
    assert!(fs::read(path(&dir)).unwrap() == before);
    assert_eq!(names(dir.path()), ["valve.nvm"]);
}

#[test]
fn a_damaged_header_is_put_aside() {
    let good = {
        let dir = directory();
        open(&dir).store(RecordKey::Parameters, &record(b"kept")).unwrap();
        fs::read(path(&dir)).unwrap()
    };
    let with = |at: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[at] = byte;
        bytes
    };
    let damaged = [
        Vec::new(),
        good[..HEADER - 1].to_vec(),
        good[..HEADER].to_vec(),
        good[..good.len() - 1].to_vec(),
        [&good[..], &[0]].concat(),
        with(0, b'p'),
        with(4, 2),
        with(13, 0x40),
        b"not a state file".to_vec(),
    ];
    for bytes in damaged {
        let dir = directory();
        fs::write(path(&dir), &bytes).unwrap();
        let mut memory = open(&dir);
        let warnings = memory.take_warnings();
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].contains("valve.nvm.bad") && !warnings[0].contains('\n'), "{}", warnings[0]);
        assert!(fs::read(dir.path().join("valve.nvm.bad")).unwrap() == bytes, "kept as it was");
        assert!(memory.read_image().is_damaged());
        assert!(!memory.read_image().is_damaged(), "told once");
        memory.store(RecordKey::Parameters, &record(b"new")).unwrap();
        drop(memory);
        assert_eq!(parameters(&open(&dir).read_image()), Some(&b"new"[..]));
    }
}

#[test]
fn a_map_that_cannot_be_read_is_put_aside() {
    for seed in 0..10 {
        let dir = directory();
        drop(open(&dir));
        let mut bytes = fs::read(path(&dir)).unwrap();
        let mut noise = fastrand::Rng::with_seed(seed);
        bytes[HEADER..].fill_with(|| noise.u8(..));
        fs::write(path(&dir), &bytes).unwrap();
        let mut memory = open(&dir);
        assert_eq!(memory.take_warnings().len(), 1);
        assert!(memory.read_image().is_damaged());
        assert!(fs::read(dir.path().join("valve.nvm.bad")).unwrap() == bytes);
    }
}

#[test]
fn nothing_that_was_put_aside_is_overwritten() {
    let dir = directory();
    for content in ["first", "second", "third"] {
        fs::write(path(&dir), content).unwrap();
        drop(open(&dir));
    }
    assert_eq!(names(dir.path()), ["valve.nvm", "valve.nvm.bad", "valve.nvm.bad.2", "valve.nvm.bad.3"]);
    let kept = ["valve.nvm.bad", "valve.nvm.bad.2", "valve.nvm.bad.3"];
    assert_eq!(kept.map(|name| fs::read_to_string(dir.path().join(name)).unwrap()), ["first", "second", "third"]);
}

#[test]
fn damage_while_running_is_put_aside_at_the_next_start() {
    let dir = directory();
    let mut memory = open(&dir);
    memory.flash_mut().fill(|cell| cell as u8);
    let damaged = memory.flash().image();
    assert!(memory.read_image().is_damaged());
    assert_eq!(memory.take_warnings().len(), 1);
    assert!(fs::read(dir.path().join("valve.nvm.bad")).unwrap()[HEADER..] == damaged);
    drop(memory);
    assert!(open(&dir).read_image().is_new());
}

#[test]
fn a_cut_write_is_cut_in_the_file_too() {
    let dir = directory();
    let mut memory = open(&dir);
    memory.store(RecordKey::Parameters, &record(b"old")).unwrap();
    memory.store_cut(RecordKey::Parameters, &record(b"new"), 1, 2);
    assert!(fs::read(path(&dir)).unwrap()[HEADER..] == *memory.flash().image());
    drop(memory);
    let mut memory = open(&dir);
    assert_eq!(parameters(&memory.read_image()), Some(&b"old"[..]));
    assert_eq!(memory.take_warnings(), [""; 0]);
}

/// Other files in the folder are neither read nor written.
#[cfg(unix)]
#[test]
fn other_names_in_the_folder_are_left_alone() {
    let (dir, elsewhere) = (directory(), directory());
    open(&dir).store(RecordKey::Parameters, &record(b"kept")).unwrap();
    let victim = elsewhere.path().join("victim");
    fs::write(&victim, "of somebody else").unwrap();
    let others = ["valve.nvm.new", "valve.nvm.tmp", ".valve.nvm"];
    for name in others {
        std::os::unix::fs::symlink(&victim, dir.path().join(name)).unwrap();
    }
    let mut memory = open(&dir);
    assert_eq!(parameters(&memory.read_image()), Some(&b"kept"[..]));
    memory.store(RecordKey::Parameters, &record(b"later")).unwrap();
    assert_eq!(fs::read_to_string(&victim).unwrap(), "of somebody else");
    assert_eq!(names(dir.path()), [".valve.nvm", "valve.nvm", "valve.nvm.new", "valve.nvm.tmp"]);
}

/// A process killed during a write leaves an unfinished file, each with another name.
#[test]
fn what_a_killed_process_left_unfinished_is_removed() {
    let dir = directory();
    for name in [".valve.nvm.zgllq4", ".valve.nvm.HUQWBg"] {
        fs::write(dir.path().join(name), "PNVM").unwrap();
    }
    let kept = [".other.nvm.zgllq4", ".valve.nvm.2026-11", ".valve.nvm.backup", "valve.nvm.zgllq4"];
    for name in kept {
        fs::write(dir.path().join(name), "of somebody").unwrap();
    }
    // A memory that is only opened changes nothing.
    let taken = StateFile::open(dir.path(), "valve", KIND).unwrap();
    assert_eq!(names(dir.path()).len(), 6);
    drop(taken.memory().unwrap());
    assert_eq!(names(dir.path()), [&kept[..3], &["valve.nvm", kept[3]]].concat());
}

/// A name of small letters alone would stay, as `.valve.nvm.backup` does.
#[test]
fn every_unfinished_file_is_removed_at_the_next_start() {
    let dir = directory();
    let opened = StateFile::open(dir.path(), "valve", KIND).unwrap();
    // Of random names of six letters and digits, one in some 200 has small letters alone.
    for _ in 0..2000 {
        opened.file.unfinished(dir.path()).unwrap().keep().unwrap();
    }
    drop(opened.memory().unwrap());
    assert_eq!(names(dir.path()), ["valve.nvm"]);
}

#[test]
fn a_file_that_cannot_be_read_or_written_is_named() {
    let dir = directory();
    // A directory in the file's place cannot be read as a file, even by root.
    fs::create_dir(path(&dir)).unwrap();
    let error = in_file(dir.path(), "valve", KIND).unwrap_err();
    assert!(error.to_string().contains("valve.nvm: cannot read: "), "{error}");
    assert_eq!(names(dir.path()), ["valve.nvm"]);

    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    let error = in_file(&file, "valve", KIND).unwrap_err();
    assert!(error.to_string().contains("file"), "{error}");
}

#[test]
fn a_store_that_the_file_does_not_take_has_failed() {
    let dir = directory();
    let mut memory = open(&dir);
    memory.store(RecordKey::Parameters, &record(b"old")).unwrap();
    fs::remove_file(path(&dir)).unwrap();
    fs::create_dir(path(&dir)).unwrap();
    assert_eq!(memory.store(RecordKey::Parameters, &record(b"new")), Err(StoreError));
    let warnings = memory.take_warnings();
    assert!(warnings.len() == 1 && warnings[0].contains("cannot write"), "{warnings:?}");
    assert_eq!(names(dir.path()), ["valve.nvm"], "no unfinished file stays");
}

/// Each write replaces the file, but keeps its permissions.
#[cfg(unix)]
#[test]
fn permissions_of_the_file_are_kept() {
    use std::os::unix::fs::PermissionsExt as _;
    let dir = directory();
    let mut memory = open(&dir);
    let mode = |mode| fs::Permissions::from_mode(mode);
    let told = |dir: &TempDir| fs::metadata(path(dir)).unwrap().permissions().mode() & 0o777;
    fs::write(dir.path().join("plain"), "").unwrap();
    let plain = fs::metadata(dir.path().join("plain")).unwrap().permissions().mode() & 0o777;
    assert_eq!(told(&dir), plain, "a new file is like any other of its user");
    fs::set_permissions(path(&dir), mode(0o664)).unwrap();
    memory.store(RecordKey::Parameters, &record(b"next")).unwrap();
    assert_eq!(told(&dir), 0o664);
}

/// A failed store leaves nothing behind, in the running memory and in the file.
#[test]
fn a_store_that_has_failed_leaves_nothing_behind() {
    let dir = directory();
    let mut memory = open(&dir);
    memory.store(RecordKey::Parameters, &record(b"old")).unwrap();
    let (file, aside) = (path(&dir), dir.path().join("aside"));
    fs::rename(&file, &aside).unwrap();
    fs::create_dir(&file).unwrap();
    assert_eq!(memory.store(RecordKey::Parameters, &record(b"new")), Err(StoreError));
    fs::remove_dir(&file).unwrap();
    fs::rename(&aside, &file).unwrap();
    assert_eq!(parameters(&memory.read_image()), Some(b"old".as_slice()));
    memory.store(RecordKey::LocalLayer, &record(b"next")).unwrap();
    drop(memory);
    assert_eq!(parameters(&open(&dir).read_image()), Some(b"old".as_slice()));
}

#[test]
fn a_file_is_taken_by_one_at_a_time() {
    let dir = directory();
    // Also before the file exists.
    let mut memory = open(&dir);
    for stored in [b"first", b"other"] {
        let error = in_file(dir.path(), "valve", KIND).unwrap_err();
        let line = error.to_string();
        assert!(line.contains("valve.nvm is in use by another pve-sim"), "{line}");
        // Each write creates a new file.
        memory.store(RecordKey::Parameters, &record(stored)).unwrap();
    }
    in_file(dir.path(), "lever", KIND).unwrap();
    drop(memory);
    assert_eq!(parameters(&open(&dir).read_image()), Some(&b"other"[..]));
}

/// A simulator whose lock file was removed does not overwrite the file of the next simulator.
#[cfg(unix)]
#[test]
fn a_file_without_its_lock_is_left_to_the_next() {
    for is_folder_removed in [true, false] {
        let dir = directory();
        let mut first = open(&dir);
        first.store(RecordKey::Parameters, &record(b"first")).unwrap();
        if is_folder_removed {
            fs::remove_dir_all(dir.path()).unwrap();
        } else {
            fs::remove_file(dir.path().join("valve.nvm.lock")).unwrap();
        }
        let mut second = open(&dir);
        second.store(RecordKey::Parameters, &record(b"second")).unwrap();
        assert_eq!(first.store(RecordKey::Parameters, &record(b"other")), Err(StoreError));
        let warnings = first.take_warnings();
        assert!(warnings.len() == 1 && warnings[0].contains("cannot write: the lock file was removed"), "{warnings:?}");
        assert_eq!(names(dir.path()), ["valve.nvm"], "no unfinished file stays");
        drop((first, second));
        assert_eq!(parameters(&open(&dir).read_image()), Some(&b"second"[..]));
    }
}

#[cfg(unix)]
#[test]
fn a_link_is_followed_and_kept() {
    let (dir, elsewhere) = (directory(), directory());
    let target = elsewhere.path().join("memory");
    std::os::unix::fs::symlink(&target, path(&dir)).unwrap();
    // Its target may be on a disk that is not mounted at the moment.
    let error = in_file(dir.path(), "valve", KIND).unwrap_err();
    assert!(error.to_string().contains("valve.nvm: cannot resolve the link"), "{error}");
    assert!(!target.exists());

    fs::write(&target, "noise").unwrap();
    let mut memory = open(&dir);
    memory.store(RecordKey::Parameters, &record(b"kept")).unwrap();
    assert!(in_file(elsewhere.path(), "memory", KIND).is_ok(), "another file");
    drop(memory);
    assert!(path(&dir).is_symlink());
    assert_eq!(fs::read_to_string(elsewhere.path().join("memory.bad")).unwrap(), "noise");
    assert_eq!(parameters(&open(&dir).read_image()), Some(&b"kept"[..]));
}

#[cfg(unix)]
#[test]
fn what_is_no_file_is_not_read() {
    for target in ["/dev/zero", "/dev/null", "/"] {
        let dir = directory();
        std::os::unix::fs::symlink(target, path(&dir)).unwrap();
        let error = in_file(dir.path(), "valve", KIND).unwrap_err();
        assert_eq!(error.to_string(), format!("{target}: cannot read: not a file"));
        assert!(path(&dir).is_symlink());
    }
}

#[test]
fn a_flash_image_has_the_size_of_the_flash() {
    assert!(Flash::from_image(vec![0; SIZE]).is_some());
    assert!(Flash::from_image(vec![0; SIZE - 1]).is_none());
}
