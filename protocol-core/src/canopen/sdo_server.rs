//! SDO server (CiA 301 7.2.4; SPEC 4.2): expedited and segmented transfers, both ways.

use super::dictionary::{Access, DataType, Objects, Value, Written};
use super::sdo_download::Download;
use super::sdo_upload::Upload;
use crate::time::{Duration, Instant, NEVER, after};
use crate::wire::sdo::{AbortCode, Answer, Multiplexer, Request};

/// The longest object that can be transferred, in bytes: a manufacturer software version has 47.
pub const TRANSFER_MAX: usize = 64;

/// After so long without the next segment a transfer is aborted (A).
pub const SEGMENT_TIMEOUT: Duration = Duration::from_secs(5);

/// The object that an abort names when no transfer was in progress.
const NO_TRANSFER: Multiplexer = Multiplexer::new(0, 0);

/// A server for one client at a time.
#[derive(Debug, Default)]
pub struct SdoServer {
    transfer: Transfer,
}

#[derive(Debug, Default)]
enum Transfer {
    /// Nothing is in progress.
    #[default]
    Idle,
    /// The client fetches segments until `timeout`.
    Upload(Upload, Instant),
    /// The client sends segments until `timeout`.
    Download(Download, Instant),
    /// The client waits for the non-volatile memory, and for this answer when it holds the data.
    Storing(Multiplexer, Answer),
}

impl SdoServer {
    /// Takes a request of eight bytes; the answer, unless it has to wait or there is none.
    pub fn handle(&mut self, bytes: &[u8; 8], objects: &mut impl Objects, now: Instant) -> Option<Answer> {
        match Request::parse(bytes) {
            Request::InitiateUpload(object) => Some(self.initiate_upload(object, objects, now)),
            Request::DownloadExpedited { object, size, data } => {
                self.transfer = Transfer::Idle;
                let written = expedited(object, size, data, objects, now);
                self.written(object, written, Answer::DownloadDone(object))
            }
            Request::InitiateDownload { object, size } => Some(self.initiate_download(object, size, objects, now)),
            Request::UploadSegment { toggle } => Some(self.upload_segment(toggle, now)),
            Request::DownloadSegment(segment) => {
                let Transfer::Download(download, timeout) = &mut self.transfer else {
                    return Some(self.break_off(AbortCode::UNKNOWN_COMMAND));
                };
                let object = download.object();
                let data_type = download.data_type();
                let done = Answer::DownloadSegmentDone { toggle: segment.toggle };
                match download.segment(&segment) {
                    Ok(None) => {
                        *timeout = after(now, SEGMENT_TIMEOUT);
                        Some(done)
                    }
                    Ok(Some(data)) => {
                        let written = objects.write(object, Value::of(data_type, data), now);
                        self.written(object, written, done)
                    }
                    Err(code) => Some(self.break_off(code)),
                }
            }
            Request::Abort(..) => {
                self.cancel();
                None
            }
            Request::Unknown(object) => {
                self.cancel();
                Some(Answer::Abort(object, AbortCode::UNKNOWN_COMMAND))
            }
        }
    }

    /// The non-volatile memory has answered what a write waited for.
    pub fn stored(&mut self, result: Result<(), AbortCode>) -> Option<Answer> {
        let Transfer::Storing(object, done) = self.transfer else { return None };
        self.transfer = Transfer::Idle;
        Some(match result {
            Ok(()) => done,
            Err(code) => Answer::Abort(object, code),
        })
    }

    /// The abort of a transfer whose client has stopped to send.
    pub fn poll(&mut self, now: Instant) -> Option<Answer> {
        (now >= self.deadline()).then(|| self.break_off(AbortCode::TIMEOUT))
    }

    /// When [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        match self.transfer {
            Transfer::Upload(_, timeout) | Transfer::Download(_, timeout) => timeout,
            Transfer::Idle | Transfer::Storing(..) => NEVER,
        }
    }

    /// Ends whatever is in progress, silently: NMT stop, a reset, or the client's own abort.
    pub fn cancel(&mut self) {
        self.transfer = Transfer::Idle;
    }

    fn initiate_upload(&mut self, object: Multiplexer, objects: &impl Objects, now: Instant) -> Answer {
        self.transfer = Transfer::Idle;
        let entry = match objects.table().find(object) {
            Ok(entry) => entry,
            Err(code) => return Answer::Abort(object, code),
        };
        match objects.read(object) {
            Ok(Value::Number(data)) => Answer::UploadExpedited { object, size: entry.data_type.size(), data },
            Ok(Value::Text(text)) => match short_text(text) {
                Some((size, data)) => Answer::UploadExpedited { object, size, data },
                None => match Upload::new(object, text) {
                    Ok(upload) => {
                        self.transfer = Transfer::Upload(upload, after(now, SEGMENT_TIMEOUT));
                        Answer::UploadInitiated { object, size: u32::try_from(text.len()).unwrap_or(u32::MAX) }
                    }
                    Err(code) => Answer::Abort(object, code),
                },
            },
            Err(code) => Answer::Abort(object, code),
        }
    }

    fn upload_segment(&mut self, toggle: bool, now: Instant) -> Answer {
        let Transfer::Upload(upload, timeout) = &mut self.transfer else {
            return self.break_off(AbortCode::UNKNOWN_COMMAND);
        };
        match upload.segment(toggle) {
            Ok(segment) => {
                *timeout = after(now, SEGMENT_TIMEOUT);
                if segment.last {
                    self.transfer = Transfer::Idle;
                }
                Answer::UploadSegment(segment)
            }
            Err(code) => self.break_off(code),
        }
    }

    fn initiate_download(
        &mut self,
        object: Multiplexer,
        size: Option<u32>,
        objects: &impl Objects,
        now: Instant,
    ) -> Answer {
        self.transfer = Transfer::Idle;
        let download = writable(object, objects).and_then(|data_type| Download::new(object, data_type, size));
        match download {
            Ok(download) => {
                self.transfer = Transfer::Download(download, after(now, SEGMENT_TIMEOUT));
                Answer::DownloadDone(object)
            }
            Err(code) => Answer::Abort(object, code),
        }
    }

    /// The answer to the end of a download: `done` when it was written, at once or when the memory holds it.
    fn written(&mut self, object: Multiplexer, written: Result<Written, AbortCode>, done: Answer) -> Option<Answer> {
        self.transfer = Transfer::Idle;
        match written {
            Ok(Written::Now) => Some(done),
            Ok(Written::WhenStored) => {
                self.transfer = Transfer::Storing(object, done);
                None
            }
            Err(code) => Some(Answer::Abort(object, code)),
        }
    }

    /// Ends whatever is in progress with an abort that names its object.
    fn break_off(&mut self, code: AbortCode) -> Answer {
        let object = match &self.transfer {
            Transfer::Upload(upload, _) => upload.object(),
            Transfer::Download(download, _) => download.object(),
            Transfer::Storing(object, _) => *object,
            Transfer::Idle => NO_TRANSFER,
        };
        self.transfer = Transfer::Idle;
        Answer::Abort(object, code)
    }
}

/// The type of an object that may be written.
fn writable(object: Multiplexer, objects: &impl Objects) -> Result<DataType, AbortCode> {
    let entry = objects.table().find(object)?;
    match entry.access {
        Access::Rw => Ok(entry.data_type),
        Access::Ro => Err(AbortCode::READ_ONLY),
    }
}

/// Writes up to four bytes. Without a size, a number's own length is taken from the front, and of a text what comes before
/// the zeros at its end.
fn expedited(
    object: Multiplexer,
    size: Option<u8>,
    data: u32,
    objects: &mut impl Objects,
    now: Instant,
) -> Result<Written, AbortCode> {
    let data_type = writable(object, objects)?;
    if let Some(size) = size {
        data_type.check_length(usize::from(size))?;
    }
    if !data_type.is_text() {
        let unused = 32_u32.saturating_sub(u32::from(data_type.size()).saturating_mul(8));
        return objects.write(object, Value::Number(data & u32::MAX.unbounded_shr(unused)), now);
    }
    let bytes = data.to_le_bytes();
    let end = || bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last.saturating_add(1));
    let len = size.map_or_else(end, usize::from);
    objects.write(object, Value::Text(bytes.get(..len).unwrap_or(&[])), now)
}

/// A text of one to four characters, as an expedited answer carries it.
fn short_text(text: &[u8]) -> Option<(u8, u32)> {
    let size = u8::try_from(text.len()).ok().filter(|size| matches!(size, 1..=4))?;
    Value::of(DataType::U32, text).number().map(|data| (size, data))
}
