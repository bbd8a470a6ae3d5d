//! The view of an angle sensor.

use super::{FaultView, View, Viewable};
use crate::device::Device as _;
use crate::device::hat::{Error, Hat};
use crate::time::Instant;
use crate::wire::pdo_mapping::MappingEntry;

impl Viewable for Hat {
    fn view(&self, now: Instant) -> View {
        let application = self.application();
        let fault = |error: Error| {
            let (code, field, _) = error.codes();
            FaultView {
                name: error.name(),
                active: application.objects.errors.has(error),
                count: application.node.times_entered(code, field),
            }
        };
        View {
            node_id: self.node_id(),
            bit_rate: self.bit_rate(),
            nmt: Some(application.node.nmt_state()),
            // The position is below 16384.
            position: i16::try_from(application.objects.position(now)).unwrap_or(i16::MAX),
            valve: None,
            faults: Error::ALL.into_iter().map(fault).collect(),
        }
    }

    fn tpdo(&self) -> Option<(u32, &[MappingEntry])> {
        self.application().node.tpdo()
    }

    fn is_switching_bit_rate(&self) -> bool {
        self.application().node.is_switching_bit_rate()
    }
}

impl Error {
    /// Returns the name of the error, which all interfaces use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SetUp => "set-up",
            Self::Controller => "controller",
            Self::Passive => "error-passive",
            Self::BusOff => "can-bus",
        }
    }
}
