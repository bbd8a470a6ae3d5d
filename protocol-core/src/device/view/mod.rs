//! The view of a device for people and tools: plain data of one type for all products.
//!
//! [`Viewable`] is not part of [`Device`](super::Device), so that an image without a display does not contain the
//! views.

mod hat;

use heapless::Vec;

use super::pve::DeviceState;
use crate::actuator::{Fault, Led, SetPoint, Valve};
use crate::controller::BitRate;
use crate::time::Instant;
use crate::wire::nmt;
use crate::wire::pdo_mapping::MappingEntry;
use crate::wire::valve::State as ValveState;

/// The maximum number of faults that a kind of device has.
pub const FAULTS: usize = Fault::ALL.len();

/// The state of a device at one moment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct View {
    /// The node ID in force; on ISOBUS the address.
    pub node_id: Option<u8>,
    /// The bit rate in force.
    pub bit_rate: BitRate,
    /// The NMT state; `None` on ISOBUS.
    pub nmt: Option<nmt::State>,
    /// The position of the spool, −16384 … 16384. For an encoder, the value of object 0x6004.
    pub position: i16,
    /// The state of a valve; `None` for another product.
    pub valve: Option<ValveView>,
    /// All faults that the kind has, in the order of [`Kind::fault_names`](super::Kind::fault_names).
    pub faults: Vec<FaultView, FAULTS>,
}

/// The state of a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValveView {
    /// The state of the device state machine; `None` on ISOBUS.
    pub dsm: Option<DeviceState>,
    /// The state of the auxiliary valve in AVEF: blocked during a shutdown. `None` on CANopen.
    pub command: Option<ValveState>,
    /// The set-point. On CANopen it is the last accepted set-point, object 0x6300. On ISOBUS it is the set-point of
    /// `command`, neutral unless the state is extend, retract or float.
    pub set_point: SetPoint,
    /// Whether the solenoids are energised.
    pub solenoids: bool,
    /// The LED.
    pub led: Led,
}

/// The state of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultView {
    /// The name of the fault, which all interfaces use.
    pub name: &'static str,
    /// Whether the fault is active.
    pub active: bool,
    /// The occurrence counter of a valve, 0–127. For an angle sensor, the number of entries in 0x1003.
    pub count: u8,
}

/// A device that has a [`View`].
pub trait Viewable {
    /// Returns the view at `now`. `now` must not be earlier than the time of the previous call to the device.
    fn view(&self, now: Instant) -> View;

    /// Returns the [key](crate::frame::Frame::key) of TPDO 1 and its mapped objects. Returns `None` while the TPDO is
    /// off, and on ISOBUS.
    fn tpdo(&self) -> Option<(u32, &[MappingEntry])> {
        None
    }

    /// Returns whether LSS is changing the bit rate. The device is silent from activate bit timing to the end of the
    /// second delay (SPEC 4.4, CiA 305).
    fn is_switching_bit_rate(&self) -> bool {
        false
    }

    /// Returns the protocol-independent valve; `None` for another product.
    fn valve(&self) -> Option<&Valve> {
        None
    }
}
