//! The memory's task: writes what the device wants to keep, while the bus goes on.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::mutex::Mutex;
use embassy_sync::signal::Signal;
use firmware::settings::Settings;
use nvm::{BUFFER, Contents, Records, Unreadable};
use protocol_core::memory::{Image, Record, RecordKey, StoreError};

use super::attention::{Caller, call};
use super::flash::Sectors;

/// What the device's task asks for.
pub(super) enum Request {
    /// To write a record; answered by [`STORED`].
    Store(RecordKey, Record),
    /// To read everything; answered by [`READ`].
    Read,
    /// To make the board another device at the next start; answered by [`BECOMES`].
    Become(Settings),
}

/// One of each at the most.
pub(super) static REQUESTS: Channel<CriticalSectionRawMutex, Request, 3> = Channel::new();
/// Answers [`Request::Store`].
pub(super) static STORED: Signal<CriticalSectionRawMutex, (RecordKey, Result<(), StoreError>)> = Signal::new();
/// Answers [`Request::Read`]: it is in [`CONTENTS`].
pub(super) static READ: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// What the board is, at the start; what its device is to begin with is in [`CONTENTS`].
pub(super) static FOUND: Signal<CriticalSectionRawMutex, Settings> = Signal::new();
/// Everything stored, as it was last read: in a place of its own, because it is too large to be handed round.
pub(super) static CONTENTS: Mutex<CriticalSectionRawMutex, Contents> = Mutex::new(Contents::empty());
/// Answers [`Request::Become`].
pub(super) static BECOMES: Signal<CriticalSectionRawMutex, Result<(), StoreError>> = Signal::new();

#[embassy_executor::task]
pub(super) async fn run(sectors: Sectors) {
    let mut memory = Memory { sectors, buffer: [0; BUFFER] };
    FOUND.signal(memory.start().await);
    loop {
        call(Caller::Memory);
        match REQUESTS.receive().await {
            Request::Store(key, record) => STORED.signal((key, memory.store(key, &record).await)),
            Request::Read => {
                memory.read().await;
                READ.signal(());
            }
            Request::Become(settings) => BECOMES.signal(memory.set(settings).await),
        }
    }
}

struct Memory {
    sectors: Sectors,
    buffer: [u8; BUFFER],
}

impl Memory {
    /// Reads everything, as after power-up: what a new device is to forget is forgotten first.
    async fn start(&mut self) -> Settings {
        let stored = self.read().await;
        let mut settings = Settings::at_start(stored);
        if settings.fresh {
            // One that fails is tried again at the next start.
            settings.fresh = self.clear().await.is_err();
            CONTENTS.lock().await.image = Image::empty();
        }
        if stored != Some(settings) {
            // One that fails is stored at the next start.
            let _ = self.set(settings).await;
        }
        settings
    }

    /// Reads everything; the setting, if there is one.
    async fn read(&mut self) -> Option<Settings> {
        let mut contents = CONTENTS.lock().await;
        let read = async {
            let mut records = self.records().await.map_err(|_| Unreadable)?;
            records.read(&mut contents).await
        };
        if let Err(Unreadable) = read.await {
            self.begin_anew(&mut contents).await;
        }
        contents.setting.as_deref().and_then(Settings::decode)
    }

    /// Nothing in the memory makes sense: erases it, but for the setting, and tells.
    async fn begin_anew(&mut self, contents: &mut Contents) {
        let erased = self.sectors.erase_all().await.is_ok();
        defmt::error!("the memory was damaged; erased: {}", erased);
        if let (Some(setting), Ok(mut records)) = (&contents.setting, self.records().await) {
            // Without it the board would be the kind that the image was built for.
            let _ = records.store_setting(setting).await;
        }
        contents.image = Image::empty();
        contents.image.set_damaged();
    }

    async fn store(&mut self, key: RecordKey, record: &Record) -> Result<(), StoreError> {
        self.records().await?.store(key, record).await
    }

    async fn clear(&mut self) -> Result<(), StoreError> {
        self.records().await?.clear().await
    }

    async fn set(&mut self, settings: Settings) -> Result<(), StoreError> {
        self.records().await?.store_setting(&settings.encode()).await
    }

    async fn records(&mut self) -> Result<Records<'_, &mut Sectors>, StoreError> {
        Records::open(&mut self.sectors, &mut self.buffer).await.map_err(|_| StoreError)
    }
}
