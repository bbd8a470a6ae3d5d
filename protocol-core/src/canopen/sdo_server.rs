//! SDO server (CiA 301 7.2.4; SPEC 4.2): expedited and segmented transfers, both ways.
//!
//! The server knows the entries of the dictionary and no objects: it hands out reads and writes, and takes their
//! results.

use super::dictionary::{Access, Entries, Entry, Place, Value, number};
use super::sdo_download::Download;
use super::sdo_upload::Upload;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::sdo::{AbortCode, Answer, Multiplexer, Request, Segment};

/// After so long without the next segment a transfer is aborted (A).
pub(crate) const SEGMENT_TIMEOUT: Duration = Duration::from_secs(5);

/// The object that an abort names when no transfer was in progress.
const NO_TRANSFER: Multiplexer = Multiplexer::new(0, 0);

/// A request or an answer on the bus.
pub(crate) type Bytes = [u8; 8];

/// The outcome of a request.
#[derive(Debug)]
pub(crate) enum Step<'a> {
    /// Nothing: the client has given up.
    Nothing,
    /// An answer.
    Answer(Bytes),
    /// Read the object, then call [`SdoServer::uploaded`].
    Read(Place),
    /// Write the object, then call [`SdoServer::written`], or [`SdoServer::wait`] for what the write demands of the
    /// device.
    Write {
        /// The object: it may be written.
        place: Place,
        /// The value, of the object's type and length.
        value: Value<'a>,
        /// The answer to a write that succeeds.
        done: Bytes,
    },
}

/// A server for one client at a time.
#[derive(Clone, Debug)]
pub(crate) struct SdoServer {
    transfer: Transfer,
    /// The instant at which the next segment is overdue; [`NEVER`] while none is expected.
    timeout: Instant,
}

#[derive(Clone, Debug)]
enum Transfer {
    /// Nothing is in progress.
    Idle,
    /// The client fetches segments.
    Upload(Upload),
    /// The client sends segments.
    Download(Download),
    /// The client waits for what its write of an object has demanded, and then for this answer.
    Waiting(Place, Bytes),
}

impl SdoServer {
    /// Returns a server with no transfer in progress.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { transfer: Transfer::Idle, timeout: NEVER }
    }

    /// Takes a request. Inlined where a product is known: the look-up in a table of known length is half as long.
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

    /// Takes a request that begins no transfer.
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

    /// Answers an upload with what was read.
    #[inline]
    pub(crate) fn uploaded(&mut self, place: Place, read: Result<Value<'_>, AbortCode>, now: Instant) -> Bytes {
        let object = place.entry.object();
        match read {
            Ok(Value::Number(data)) => Answer::UploadExpedited { object, size: place.entry.size(), data }.emit(),
            Ok(Value::Text(text)) => self.begin_upload(object, text, now),
            Err(code) => Answer::Abort(object, code).emit(),
        }
    }

    /// Ends a download: `done` is the answer to a write that succeeded.
    pub(crate) fn written(&mut self, place: Place, done: Bytes, written: Result<(), AbortCode>) -> Bytes {
        self.cancel();
        match written {
            Ok(()) => done,
            Err(code) => Answer::Abort(place.entry.object(), code).emit(),
        }
    }

    /// Lets the client of a download wait for what the write has demanded.
    pub(crate) fn wait(&mut self, place: Place, done: Bytes) {
        self.cancel();
        self.transfer = Transfer::Waiting(place, done);
    }

    /// Returns the object whose client waits for what its write has demanded.
    pub(crate) const fn waits_for(&self) -> Option<Place> {
        match self.transfer {
            Transfer::Waiting(place, _) => Some(place),
            _ => None,
        }
    }

    /// Ends the write that [waits](Self::waits_for); returns its answer.
    pub(crate) fn end(&mut self, result: Result<(), AbortCode>) -> Option<Bytes> {
        let Transfer::Waiting(place, done) = self.transfer else { return None };
        Some(self.written(place, done, result))
    }

    /// Returns the abort of a transfer whose client has stopped sending.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Bytes> {
        (now >= self.deadline()).then(|| self.break_off(AbortCode::TIMEOUT))
    }

    /// Returns when [`poll`](Self::poll) is next due.
    #[inline]
    #[must_use]
    pub(crate) const fn deadline(&self) -> Instant {
        self.timeout
    }

    /// Ends whatever is in progress, silently: NMT stop, a reset, or the client's own abort.
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

    /// Ends the transfer in progress with an abort that names its object. A client that waits has sent all it has: the
    /// segment is another's, and its wait goes on.
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

/// Returns the value of a download of up to four bytes. Without a size, a number's own length is taken from the front,
/// and of a text the bytes before the zeros at its end (A).
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

/// Returns a text of one to four characters, as an expedited answer carries it.
fn short_text(text: &[u8]) -> Option<(u8, u32)> {
    let size = u8::try_from(text.len()).ok().filter(|size| matches!(size, 1..=4))?;
    Some((size, number(text)))
}
