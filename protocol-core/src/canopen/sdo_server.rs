//! The SDO server (CiA 301 7.2.4; SPEC 4.2): expedited and segmented uploads and downloads.
//!
//! The server uses only the entries of the dictionary. The caller reads and writes the objects, and reports the results
//! to the server.

use super::dictionary::{Access, Entries, Entry, Place, Value, number};
use super::sdo_download::Download;
use super::sdo_upload::Upload;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::sdo::{AbortCode, Answer, Multiplexer, Request, Segment};

/// The maximum time between two segments, after which the server aborts the transfer (A).
pub(crate) const SEGMENT_TIMEOUT: Duration = Duration::from_secs(5);

/// The multiplexer of an abort while no transfer is in progress.
const NO_TRANSFER: Multiplexer = Multiplexer::new(0, 0);

/// The eight data bytes of a request or an answer.
pub(crate) type Bytes = [u8; 8];

/// The caller's next step after a request.
#[derive(Debug)]
pub(crate) enum Step<'a> {
    /// Send no answer.
    Nothing,
    /// Send an answer.
    Answer(Bytes),
    /// Read this object, then call [`SdoServer::uploaded`].
    Read(Place),
    /// Write this object, then call [`SdoServer::written`]. If the write demands an action of the device, call
    /// [`SdoServer::wait`] instead.
    Write {
        /// The object, which is writable.
        place: Place,
        /// The value, checked for type and length.
        value: Value<'a>,
        /// The answer to a successful write.
        done: Bytes,
    },
}

/// An SDO server, which handles one transfer at a time.
#[derive(Clone, Debug)]
pub(crate) struct SdoServer {
    transfer: Transfer,
    /// The time at which the next segment is overdue; [`NEVER`] while none is expected.
    timeout: Instant,
}

#[derive(Clone, Debug)]
enum Transfer {
    /// No transfer.
    Idle,
    /// The client requests segments.
    Upload(Upload),
    /// The client sends segments.
    Download(Download),
    /// The answer to a write is deferred until the device has completed the demanded action.
    Waiting(Place, Bytes),
}

impl SdoServer {
    /// Creates a server without a transfer.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { transfer: Transfer::Idle, timeout: NEVER }
    }

    /// Handles a request.
    // Inlining saves 62 instructions on an SDO, because the length of the product's table is then a constant.
    #[inline(always)]
    pub(crate) fn handle<'a>(&'a mut self, bytes: &'a Bytes, objects: Entries, now: Instant) -> Step<'a> {
        let request = Request::parse(bytes);
        let (Request::InitiateUpload(object)
        | Request::DownloadExpedited { object, .. }
        | Request::InitiateDownload { object, .. }) = request
        else {
            return self.continue_transfer(request, now);
        };
        self.cancel();
        let abort = |code| Step::Answer(Answer::Abort(object, code).emit());
        let place = match objects.find(object) {
            Ok(place) => place,
            Err(code) => return abort(code),
        };
        let done = Answer::DownloadDone(object).emit();
        match request {
            Request::InitiateUpload(_) => Step::Read(place),
            _ if place.entry.access() == Access::Ro => abort(AbortCode::READ_ONLY),
            Request::DownloadExpedited { size, .. } => match expedited(place.entry, size, bytes) {
                Ok(value) => Step::Write { place, value, done },
                Err(code) => abort(code),
            },
            Request::InitiateDownload { size, .. } => match Download::new(place, size) {
                Ok(download) => {
                    self.transfer = Transfer::Download(download);
                    self.timeout = delayed(now, SEGMENT_TIMEOUT);
                    Step::Answer(done)
                }
                Err(code) => abort(code),
            },
            _ => Step::Nothing,
        }
    }

    /// Handles a request that does not begin a transfer.
    fn continue_transfer(&mut self, request: Request, now: Instant) -> Step<'_> {
        Step::Answer(match request {
            Request::UploadSegment { toggle } => self.upload_segment(toggle, now),
            Request::DownloadSegment(segment) => return self.download_segment(&segment, now),
            Request::Unknown(object) => {
                if self.waits_for().is_none() {
                    self.cancel();
                }
                Answer::Abort(object, AbortCode::UNKNOWN_COMMAND).emit()
            }
            _ => {
                self.cancel();
                return Step::Nothing;
            }
        })
    }

    /// Answers an upload with the value read.
    #[inline]
    pub(crate) fn uploaded(&mut self, place: Place, read: Result<Value<'_>, AbortCode>, now: Instant) -> Bytes {
        let object = place.entry.object();
        match read {
            Ok(Value::Number(data)) => Answer::UploadExpedited { object, size: place.entry.size(), data }.emit(),
            Ok(Value::Text(text)) => self.begin_upload(object, text, now),
            Err(code) => Answer::Abort(object, code).emit(),
        }
    }

    /// Ends a download. Returns the answer: `done` after a successful write, otherwise an abort.
    pub(crate) fn written(&mut self, place: Place, done: Bytes, written: Result<(), AbortCode>) -> Bytes {
        self.cancel();
        match written {
            Ok(()) => done,
            Err(code) => Answer::Abort(place.entry.object(), code).emit(),
        }
    }

    /// Defers the answer to a write until [`end`](Self::end).
    pub(crate) fn wait(&mut self, place: Place, done: Bytes) {
        self.cancel();
        self.transfer = Transfer::Waiting(place, done);
    }

    /// Returns the object of a write whose answer is [deferred](Self::wait).
    pub(crate) const fn waits_for(&self) -> Option<Place> {
        match self.transfer {
            Transfer::Waiting(place, _) => Some(place),
            _ => None,
        }
    }

    /// Ends a write whose answer was [deferred](Self::wait). Returns the answer.
    pub(crate) fn end(&mut self, result: Result<(), AbortCode>) -> Option<Bytes> {
        let Transfer::Waiting(place, done) = self.transfer else { return None };
        Some(self.written(place, done, result))
    }

    /// Aborts a transfer whose next segment is overdue. Returns the abort message.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Bytes> {
        (now >= self.deadline()).then(|| self.break_off(AbortCode::TIMEOUT))
    }

    /// Returns the time at which [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) const fn deadline(&self) -> Instant {
        self.timeout
    }

    /// Ends any transfer without an answer.
    pub(crate) fn cancel(&mut self) {
        self.transfer = Transfer::Idle;
        self.timeout = NEVER;
    }

    fn download_segment(&mut self, segment: &Segment, now: Instant) -> Step<'_> {
        let is_last = match &mut self.transfer {
            Transfer::Download(download) => download.segment(segment),
            _ => Err(AbortCode::UNKNOWN_COMMAND),
        };
        if let Err(code) = is_last {
            return Step::Answer(self.break_off(code));
        }
        let done = Answer::DownloadSegmentDone { toggle: segment.toggle }.emit();
        match &self.transfer {
            Transfer::Download(download) if is_last == Ok(true) => {
                let place = download.place();
                Step::Write { place, value: place.entry.value(download.data()), done }
            }
            _ => {
                self.timeout = delayed(now, SEGMENT_TIMEOUT);
                Step::Answer(done)
            }
        }
    }

    fn begin_upload(&mut self, object: Multiplexer, text: &[u8], now: Instant) -> Bytes {
        if let Some((size, data)) = short_text(text) {
            return Answer::UploadExpedited { object, size, data }.emit();
        }
        match Upload::new(object, text) {
            Ok(upload) => {
                self.transfer = Transfer::Upload(upload);
                self.timeout = delayed(now, SEGMENT_TIMEOUT);
                Answer::UploadInitiated { object, size: u32::try_from(text.len()).unwrap_or(u32::MAX) }.emit()
            }
            Err(code) => Answer::Abort(object, code).emit(),
        }
    }

    fn upload_segment(&mut self, toggle: bool, now: Instant) -> Bytes {
        let Transfer::Upload(upload) = &mut self.transfer else {
            return self.break_off(AbortCode::UNKNOWN_COMMAND);
        };
        match upload.segment(toggle) {
            Ok(segment) => {
                self.timeout = delayed(now, SEGMENT_TIMEOUT);
                if segment.last {
                    self.cancel();
                }
                Answer::UploadSegment(segment).emit()
            }
            Err(code) => self.break_off(code),
        }
    }

    /// Ends the transfer in progress. Returns the abort message for the transferred object. A write with a deferred
    /// answer continues, because the client has sent all data.
    fn break_off(&mut self, code: AbortCode) -> Bytes {
        let object = match &self.transfer {
            Transfer::Upload(upload) => upload.object(),
            Transfer::Download(download) => download.place().entry.object(),
            Transfer::Waiting(..) | Transfer::Idle => return Answer::Abort(NO_TRANSFER, code).emit(),
        };
        self.cancel();
        Answer::Abort(object, code).emit()
    }
}

/// Decodes the value of an expedited download. Without an indicated size, a number takes the bytes of its type, and a
/// text ends before its trailing zeros (A).
fn expedited<'a>(entry: &Entry, size: Option<u8>, [_, _, _, _, data @ ..]: &'a Bytes) -> Result<Value<'a>, AbortCode> {
    if let Some(size) = size {
        entry.check_length(usize::from(size))?;
    }
    if !entry.is_text() {
        let unused = 32_u32.saturating_sub(u32::from(entry.size()).saturating_mul(8));
        return Ok(Value::Number(u32::from_le_bytes(*data) & u32::MAX.unbounded_shr(unused)));
    }
    let end = || data.iter().rposition(|byte| *byte != 0).map_or(0, |last| last.saturating_add(1));
    let len = size.map_or_else(end, usize::from);
    Ok(Value::Text(data.get(..len).unwrap_or(&[])))
}

/// Returns the length and the bytes of a text that fits an expedited answer: one to four characters.
fn short_text(text: &[u8]) -> Option<(u8, u32)> {
    let size = u8::try_from(text.len()).ok().filter(|size| matches!(size, 1..=4))?;
    Some((size, number(text)))
}
