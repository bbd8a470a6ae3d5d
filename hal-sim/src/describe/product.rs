//! The product data in the header of an EDS (SPEC 1).

use crate::Kind;

/// The product data.
pub(super) struct Product {
    /// The manufacturer.
    pub(super) vendor: &'static str,
    /// The manufacturer's product name.
    pub(super) name: &'static str,
    /// The order code.
    pub(super) order_code: u32,
}

impl Product {
    pub(super) const fn of(kind: Kind) -> Self {
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
