//! The memory's task: writes the records of the device while the bus keeps running.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::{Channel, Receiver, Sender};
use embassy_time::{Duration, Instant};
use firmware::settings::Settings;
use nvm::{BUFFER, Contents, Records, Unreadable};
use protocol_core::memory::{Record, RecordKey, StoreError};
use static_cell::ConstStaticCell;

use super::flash::{LONGEST_ERASE, Sectors};
use super::wake_up::{Event, notify};

/// The capacity of the queue: one request of each kind.
const REQUESTS: usize = 3;

/// The maximum duration of a request: four erases, and the words written in between.
const LONGEST: Duration = Duration::from_secs(3);
const _: () = assert!(LONGEST.as_millis() > 4 * LONGEST_ERASE.as_millis());

/// A request of the device's task.
pub(super) enum Request {
    /// Write a record.
    Store(RecordKey, Record),
    /// Read all contents into this place.
    Read(&'static mut Contents),
    /// Make the board a different device at the next start.
    Become(Settings),
}

/// The result of a [`Request`].
pub(super) enum Done {
    /// The first result, sent without a request: the settings of the board and all contents of the memory.
    Started(Settings, &'static mut Contents),
    /// The result of writing a record.
    Stored(RecordKey, Result<(), StoreError>),
    /// The result of reading all contents.
    Read(&'static mut Contents),
    /// The result of making the board a different device.
    Became(Result<(), StoreError>),
}

/// The channel from the device's task to the memory's task.
pub(super) type Requests = Channel<CriticalSectionRawMutex, Request, REQUESTS>;
/// The channel from the memory's task to the device's task.
pub(super) type Results = Channel<CriticalSectionRawMutex, Done, REQUESTS>;

/// The memory as seen by the device's task.
pub(super) struct Client {
    requests: Sender<'static, CriticalSectionRawMutex, Request, REQUESTS>,
    results: Receiver<'static, CriticalSectionRawMutex, Done, REQUESTS>,
    /// The number of results still expected.
    awaited: u8,
    /// The time at which the next result is overdue.
    overdue: Instant,
}

impl Client {
    /// Creates the client at a start, when [`Done::Started`] is expected.
    pub(super) fn new(
        requests: Sender<'static, CriticalSectionRawMutex, Request, REQUESTS>,
        results: Receiver<'static, CriticalSectionRawMutex, Done, REQUESTS>,
    ) -> Self {
        Self { requests, results, awaited: 1, overdue: Instant::now() + LONGEST }
    }

    /// Queues a request. [`take`](Self::take) returns its result.
    ///
    /// # Errors
    /// If the queue of requests is full.
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
    // Static, because it is too large for the stack.
    static CONTENTS: ConstStaticCell<Contents> = ConstStaticCell::new(Contents::empty());
    let contents = CONTENTS.take();
    let mut memory = Memory { sectors, buffer: [0; BUFFER] };
    let mut done = Done::Started(memory.start(contents), contents);
    loop {
        results.send(done).await;
        notify(Event::Memory);
        done = match requests.receive().await {
            Request::Store(key, record) => Done::Stored(key, memory.store(key, &record)),
            Request::Read(contents) => {
                memory.read(contents);
                Done::Read(contents)
            }
            Request::Become(settings) => Done::Became(memory.set(settings)),
        };
    }
}

struct Memory {
    sectors: Sectors,
    buffer: [u8; BUFFER],
}

impl Memory {
    /// Reads all contents after power-up. The records of a previous device are cleared first.
    fn start(&mut self, contents: &mut Contents) -> Settings {
        let stored = self.read(contents);
        let mut settings = Settings::at_start(stored);
        if settings.fresh {
            // A failed clear is repeated at the next start.
            settings.fresh = self.clear().is_err();
            contents.image.clear();
        }
        if stored != Some(settings) {
            // A failed write is repeated at the next start.
            let _ = self.set(settings);
        }
        settings
    }

    /// Reads all contents. Returns the stored settings, if any.
    fn read(&mut self, contents: &mut Contents) -> Option<Settings> {
        if let Err(Unreadable) = self.records().read(contents) {
            self.begin_anew(contents);
        }
        contents.setting.as_deref().and_then(Settings::decode)
    }

    /// Erases a memory without valid contents, restores the settings, and marks the contents as damaged.
    fn begin_anew(&mut self, contents: &mut Contents) {
        let erased = self.sectors.erase_all().is_ok();
        defmt::error!("the memory was damaged; erased: {}", erased);
        if let Some(setting) = &contents.setting {
            // Without the settings the board would revert to the kind for which the image was built.
            let _ = self.records().store_setting(setting);
        }
        contents.image.clear();
        contents.image.set_damaged();
    }

    fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        self.records().store(key, record)
    }

    fn clear(&mut self) -> Result<(), StoreError> {
        self.records().clear()
    }

    fn set(&mut self, settings: Settings) -> Result<(), StoreError> {
        self.records().store_setting(&settings.encode())
    }

    const fn records(&mut self) -> Records<'_, &mut Sectors> {
        Records::new(&mut self.sectors, &mut self.buffer)
    }
}
