//! The product on ISOBUS: groups, NAME and address (SPEC 1, 5).

use super::super::Setup;
use super::super::records::{Factory, LocalLayer};
use crate::controller::Filter;
use crate::isobus::node::Rules;
use crate::time::Duration;
use crate::wire::j1939_id::{Address, Pgn};
use crate::wire::name::{Fields, Name};
use crate::wire::uds;

/// The rules of the node: commanded by AVC, reports AVEF, answers UDS.
pub(super) const RULES: Rules = Rules {
    command: |own| Pgn::avc(own.get()),
    other_protocol: |own| Filter { key: uds::key_to(uds::Address::node(own.get())), mask: uds::ANY_SOURCE },
    report: |own| Pgn::avef(own.get()),
    report_period: Duration::from_millis(100),
};

/// Manufacturer code in the NAME.
const MANUFACTURER: u16 = 57;
/// Function in the NAME: not available.
const FUNCTION: u8 = 255;
/// Vehicle system in the NAME.
const VEHICLE_SYSTEM: u8 = 1;
/// Industry group in the NAME: agricultural and forestry equipment.
const INDUSTRY_GROUP: u8 = 2;

/// Returns the NAME (SPEC 1); with the manual's serial number it is `01 00 20 07 08 FF 02 20`.
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
        // The NAME holds the low 21 bits.
        identity_number: factory.identity.serial,
    })
}

/// Returns the address of a local layer; without a stored address, the default address.
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
