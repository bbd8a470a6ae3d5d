//! The mappings of the first PDOs (CiA 301 7.5.2.36), as far as SDO transfers show them. Everything else is assumed to be
//! the default.

use std::collections::BTreeMap;

use protocol_core::frame::{Frame, Id, StandardId};
use protocol_core::wire::cob_id::{Function, classify};
use protocol_core::wire::sdo::{Answer, Multiplexer, Request};

/// The objects of the mappings.
pub(super) const RPDO: u16 = 0x1600;
pub(super) const TPDO: u16 = 0x1A00;

/// The object that stores all parameters.
const SAVE: u16 = 0x1010;

/// The object that restores the defaults at the next start.
const LOAD: u16 = 0x1011;

/// The mappings by node ID.
#[derive(Clone, Debug, Default)]
pub(super) struct Mappings(BTreeMap<u8, Node>);

/// Values by index and sub-index.
type Values = BTreeMap<(u16, u8), u32>;

#[derive(Clone, Debug, Default)]
struct Node {
    current: Values,
    /// The values after the next start.
    stored: Values,
    /// True if the next start restores the defaults.
    restores: bool,
    /// The object and the value of the last write request.
    request: Option<(Multiplexer, u32)>,
}

impl Mappings {
    /// Returns whether a mapping has its default, given as the values from sub-index 0 on.
    pub(super) fn is_default(&self, node: u8, index: u16, default: &[u32]) -> bool {
        let Some(Node { current, .. }) = self.0.get(&node) else { return true };
        (0..).zip(default).all(|(sub, value)| current.get(&(index, sub)).is_none_or(|current| current == value))
    }

    /// Updates the mappings with a frame on the bus.
    #[inline]
    pub(super) fn observe(&mut self, frame: &Frame) {
        if let (Id::Standard(id), [_, 0x00, 0x16 | 0x1A, ..] | [_, 0x10 | 0x11, 0x10, ..] | [0]) =
            (frame.id(), frame.data())
        {
            self.follow(id, frame);
        }
    }

    #[cold]
    fn follow(&mut self, id: StandardId, frame: &Frame) {
        let Some((function, node)) = classify(id) else { return };
        let node = self.0.entry(node.get()).or_default();
        match (function, frame.eight()) {
            (Function::SdoRequest, Some(bytes)) => {
                if let Request::DownloadExpedited { object, data, .. } = Request::parse(bytes) {
                    node.request = Some((object, data));
                }
            }
            (Function::SdoAnswer, Some(bytes)) => match Answer::parse(bytes) {
                Some(Answer::UploadExpedited { object, data, .. }) => node.set(object, data),
                Some(Answer::DownloadDone(Multiplexer { index: SAVE, .. })) => node.stored.clone_from(&node.current),
                Some(Answer::DownloadDone(Multiplexer { index: LOAD, .. })) => node.restores = true,
                Some(Answer::DownloadDone(object)) => {
                    if let Some((_, data)) = node.request.take_if(|(requested, _)| *requested == object) {
                        node.set(object, data);
                    }
                }
                _ => {}
            },
            (Function::Heartbeat, None) => node.boot(),
            _ => {}
        }
    }
}

impl Node {
    fn set(&mut self, Multiplexer { index, sub }: Multiplexer, data: u32) {
        // The number of entries has one byte.
        let value = if sub == 0 { data & 0xFF } else { data };
        self.current.insert((index, sub), value);
    }

    fn boot(&mut self) {
        if std::mem::take(&mut self.restores) {
            self.stored.clear();
        }
        self.current.clone_from(&self.stored);
    }
}
