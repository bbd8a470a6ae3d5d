//! The state file of a memory: a header of 16 bytes and the raw flash image.
//!
//! Each write creates a complete new file under a unique name, syncs it, renames it over the old file and syncs the
//! folder (not on Windows). If the process is killed or the machine loses power, the file therefore has the complete
//! old or the complete new content; after a write has returned, the new one. Writing only the changed words could leave
//! a partial store that the *simulated* flash never had. The whole file is only 32 KiB, written a few times a second.
//!
//! Only one simulator may use the file, because a second simulator would overwrite the changes of the first. The lock
//! is on a separate file: each write replaces the state file, which may not even exist yet. The lock ends with the
//! process. The lock file stays, because removing it would let two other processes lock two different files. A write
//! fails if somebody else has removed it.

use std::ffi::OsString;
use std::fs::{self, DirEntry, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use tempfile::{Builder, NamedTempFile};

use hal_sim::memory::{Content, Flash, MemoryFile, MemoryFileError, SIZE};
use hal_sim::{Kind, Memory};

const MAGIC: [u8; 4] = *b"PNVM";
const VERSION: u32 = 1;
/// The version of the memory layout, stored above the kind number; the first programs wrote 0. A file with a later
/// layout is refused and left unchanged. The first programs also refuse layout 1, as a file of another kind.
const LAYOUT: u32 = 1;
/// The number of low bits that hold the kind; the remaining bits hold the layout version.
const KIND_BITS: u32 = 8;
const HEADER: usize = 16;
/// The number of letters and digits at the end of the name of an unfinished file; all but the last are random.
const UNFINISHED_SUFFIX: usize = 6;
/// The pauses between attempts to rename a file, in milliseconds: on Windows, a program that has the file open prevents
/// the rename.
const RENAME_PAUSES: [u64; if cfg!(windows) { 5 } else { 0 }] = [20; if cfg!(windows) { 5 } else { 0 }];

/// Returns the name of a kind in messages.
fn kind(number: u32) -> String {
    let kind = u8::try_from(number).ok().and_then(Kind::from_number);
    kind.map_or_else(|| "an unknown kind".to_owned(), |kind| format!("a {kind}"))
}

/// A locked state file with its content. No file has been changed yet.
#[derive(Debug)]
pub struct Opened {
    file: StateFile,
    content: Content,
}

impl Opened {
    /// Removes unfinished files, and returns the memory in the state file, or a new memory if the file does not exist.
    ///
    /// A damaged file is renamed to `name.nvm.bad` (or `.bad.2`, …), and the memory starts empty and marked as damaged.
    ///
    /// # Errors
    /// Fails if the file cannot be renamed or written. No content is lost.
    pub fn memory(self) -> Result<Memory, MemoryFileError> {
        self.file.sweep();
        Memory::kept_in(Box::new(self.file), self.content)
    }
}

/// The file that stores a memory. The file is locked until this value is dropped.
#[derive(Debug)]
pub struct StateFile {
    path: PathBuf,
    kind: u32,
    /// The locked file; `None` on a file system without locks.
    lock: Option<File>,
}

impl StateFile {
    /// Opens and reads `dir/name.nvm`, which may not exist yet, for a device of this kind. Creates a missing folder.
    ///
    /// # Errors
    /// When the file belongs to a device of another kind, comes from a newer program, is in use, or cannot be read.
    pub fn open(dir: &Path, name: &str, kind: u32) -> Result<Opened, MemoryFileError> {
        let mut file = Self { path: dir.join(format!("{name}.nvm")), kind, lock: None };
        fs::create_dir_all(dir).map_err(|error| file.error("create the directory", error))?;
        // A link is resolved, so that its target is replaced, and both names lock the same file.
        if file.path.is_symlink() {
            file.path = fs::canonicalize(&file.path).map_err(|error| file.error("resolve the link", error))?;
        }
        // Checked before opening, because opening a pipe would wait for a writer.
        if fs::metadata(&file.path).is_ok_and(|found| !found.is_file()) {
            return Err(file.error("read", io::Error::other("not a file")));
        }
        file.lock = file.lock()?;
        let content = match file.read() {
            Ok(bytes) => file.parse(bytes)?,
            Err(error) if error.kind() == ErrorKind::NotFound => Content::New,
            Err(error) => return Err(file.error("read", error)),
        };
        Ok(Opened { file, content })
    }

    fn lock(&self) -> Result<Option<File>, MemoryFileError> {
        let mut options = OpenOptions::new();
        options.write(true).create(true).truncate(false);
        // FILE_SHARE_READ and FILE_SHARE_WRITE: the locked file cannot be removed.
        #[cfg(windows)]
        std::os::windows::fs::OpenOptionsExt::share_mode(&mut options, 0x1 | 0x2);
        let lock = options.open(self.lock_path()).map_err(|error| self.error("lock", error))?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(lock)),
            Err(TryLockError::WouldBlock) => {
                Err(format!("{} is in use by another pve-sim", self.path.display()).into())
            }
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => Ok(None),
            Err(TryLockError::Error(error)) => Err(self.error("lock", error)),
        }
    }

    fn lock_path(&self) -> PathBuf {
        self.path.with_added_extension("lock")
    }

    /// Checks that the lock is still on the file at its path. If that file was removed, as with its folder, another
    /// simulator can lock a new one.
    fn check_lock(&self) -> io::Result<()> {
        let Some(lock) = &self.lock else { return Ok(()) };
        let (locked, present) = (lock.metadata()?, fs::metadata(self.lock_path()));
        match present.is_ok_and(|present| is_same_file(&present, &locked)) {
            true => Ok(()),
            false => Err(io::Error::other("the lock file was removed; another pve-sim may use this state file")),
        }
    }

    /// Reads the file. Stops one byte beyond the valid size, which is enough to detect a file that is too long.
    fn read(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        File::open(&self.path)?.take((HEADER + SIZE + 1) as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn parse(&self, bytes: Vec<u8>) -> Result<Content, MemoryFileError> {
        let Some((header, image)) = bytes.split_first_chunk::<HEADER>() else { return Ok(Content::Damaged) };
        let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let (version, found, size) = (word(4), word(8), word(12));
        let (layout, found) = (found >> KIND_BITS, found & ((1 << KIND_BITS) - 1));
        if !header.starts_with(&MAGIC) || version != VERSION || size as usize != SIZE {
            return Ok(Content::Damaged);
        }
        if layout > LAYOUT {
            return Err(format!("{}: written by a newer pve-sim", self.path.display()).into());
        }
        if found != self.kind {
            let (found, wanted, file) = (kind(found), kind(self.kind), self.path.display());
            return Err(format!("{file}: holds the memory of {found}, not of {wanted}").into());
        }
        Ok(Flash::from_image(image.to_vec()).map_or(Content::Damaged, Content::Image))
    }

    /// Returns the prefix of the names of unfinished files; [`UNFINISHED_SUFFIX`] letters and digits follow it.
    fn unfinished_prefix(&self) -> OsString {
        let mut prefix = OsString::from(".");
        prefix.push(self.path.file_name().unwrap_or_default());
        prefix.push(".");
        prefix
    }

    /// Creates a file for the next content.
    fn unfinished(&self, folder: &Path) -> io::Result<NamedTempFile> {
        let mut unfinished = Builder::new();
        let prefix = self.unfinished_prefix();
        // With the digit, no suffix has only lowercase letters, which `sweep` keeps.
        unfinished.prefix(&prefix).rand_bytes(UNFINISHED_SUFFIX - 1).suffix("0");
        #[cfg(unix)]
        unfinished.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        unfinished.tempfile_in(folder)
    }

    /// Removes unfinished files left by killed processes next to the state file: `.name.nvm.` followed by six letters
    /// or digits. Suffixes of only lowercase letters (`.backup`) are kept, because they may be a user's copy.
    fn sweep(&self) {
        let Some(folder) = self.path.parent() else { return };
        let prefix = self.unfinished_prefix();
        let prefix = prefix.to_string_lossy();
        let is_left_behind = |found: &DirEntry| {
            let name = found.file_name();
            let ending = name.to_str().and_then(|name| name.strip_prefix(&*prefix)).unwrap_or_default();
            ending.len() == UNFINISHED_SUFFIX
                && ending.bytes().all(|byte| byte.is_ascii_alphanumeric())
                && !ending.bytes().all(|byte| byte.is_ascii_lowercase())
                && found.file_type().is_ok_and(|kind| kind.is_file())
        };
        for found in fs::read_dir(folder).into_iter().flatten().flatten().filter(is_left_behind) {
            // An unfinished file that cannot be removed does no harm.
            let _ = fs::remove_file(found.path());
        }
    }

    fn error(&self, action: &str, reason: io::Error) -> MemoryFileError {
        format!("{}: cannot {action}: {reason}", self.path.display()).into()
    }
}

impl MemoryFile for StateFile {
    fn write(&self, image: &[u8]) -> Result<(), MemoryFileError> {
        let size = u32::try_from(image.len()).unwrap_or(u32::MAX);
        let mut header = Vec::with_capacity(HEADER);
        header.extend_from_slice(&MAGIC);
        for word in [VERSION, LAYOUT << KIND_BITS | self.kind, size] {
            header.extend_from_slice(&word.to_le_bytes());
        }
        let replace = || -> io::Result<()> {
            let folder = self.path.parent().unwrap_or(Path::new("."));
            let mut file = self.unfinished(folder)?;
            file.write_all(&header)?;
            file.write_all(image)?;
            if let Ok(present) = fs::metadata(&self.path) {
                file.as_file().set_permissions(present.permissions())?;
                #[cfg(unix)]
                give_to_owner_of(&present, file.as_file());
            }
            file.as_file().sync_all()?;
            self.check_lock()?;
            take_the_place(file, &self.path)?;
            #[cfg(unix)]
            File::open(folder)?.sync_all()?;
            Ok(())
        };
        replace().map_err(|error| self.error("write", error))
    }

    /// Renames the damaged file to the first free name of `name.nvm.bad`, `name.nvm.bad.2` and so on; returns a message
    /// with both names. The next write syncs the folder.
    fn put_aside(&self) -> Result<String, MemoryFileError> {
        let name = |number: u32| match number {
            1 => self.path.with_added_extension("bad"),
            _ => self.path.with_added_extension(format!("bad.{number}")),
        };
        for aside in (1..).map(name) {
            // Creates the name exclusively first, so that no file is ever overwritten.
            match OpenOptions::new().write(true).create_new(true).open(&aside) {
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(self.error("rename the damaged file", error)),
            }
            return match fs::rename(&self.path, &aside) {
                Ok(()) => Ok(format!(
                    "{} is damaged: renamed to {}, starting with defaults",
                    self.path.display(),
                    aside.display()
                )),
                Err(error) => {
                    // The file that reserved the name is still empty.
                    let _ = fs::remove_file(&aside);
                    Err(self.error("rename the damaged file", error))
                }
            };
        }
        unreachable!("every number up to u32::MAX has a `.bad` file")
    }
}

#[cfg(unix)]
fn is_same_file(one: &fs::Metadata, other: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

/// Returns true: on Windows, a locked file cannot be removed, so no other file takes its path.
#[cfg(not(unix))]
const fn is_same_file(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    true
}

/// Renames a finished file over the file at `path`, with retries on Windows; removes the finished file if every attempt
/// fails.
fn take_the_place(mut file: NamedTempFile, path: &Path) -> io::Result<()> {
    for pause in RENAME_PAUSES {
        match file.persist(path) {
            Ok(_) => return Ok(()),
            Err(refused) => file = refused.file,
        }
        thread::sleep(Duration::from_millis(pause));
    }
    file.persist(path)?;
    Ok(())
}

/// Sets the owner of a new file to that of the file it replaces, if permitted, because root may run a simulator on a
/// user's files.
#[cfg(unix)]
fn give_to_owner_of(present: &fs::Metadata, file: &File) {
    use std::os::unix::fs::{MetadataExt as _, fchown};
    let _ = fchown(file, Some(present.uid()), Some(present.gid()));
}

#[cfg(test)]
#[path = "state_file_tests.rs"]
mod tests;
