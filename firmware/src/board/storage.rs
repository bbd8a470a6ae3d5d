//! The memory task, which reads and writes the memory while the bus keeps running.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::{Channel, Receiver, Sender};
use embassy_time::{Duration, Instant};
use firmware::settings::Settings;
use nvm::{BUFFER, Contents, Records, Unreadable};
use protocol_core::memory::{Record, RecordKey, StoreError};
use static_cell::ConstStaticCell;

use super::flash::{LONGEST_ERASE, Sectors};
use super::wake_up::{Event, notify};

/// The capacity of the queues: one request of each kind.
const REQUESTS: usize = 3;

/// The maximum duration of a request: four erases, and the words written in between.
const LONGEST: Duration = Duration::from_secs(3);
const _: () = assert!(LONGEST.as_millis() > 4 * LONGEST_ERASE.as_millis());

/// A request from the device task.
pub(super) enum Request {
    /// Write this record.
    Store(RecordKey, Record),
    /// Read all contents of the memory into this value.
    Read(&'static mut Contents),
    /// Make the board a new device at the next start.
    Become(Settings),
}

/// The result of a [`Request`].
pub(super) enum Done {
    /// The settings of the board and all contents of the memory. This first result needs no request.
    Started(Settings, &'static mut Contents),
    /// The result of [`Request::Store`].
    Stored(RecordKey, Result<(), StoreError>),
    /// The result of [`Request::Read`].
    Read(&'static mut Contents),
    /// The result of [`Request::Become`].
    Became(Result<(), StoreError>),
}

/// The channel from the device task to the memory task.
pub(super) type Requests = Channel<CriticalSectionRawMutex, Request, REQUESTS>;
/// The channel from the memory task to the device task.
pub(super) type Results = Channel<CriticalSectionRawMutex, Done, REQUESTS>;

/// The device task's access to the memory.
pub(super) struct Client {
    requests: Sender<'static, CriticalSectionRawMutex, Request, REQUESTS>,
    results: Receiver<'static, CriticalSectionRawMutex, Done, REQUESTS>,
    /// The number of outstanding results.
    awaited: u8,
    /// The time at which the next result is overdue.
    overdue: Instant,
}

impl Client {
    /// Creates the client at a start, which waits for [`Done::Started`].
    pub(super) fn new(
        requests: Sender<'static, CriticalSectionRawMutex, Request, REQUESTS>,
        results: Receiver<'static, CriticalSectionRawMutex, Done, REQUESTS>,
    ) -> Self {
        Self { requests, results, awaited: 1, overdue: Instant::now() + LONGEST }
    }

    /// Queues a request. [`take`](Self::take) returns its result.
    ///
    /// # Errors Returns an error if the request queue is full.
    pub(super) fn ask(&mut self, request: Request) -> Result<(), StoreError> {
        self.requests.try_send(request).map_err(|_| StoreError)?;
        self.overdue = if self.awaited == 0 { Instant::now() + LONGEST } else { self.overdue };
        self.awaited += 1;
        Ok(())
    }

    /// Returns the next result, if any.
    pub(super) fn take(&mut self) -> Option<Done> {
        let done = self.results.try_receive().ok()?;
        self.awaited -= 1;
        self.overdue = Instant::now() + LONGEST;
        Some(done)
    }

    /// Returns whether a result is overdue.
    pub(super) fn hangs(&self, now: Instant) -> bool {
        self.awaited != 0 && now > self.overdue
    }
}

#[embassy_executor::task]
pub(super) async fn run(
    sectors: Sectors,
    requests: Receiver<'static, CriticalSectionRawMutex, Request, REQUESTS>,
    results: Sender<'static, CriticalSectionRawMutex, Done, REQUESTS>,
) -> ! {
    // A static, because the contents are too large for the stack.
    static CONTENTS: ConstStaticCell<Contents> = ConstStaticCell::new(Contents::empty());
    let contents = CONTENTS.take();
    let mut memory = Memory { sectors, buffer: [0; BUFFER], pending: None };
    let mut done = Done::Started(memory.start(contents), contents);
    loop {
        results.send(done).await;
        notify(Event::Memory);
        done = match requests.receive().await {
            Request::Store(key, record) => Done::Stored(key, memory.store(key, &record)),
            Request::Read(contents) => {
                memory.read(contents);
                memory.hide_previous(contents);
                Done::Read(contents)
            }
            Request::Become(settings) => Done::Became(memory.set(settings)),
        };
    }
}

struct Memory {
    sectors: Sectors,
    buffer: [u8; BUFFER],
    /// The settings of a start that the flash does not hold yet. If they are fresh, it may still hold the records of the
    /// previous device, and the next start would remove all records.
    pending: Option<Settings>,
}

impl Memory {
    /// Reads all contents after power-up, without those of a previous device. Returns the settings.
    fn start(&mut self, contents: &mut Contents) -> Settings {
        let stored = self.read(contents);
        let settings = Settings::at_start(stored);
        self.pending = Some(settings).filter(|settings| settings.fresh || stored != Some(*settings));
        self.hide_previous(contents);
        // The next store or start repeats a failed attempt.
        let _ = self.take_over();
        settings
    }

    /// Removes the records of a previous device and writes the settings, unless this has succeeded already.
    fn take_over(&mut self) -> Result<(), StoreError> {
        let Some(settings) = self.pending else { return Ok(()) };
        if settings.fresh {
            self.records().clear()?;
        }
        self.set(Settings { fresh: false, ..settings })
    }

    /// Removes the records of a previous device from the contents.
    fn hide_previous(&self, contents: &mut Contents) {
        if self.pending.is_some_and(|settings| settings.fresh) {
            contents.image.clear();
        }
    }

    /// Reads all contents. A memory without an intact entry is erased and reported as damaged. Returns the stored
    /// settings, if any.
    fn read(&mut self, contents: &mut Contents) -> Option<Settings> {
        if let Err(Unreadable) = self.records().read(contents) {
            let erased = self.sectors.erase_all().is_ok();
            defmt::error!("the memory was damaged; erased: {}", erased);
            contents.image.set_damaged();
        }
        contents.setting.as_deref().and_then(Settings::decode)
    }

    /// Writes a record. It is refused while the next start would remove it.
    fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        self.take_over()?;
        self.records().store(key, record)
    }

    fn set(&mut self, settings: Settings) -> Result<(), StoreError> {
        self.records().store_setting(&settings.encode())?;
        self.pending = None;
        Ok(())
    }

    const fn records(&mut self) -> Records<'_, &mut Sectors> {
        Records::new(&mut self.sectors, &mut self.buffer)
    }
}
