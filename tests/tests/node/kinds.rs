//! The kinds of CANopen node, and their figures where the manuals differ.

use protocol_core::controller::BitRate::{self, Kbit10, Kbit20, Kbit50, Kbit125, Kbit250, Kbit500, Kbit800, Kbit1000};
use protocol_core::device::{self, Setup, hat, pve};
use tests::{Rig, lss, nmt};

/// A kind of node, with its figures.
pub(super) struct Kind {
    pub(super) setup: Setup,
    /// The node ID of a new one.
    pub(super) node_id: u8,
    /// Vendor, product code, revision, serial number.
    pub(super) identity: [u32; 4],
    /// The bit rate of a new one.
    pub(super) bit_rate: BitRate,
    /// The bit rates, with their index in LSS.
    pub(super) bit_rates: &'static [(u8, BitRate)],
    pub(super) rules: &'static Rules,
}

/// What the kinds of one product have in common.
pub(super) struct Rules {
    /// A reset EMCY follows the boot-up.
    pub(super) reset_emcy: bool,
    /// The heartbeat runs at the next multiple of this.
    pub(super) heartbeat_step_ms: u64,
    /// The longest time of the heartbeat.
    pub(super) heartbeat_max_ms: u32,
    /// The EMCY of an internal fault of a node without another, and its entry in 0x1003.
    pub(super) internal_fault: (&'static str, u32),
    /// What "configure node ID" refuses with.
    pub(super) refused_node_id: &'static str,
    /// "Configure node ID" takes 255, which takes the node ID away.
    pub(super) node_id_can_go: bool,
    /// What a store is answered with when the memory fails, and the EMCY that tells it.
    pub(super) store_failed: (&'static str, Option<&'static str>),
    /// NMT start drops what LSS has pending.
    pub(super) start_drops_what_is_pending: bool,
    /// What puts a pending node ID into force.
    pub(super) into_force: &'static [&'static str],
    /// The LSS state in which fast scan is answered.
    pub(super) scanned_in: &'static str,
    /// LSS services that waiting allows beside switch selective, of a node without a node ID.
    pub(super) answered_in_waiting: &'static [&'static str],
    /// A full match of fast scan enters configuration.
    pub(super) scan_selects: bool,
}

/// SPEC 3, 4.
const VALVE: Rules = Rules {
    reset_emcy: true,
    heartbeat_step_ms: 10,
    heartbeat_max_ms: 0x7FFF,
    internal_fault: ("00 10 01 01 00 00 00 00", 0x0001_1000),
    refused_node_id: "11 01",
    node_id_can_go: false,
    store_failed: ("17 02", Some("00 10 01 01 00 00 00 00")),
    start_drops_what_is_pending: true,
    into_force: &[lss::TO_WAITING, nmt::RESET_COMMUNICATION],
    scanned_in: lss::TO_CONFIGURATION,
    answered_in_waiting: &[],
    scan_selects: false,
};
const VALVE_BIT_RATES: [(u8, BitRate); 3] = [(2, Kbit500), (3, Kbit250), (4, Kbit125)];

/// SPEC 9.
const SENSOR: Rules = Rules {
    reset_emcy: false,
    heartbeat_step_ms: 1,
    heartbeat_max_ms: 0xFFFF,
    internal_fault: ("00 FF 81 02 00 00 00 00", 0x0002_FF00),
    refused_node_id: "11 FF",
    node_id_can_go: true,
    store_failed: ("17 FF", None),
    start_drops_what_is_pending: false,
    into_force: &[nmt::RESET_COMMUNICATION],
    scanned_in: lss::TO_WAITING,
    answered_in_waiting: &["4C", "51 00 00 00 00 80"],
    scan_selects: true,
};
const SENSOR_BIT_RATES: [(u8, BitRate); 8] =
    [(0, Kbit1000), (1, Kbit800), (2, Kbit500), (3, Kbit250), (4, Kbit125), (6, Kbit50), (7, Kbit20), (8, Kbit10)];

fn valve(kind: pve::Kind) -> Kind {
    Kind {
        setup: Setup::new(kind.into()),
        node_id: 0x20,
        identity: [0x0100_0019, 0x5336_0000, 0x0001_0020, 0x5B2E_0100],
        bit_rate: Kbit250,
        bit_rates: &VALVE_BIT_RATES,
        rules: &VALVE,
    }
}

fn sensor(kind: hat::Kind, product_code: u32) -> Kind {
    Kind {
        setup: Setup::new(kind.into()),
        node_id: 1,
        identity: [0xDA, product_code, 0x0001_0007, 1],
        bit_rate: Kbit500,
        bit_rates: &SENSOR_BIT_RATES,
        rules: &SENSOR,
    }
}

pub(super) fn kinds() -> [Kind; 4] {
    [
        valve(pve::Kind::PveaCanopen),
        valve(pve::Kind::PveoCanopen),
        sensor(hat::Kind::Hat1000, 925_010),
        sensor(hat::Kind::Hat3000, 925_011),
    ]
}

/// Runs a test of every kind. One that fails is named.
pub(super) fn each_kind(test: impl Fn(&Kind)) {
    struct Named(String);
    impl Drop for Named {
        fn drop(&mut self) {
            if std::thread::panicking() {
                eprintln!("this was {}", self.0);
            }
        }
    }
    for kind in kinds() {
        let _named = Named(kind.setup.kind.to_string());
        test(&kind);
    }
}

impl Kind {
    pub(super) fn is_sensor(&self) -> bool {
        matches!(self.setup.kind, device::Kind::Hat(_))
    }

    /// A new node, booted; its boot-up is taken.
    #[track_caller]
    pub(super) fn booted(&self) -> Rig {
        let mut rig = Rig::power_on(self.setup);
        assert_eq!(rig.take(), self.boot(self.node_id));
        rig
    }

    /// A new node without a node ID.
    pub(super) fn blank(&self) -> Rig {
        self.blank_with_serial(None)
    }

    /// A new node without a node ID, with this serial number.
    pub(super) fn blank_with_serial(&self, serial: Option<u32>) -> Rig {
        let mut rig = Rig::power_on(Setup { node_id: None, serial, ..self.setup });
        rig.expect_nothing();
        rig
    }

    /// A new node in pre-operational and LSS configuration.
    pub(super) fn configuring(&self) -> Rig {
        let mut rig = self.booted();
        rig.exchange(lss::TO_CONFIGURATION, &[]);
        rig
    }

    /// What the boot of a node without an error sends.
    pub(super) fn boot(&self, node_id: u8) -> Vec<String> {
        let reset_emcy = self.rules.reset_emcy.then(|| emcy(node_id, "00 00 00 00 00 00 00 00"));
        [nmt::boot_up(node_id)].into_iter().chain(reset_emcy).collect()
    }

    /// The order makes the node boot under this node ID.
    #[track_caller]
    pub(super) fn boots(&self, rig: &mut Rig, order: &str, node_id: u8) {
        rig.send(order);
        assert_eq!(rig.take(), self.boot(node_id), "after {order}");
    }

    /// A power cycle makes the node boot under this node ID.
    #[track_caller]
    pub(super) fn starts(&self, rig: &mut Rig, node_id: u8) {
        rig.power_cycle();
        assert_eq!(rig.take(), self.boot(node_id), "after a power cycle");
    }

    /// The parts of the identity as they lie in frames.
    pub(super) fn identity_bytes(&self) -> [String; 4] {
        self.identity.map(|number| number.to_le_bytes().map(|byte| format!("{byte:02X}")).join(" "))
    }
}

/// An EMCY of a node.
pub(super) fn emcy(node_id: u8, data: &str) -> String {
    format!("{:03X}: {data}", 0x080 + u16::from(node_id))
}
