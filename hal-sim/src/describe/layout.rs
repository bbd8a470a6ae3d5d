//! Messages and signals of the valves on ISOBUS (SPEC 5), for the DBC.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use protocol_core::device::pve::{FAULT_CODES, FaultCodes};
use protocol_core::wire::j1939_id::{Address, J1939Id, Pgn, Priority};
use protocol_core::wire::name::COMMANDED_ADDRESS_LEN;
use protocol_core::wire::request::Control;
use protocol_core::wire::valve::State;

use crate::explain;

/// The address of the master in the manual's examples. The valve accepts commands from any address.
pub(super) const MASTER: Address = Address::new(0x27);

pub(super) struct Message {
    pub(super) name: String,
    pub(super) id: J1939Id,
    pub(super) len: usize,
    /// True if the valve sends the message; otherwise the master does.
    pub(super) from_valve: bool,
    /// The period of a cyclic message, in milliseconds.
    pub(super) cycle_ms: Option<u16>,
    pub(super) comment: &'static str,
    pub(super) signals: Vec<Signal>,
}

/// A signal, little-endian and unsigned.
#[derive(Clone)]
pub(super) struct Signal {
    pub(super) name: &'static str,
    /// The multiplexer indicator of the DBC and a blank: `M` for the signal that selects others, `m` and a number for a
    /// signal that this value selects. Empty for a signal that is present in every message.
    pub(super) multiplexer: &'static str,
    /// The index of the first bit, and the number of bits.
    pub(super) bits: (u8, u8),
    pub(super) factor: f64,
    pub(super) offset: f64,
    /// The range of the physical value.
    pub(super) range: RangeInclusive<f64>,
    pub(super) unit: &'static str,
    pub(super) values: Vec<(u32, String)>,
}

impl Signal {
    /// Creates a signal without scaling.
    fn raw(name: &'static str, first: u8, len: u8) -> Self {
        let max = (1_u64 << len) - 1;
        Self {
            name,
            multiplexer: "",
            bits: (first, len),
            factor: 1.0,
            offset: 0.0,
            range: 0.0..=max as f64,
            unit: "",
            values: Vec::new(),
        }
    }

    fn percent(self, factor: f64, offset: f64) -> Self {
        Self { factor, offset, range: 0.0..=100.0, unit: "%", ..self }
    }

    fn values<T: Into<String>>(self, values: impl IntoIterator<Item = (u32, T)>) -> Self {
        Self { values: values.into_iter().map(|(value, text)| (value, text.into())).collect(), ..self }
    }

    fn multiplexed(self, multiplexer: &'static str) -> Self {
        Self { multiplexer, ..self }
    }
}

/// Returns the messages that the valve at an address sends, and the messages that a master sends to this valve.
pub(super) fn messages(valve: Address) -> Vec<Message> {
    let address = valve.get();
    // AVC and AVEF use only the low four bits of the address. All other messages use the whole address.
    let number = address & 0xF;
    let global = |priority, pgn| J1939Id::global(priority, pgn, valve);
    let message = |name: String, id, comment, signals| Message {
        name,
        id,
        len: 8,
        from_valve: true,
        cycle_ms: None,
        comment,
        signals,
    };
    vec![
        Message {
            from_valve: false,
            ..message(
                format!("AVC{number}"),
                J1939Id::global(Priority::CONTROL, Pgn::avc(address), MASTER),
                "Auxiliary valve command, from any address, here 0x27; the flow is used in extend and retract only",
                vec![Signal::raw("PortFlow", 0, 8).percent(0.4, 0.0), state(), fail_safe_mode()],
            )
        },
        Message {
            cycle_ms: Some(100),
            ..message(
                format!("AVEF{number}"),
                global(Priority::CONTROL, Pgn::avef(address)),
                "Auxiliary valve estimated flow",
                vec![
                    Signal::raw("ExtendFlow", 0, 8).percent(1.0, -125.0),
                    Signal::raw("RetractFlow", 8, 8).percent(1.0, -125.0),
                    state(),
                    fail_safe_mode(),
                ],
            )
        },
        message(
            format!("DM1_{address:02X}"),
            global(Priority::DEFAULT, Pgn::DM1),
            "The active fault with the highest priority, on each change and every 1000 ms while a fault is active",
            troubles(),
        ),
        message(
            format!("DM2_{address:02X}"),
            global(Priority::DEFAULT, Pgn::DM2),
            "Previously active faults, on request; several faults need a multi-packet message, whose first 8 bytes these signals describe",
            troubles(),
        ),
        message(
            format!("AddressClaim_{address:02X}"),
            global(Priority::DEFAULT, Pgn::ADDRESS_CLAIMED),
            "Address claim",
            name(),
        ),
        message(
            format!("Acknowledgement_{address:02X}"),
            global(Priority::DEFAULT, Pgn::ACKNOWLEDGEMENT),
            "Response to a request without a dedicated response message",
            vec![
                Signal::raw("Control", 0, 8)
                    .values(Control::ALL.map(|control| (control as u32, explain::control(control)))),
                Signal::raw("Asker", 32, 8),
                group(40),
            ],
        ),
        message(
            format!("TP_CM_{address:02X}_to_all"),
            global(Priority::TRANSPORT, Pgn::TP_CONNECTION),
            "Announces a broadcast message in packets",
            connection(),
        ),
        message(
            format!("TP_CM_{address:02X}"),
            J1939Id::new(Priority::TRANSPORT, Pgn::TP_CONNECTION, MASTER, valve),
            "Refuses a transport connection",
            connection(),
        ),
        message(
            format!("TP_DT_{address:02X}"),
            global(Priority::TRANSPORT, Pgn::TP_DATA),
            "A packet of a broadcast message",
            vec![Signal::raw("Sequence", 0, 8), Signal::raw("Data", 8, 56)],
        ),
        Message {
            len: 3,
            from_valve: false,
            ..message(
                format!("Request_{address:02X}"),
                J1939Id::new(Priority::DEFAULT, Pgn::REQUEST, valve, MASTER),
                "Requests a parameter group; a request for DM3 clears the previously active faults",
                vec![group(0)],
            )
        },
    ]
}

/// Returns the multi-packet message from a master to all valves.
pub(super) fn commanded_address() -> Message {
    let signals = name().into_iter().chain([Signal::raw("NewAddress", 64, 8)]).collect();
    Message {
        name: "CommandedAddress".to_owned(),
        id: J1939Id::global(Priority::DEFAULT, Pgn::COMMANDED_ADDRESS, MASTER),
        len: COMMANDED_ADDRESS_LEN,
        from_valve: false,
        cycle_ms: None,
        comment: "Assigns this address to the valve with this NAME; sent in packets",
        signals,
    }
}

fn state() -> Signal {
    let states = State::ALL.map(|state| (state as u32, explain::valve_state(state)));
    Signal::raw("State", 16, 4).values(states)
}

fn fail_safe_mode() -> Signal {
    Signal::raw("FailSafeMode", 22, 2).values([(0, "blocked"), (1, "float"), (3, "not available")])
}

/// Returns the signal of a lamp (SAE J1939-73).
fn lamp(name: &'static str, first: u8) -> Signal {
    Signal::raw(name, first, 2).values([(0, "off"), (1, "on"), (3, "not available")])
}

/// Returns the signals in the first eight bytes of DM1 and DM2 (SAE J1939-73 5.7.1, SPEC 3). The bits of an SPN are not
/// contiguous.
fn troubles() -> Vec<Signal> {
    vec![
        lamp("ProtectLamp", 0),
        lamp("AmberWarningLamp", 2),
        lamp("RedStopLamp", 4),
        lamp("MalfunctionLamp", 6),
        Signal::raw("FlashLamps", 8, 8).values([(0xFF, "not available")]),
        Signal::raw("SPN", 16, 16).values(spns()),
        Signal::raw("FMI", 32, 5).values(FMIS),
        Signal::raw("SPN_High", 37, 3),
        Signal::raw("OccurrenceCount", 40, 7),
        Signal::raw("ConversionMethod", 47, 1),
    ]
}

/// The failure modes of the valve's faults, in the terms of SAE J1939-73. FMI 0 indicates that there is no fault.
const FMIS: [(u32, &str); 7] = [
    (0, "none"),
    (3, "voltage above normal"),
    (4, "voltage below normal"),
    (7, "mechanical system not responding"),
    (11, "root cause not known"),
    (16, "above normal, moderately severe"),
    (19, "received network data in error"),
];

/// Returns the text for each SPN of the valve: its faults and the complete SPN. The key is the low 16 bits of the SPN.
fn spns() -> BTreeMap<u32, String> {
    let mut spns = BTreeMap::from([(0, "none".to_owned())]);
    for FaultCodes { fault, dtc, .. } in FAULT_CODES {
        let fault = explain::fault(fault);
        spns.entry(dtc.spn() & 0xFFFF)
            .and_modify(|others| *others = format!("{fault}, {others}"))
            .or_insert_with(|| format!("{fault} (SPN {})", dtc.spn()));
    }
    spns
}

/// Returns the signals of a NAME (SAE J1939-81).
fn name() -> Vec<Signal> {
    vec![
        Signal::raw("IdentityNumber", 0, 21),
        Signal::raw("ManufacturerCode", 21, 11),
        Signal::raw("EcuInstance", 32, 3),
        Signal::raw("FunctionInstance", 35, 5),
        Signal::raw("Function", 40, 8),
        Signal::raw("VehicleSystem", 49, 7),
        Signal::raw("VehicleSystemInstance", 56, 4),
        Signal::raw("IndustryGroup", 60, 3).values([
            (0, "global"),
            (1, "on-highway"),
            (2, "agriculture and forestry"),
            (3, "construction"),
            (4, "marine"),
            (5, "industrial"),
        ]),
        Signal::raw("ArbitraryAddressCapable", 63, 1).values([(0, "no"), (1, "yes")]),
    ]
}

/// Returns the signals of a connection management message (SAE J1939-21 5.10.3). The control byte selects the other
/// signals.
fn connection() -> Vec<Signal> {
    let reasons = [(1, "busy"), (2, "resources needed elsewhere"), (3, "timeout")];
    vec![
        Signal::raw("Control", 0, 8).values([(32, "BAM"), (255, "abort")]).multiplexed("M "),
        Signal::raw("Size", 8, 16).multiplexed("m32 "),
        Signal::raw("Packets", 24, 8).multiplexed("m32 "),
        Signal::raw("Reason", 8, 8).values(reasons).multiplexed("m255 "),
        group(40),
    ]
}

/// Returns the signal of a parameter group number.
fn group(first: u8) -> Signal {
    let groups = [
        (Pgn::ADDRESS_CLAIMED, "address claim"),
        (Pgn::DM1, "DM1"),
        (Pgn::DM2, "DM2"),
        (Pgn::DM3, "DM3"),
        (Pgn::COMMANDED_ADDRESS, "commanded address"),
    ];
    Signal::raw("Group", first, 24).values(groups.map(|(pgn, name)| (pgn.raw(), name)))
}
