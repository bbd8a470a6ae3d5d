//! The groups, the NAME and the address of a valve on ISOBUS (SPEC 1, 5).

use super::super::Setup;
use super::super::records::{Factory, LocalLayer};
use crate::controller::Filter;
use crate::isobus::node::Rules;
use crate::time::Duration;
use crate::wire::j1939_id::{Address, Pgn};
use crate::wire::name::{Fields, Name};
use crate::wire::uds;

/// The rules of the node: AVC is the command, AVEF the report, UDS the other protocol.
pub(super) const RULES: Rules = Rules {
    command: |own| Pgn::avc(own.get()),
    other_protocol: |own| Filter { key: uds::key_to(uds::Address::node(own.get())), mask: uds::ANY_SOURCE },
    report: |own| Pgn::avef(own.get()),
    report_period: Duration::from_millis(100),
};

/// The manufacturer code in the NAME.
const MANUFACTURER: u16 = 57;
/// The function in the NAME: not available.
const FUNCTION: u8 = 255;
/// The vehicle system in the NAME.
const VEHICLE_SYSTEM: u8 = 1;
/// The industry group in the NAME: agricultural and forestry equipment.
const INDUSTRY_GROUP: u8 = 2;

/// Returns the NAME (SPEC 1). With the serial number of the manual it is `01 00 20 07 08 FF 02 20`.
pub(super) fn name(factory: &Factory) -> Name {
    Name::new(&Fields {
        arbitrary_address_capable: false,
        industry_group: INDUSTRY_GROUP,
        vehicle_system_instance: 0,
        vehicle_system: VEHICLE_SYSTEM,
        function: FUNCTION,
        function_instance: factory.function_instance,
        ecu_instance: 0,
        manufacturer_code: MANUFACTURER,
        // `Name::new` keeps the low 21 bits.
        identity_number: factory.identity.serial,
    })
}

/// Returns the address in a local layer or, if it has none, the default address.
pub(super) fn address(setup: &Setup, layer: LocalLayer) -> Address {
    Address::new(layer.node_id.unwrap_or(setup.kind.default_node_id()))
}

#[cfg(test)]
mod tests {
    use super::super::super::Kind;
    use super::*;

    #[test]
    fn the_manuals_name() {
        let name = name(&Factory::new(Kind::PveaIsobus, None));
        assert_eq!(name.to_bytes(), [0x01, 0x00, 0x20, 0x07, 0x08, 0xFF, 0x02, 0x20]);
    }
}
