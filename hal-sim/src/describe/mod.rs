//! Product descriptions for other tools: an EDS for CANopen masters, a DBC for ISOBUS analysers.
//!
//! ```text
//! eds     an electronic data sheet (CiA 306)
//! dbc     a CAN database                             layout    the messages and signals of the database
//! ```

mod dbc;
mod eds;
mod layout;

pub use dbc::dbc;
pub use eds::eds;

use crate::Kind;

/// The product data in the header of a description (SPEC 1).
struct Product {
    vendor: &'static str,
    name: &'static str,
    order_code: u32,
}

impl Product {
    const fn of(kind: Kind) -> Self {
        use protocol_core::actuator::ActuatorType::{OnOff, Proportional};
        match kind {
            Kind::Pve(kind) => Self {
                vendor: "Danfoss",
                name: match kind.actuator_type() {
                    Proportional => "PVEA-CI Series 6",
                    OnOff => "PVEO-CI Series 6",
                },
                order_code: kind.part_number(),
            },
            Kind::Hat(kind) => {
                Self { vendor: "HYDAC Electronic", name: kind.device_name(), order_code: kind.product_code() }
            }
        }
    }
}
