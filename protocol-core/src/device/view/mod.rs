//! The state of a device for people and tools: one view of every product, plain data.
//!
//! [`Viewable`] stands beside [`Device`](super::Device) and is no part of it: an image that shows nothing links none of
//! it.

mod hat;

use heapless::Vec;

use super::pve::DeviceState;
use crate::actuator::{Fault, Led, SetPoint, Valve};
use crate::controller::BitRate;
use crate::time::Instant;
use crate::wire::nmt;
use crate::wire::pdo_mapping::MappingEntry;
use crate::wire::valve::State as ValveState;

/// The most faults that a kind knows.
pub const FAULTS: usize = Fault::ALL.len();

/// The state of a device at one instant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct View {
    /// The node ID, on ISOBUS the address, in force.
    pub node_id: Option<u8>,
    /// The bit rate in force.
    pub bit_rate: BitRate,
    /// The NMT state; `None` on ISOBUS.
    pub nmt: Option<nmt::State>,
    /// The position of the spool, −16384…16384; of an encoder object 0x6004.
    pub position: i16,
    /// The state of a valve; `None` for another product.
    pub valve: Option<ValveView>,
    /// Every fault of the kind, in the order of [`Kind::fault_names`](super::Kind::fault_names).
    pub faults: Vec<FaultView, FAULTS>,
}

/// The state of a valve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ValveView {
    /// The state of the device state machine; `None` on ISOBUS.
    pub dsm: Option<DeviceState>,
    /// The state of the auxiliary valve as AVEF tells it: blocked during a shutdown. `None` on CANopen.
    pub command: Option<ValveState>,
    /// The set-point: on CANopen the last accepted one, object 0x6300; on ISOBUS that of `command`, neutral for a
    /// command without a flow.
    pub set_point: SetPoint,
    /// The solenoids are energised.
    pub solenoids: bool,
    /// The LED.
    pub led: Led,
}

/// The state of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultView {
    /// The name used everywhere.
    pub name: &'static str,
    /// The fault is active.
    pub active: bool,
    /// The occurrence counter of a valve, 0–127; of an angle sensor the number of its entries in 0x1003.
    pub count: u8,
}

/// A device that shows its state.
pub trait Viewable {
    /// Returns the state at `now`, which is before nothing that the device was given.
    fn view(&self, now: Instant) -> View;

    /// Returns the [key](crate::frame::Frame::key) of TPDO 1 and the objects that it maps; `None` while it is off, and
    /// on ISOBUS.
    fn tpdo(&self) -> Option<(u32, &[MappingEntry])> {
        None
    }

    /// Returns whether LSS is changing the bit rate: from activate bit timing to the end of the second delay, in which
    /// the device is silent (SPEC 4.4, CiA 305).
    fn is_switching_bit_rate(&self) -> bool {
        false
    }

    /// Returns the valve behind the protocol; `None` for another product.
    fn valve(&self) -> Option<&Valve> {
        None
    }
}
