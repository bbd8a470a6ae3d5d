//! SDO server (CiA 301 7.2.4; SPEC 4.2): expedited and segmented transfers, both ways.

use super::dictionary::{Access, DataType, Row, Value};
use super::sdo_download::Download;
use super::sdo_upload::Upload;
use crate::outcome::Outcome;
use crate::time::{Duration, Instant, NEVER, delayed};
use crate::wire::sdo::{AbortCode, Answer, Multiplexer, Request};

/// After so long without the next segment a transfer is aborted (A).
pub(crate) const SEGMENT_TIMEOUT: Duration = Duration::from_secs(5);

/// The object that an abort names when no transfer was in progress.
const NO_TRANSFER: Multiplexer = Multiplexer::new(0, 0);

/// A request or an answer on the bus.
pub(crate) type Bytes = [u8; 8];

/// The objects that a server gives access to.
pub(crate) trait Objects {
    /// What lies behind an object.
    type Behind: Copy + 'static;
    /// What a write can demand of the device: the answer waits for [`SdoServer::end`].
    type Demand: Copy + PartialEq;

    /// Returns the row of an object.
    ///
    /// # Errors
    /// [`AbortCode::NO_OBJECT`] or [`AbortCode::NO_SUB`] when there is none.
    fn find(&self, object: Multiplexer) -> Result<&'static Row<Self::Behind>, AbortCode>;

    /// Reads an object.
    ///
    /// # Errors
    /// An abort code when there is nothing to be read now.
    fn read(&self, behind: Self::Behind) -> Result<Value<'_>, AbortCode>;

    /// Writes an object; the value has the object's type and length.
    ///
    /// # Errors
    /// An abort code, with nothing changed, when the value or the state forbids it.
    fn write(&mut self, behind: Self::Behind, value: Value<'_>) -> Result<Outcome<(), Self::Demand>, AbortCode>;
}

/// A server for one client at a time.
#[derive(Debug)]
pub(crate) struct SdoServer<D> {
    transfer: Transfer<D>,
    /// When the next segment is overdue; [`NEVER`] while none is expected.
    timeout: Instant,
}

#[derive(Debug)]
enum Transfer<D> {
    /// Nothing is in progress.
    Idle,
    /// The client fetches segments.
    Upload(Upload),
    /// The client sends segments.
    Download(Download),
    /// The client waits for what its write has demanded, and then for this answer.
    Waiting(Multiplexer, Bytes, D),
}

impl<D: Copy + PartialEq> Default for SdoServer<D> {
    fn default() -> Self {
        Self::new()
    }
}

impl<D: Copy + PartialEq> SdoServer<D> {
    /// Returns a server with no transfer in progress.
    #[must_use]
    pub(crate) const fn new() -> Self {
        Self { transfer: Transfer::Idle, timeout: NEVER }
    }

    /// Takes a request.
    pub(crate) fn handle(
        &mut self,
        bytes: &Bytes,
        objects: &mut impl Objects<Demand = D>,
        now: Instant,
    ) -> Outcome<Bytes, D> {
        Outcome::Done(match Request::parse(bytes) {
            Request::InitiateUpload(object) => self.initiate_upload(object, objects, now),
            Request::DownloadExpedited { object, size, data } => {
                let written = expedited(object, size, data, objects);
                return self.written(object, written, Answer::DownloadDone(object).emit());
            }
            Request::InitiateDownload { object, size } => self.initiate_download(object, size, objects, now),
            Request::UploadSegment { toggle } => self.upload_segment(toggle, now),
            Request::DownloadSegment(segment) => {
                let Transfer::Download(download) = &mut self.transfer else {
                    return Outcome::Done(self.break_off(AbortCode::UNKNOWN_COMMAND));
                };
                let object = download.object();
                let done = Answer::DownloadSegmentDone { toggle: segment.toggle }.emit();
                match download.segment(&segment) {
                    Ok(None) => {
                        self.timeout = delayed(now, SEGMENT_TIMEOUT);
                        done
                    }
                    Ok(Some(data)) => {
                        let written = writable(object, objects)
                            .and_then(|row| objects.write(row.behind, Value::of(row.entry.data_type, data)));
                        return self.written(object, written, done);
                    }
                    Err(code) => self.break_off(code),
                }
            }
            Request::Abort(..) => {
                self.cancel();
                return Outcome::Nothing;
            }
            Request::Unknown(object) => {
                self.cancel();
                Answer::Abort(object, AbortCode::UNKNOWN_COMMAND).emit()
            }
        })
    }

    /// Ends the write that waits for this demand; returns its answer.
    pub(crate) fn end(&mut self, demand: D, result: Result<(), AbortCode>) -> Option<Bytes> {
        let (object, done) = match &self.transfer {
            Transfer::Waiting(object, done, waits_for) if *waits_for == demand => (*object, *done),
            _ => return None,
        };
        self.cancel();
        Some(match result {
            Ok(()) => done,
            Err(code) => Answer::Abort(object, code).emit(),
        })
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

    fn initiate_upload(&mut self, object: Multiplexer, objects: &impl Objects, now: Instant) -> Bytes {
        self.cancel();
        let read = objects.find(object).and_then(|row| Ok((row, objects.read(row.behind)?)));
        match read {
            Ok((row, Value::Number(data))) => {
                Answer::UploadExpedited { object, size: row.entry.data_type.size(), data }.emit()
            }
            Ok((_, Value::Text(text))) => match short_text(text) {
                Some((size, data)) => Answer::UploadExpedited { object, size, data }.emit(),
                None => match Upload::new(object, text) {
                    Ok(upload) => {
                        self.transfer = Transfer::Upload(upload);
                        self.timeout = delayed(now, SEGMENT_TIMEOUT);
                        Answer::UploadInitiated { object, size: u32::try_from(text.len()).unwrap_or(u32::MAX) }.emit()
                    }
                    Err(code) => Answer::Abort(object, code).emit(),
                },
            },
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

    fn initiate_download(
        &mut self,
        object: Multiplexer,
        size: Option<u32>,
        objects: &impl Objects,
        now: Instant,
    ) -> Bytes {
        self.cancel();
        let download = writable(object, objects).and_then(|row| Download::new(object, row.entry.data_type, size));
        match download {
            Ok(download) => {
                self.transfer = Transfer::Download(download);
                self.timeout = delayed(now, SEGMENT_TIMEOUT);
                Answer::DownloadDone(object).emit()
            }
            Err(code) => Answer::Abort(object, code).emit(),
        }
    }

    /// Ends a download: `done` is the answer to a write that succeeds, at once or when its demand has been met.
    #[inline(always)]
    fn written(
        &mut self,
        object: Multiplexer,
        written: Result<Outcome<(), D>, AbortCode>,
        done: Bytes,
    ) -> Outcome<Bytes, D> {
        self.cancel();
        match written {
            Ok(Outcome::Demand(demand)) => {
                self.transfer = Transfer::Waiting(object, done, demand);
                Outcome::Demand(demand)
            }
            Ok(Outcome::Done(()) | Outcome::Nothing) => Outcome::Done(done),
            Err(code) => Outcome::Done(Answer::Abort(object, code).emit()),
        }
    }

    /// Ends whatever is in progress with an abort that names its object.
    fn break_off(&mut self, code: AbortCode) -> Bytes {
        let object = match &self.transfer {
            Transfer::Upload(upload) => upload.object(),
            Transfer::Download(download) => download.object(),
            Transfer::Waiting(object, ..) => *object,
            Transfer::Idle => NO_TRANSFER,
        };
        self.cancel();
        Answer::Abort(object, code).emit()
    }
}

/// Returns the row of an object that may be written.
fn writable<O: Objects>(object: Multiplexer, objects: &O) -> Result<&'static Row<O::Behind>, AbortCode> {
    let row = objects.find(object)?;
    match row.entry.access {
        Access::Rw => Ok(row),
        Access::Ro => Err(AbortCode::READ_ONLY),
    }
}

/// Writes up to four bytes. Without a size, a number's own length is taken from the front, and of a text the bytes before
/// the zeros at its end.
fn expedited<O: Objects>(
    object: Multiplexer,
    size: Option<u8>,
    data: u32,
    objects: &mut O,
) -> Result<Outcome<(), O::Demand>, AbortCode> {
    let Row { entry, behind } = writable(object, objects)?;
    let data_type = entry.data_type;
    if let Some(size) = size {
        data_type.check_length(usize::from(size))?;
    }
    if !data_type.is_text() {
        let unused = 32_u32.saturating_sub(u32::from(data_type.size()).saturating_mul(8));
        return objects.write(*behind, Value::Number(data & u32::MAX.unbounded_shr(unused)));
    }
    let bytes = data.to_le_bytes();
    let end = || bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last.saturating_add(1));
    let len = size.map_or_else(end, usize::from);
    objects.write(*behind, Value::Text(bytes.get(..len).unwrap_or(&[])))
}

/// A text of one to four characters, as an expedited answer carries it.
fn short_text(text: &[u8]) -> Option<(u8, u32)> {
    let size = u8::try_from(text.len()).ok().filter(|size| matches!(size, 1..=4))?;
    Value::of(DataType::U32, text).number().map(|data| (size, data))
}
