//! An angle sensor, from its commissioning to its restored defaults (SPEC 9): the two sequences of the manual's chapter
//! 11.2, SYNC and cyclic transmission, preset, store and restore by group, and a fault.

use protocol_core::controller::BitRate;
use protocol_core::device::hat;

use super::script::Step::{Expect, MasterBitRate, Note, PowerCycle, Send, Steady, Unsteady, Wait};
use super::script::{Device, Step, UseCase};
use crate::Kind;
use crate::world::Plant::{AngleCdeg, InternalFault, MeasuringError};

/// The angle sensor.
pub const HAT: UseCase = UseCase {
    name: "hat",
    title: "an angle sensor: commissioning, transmission, preset, storing, a fault",
    devices: &[Device { kind: Kind::Hat(hat::Kind::Hat1000), node_id: 1, serial: None }],
    steps: STEPS,
};

const ENTER_LSS: Step = Send("7E5: 04 01 00 00 00 00 00 00", "LSS switch state global: configuration");
const LSS_STORE: Step = Send("7E5: 17 00 00 00 00 00 00 00", "LSS store configuration");
const LSS_STORED: Step = Expect("7E4: 17 00 00 00 00 00 00 00", "stored");
const BOOT_12: Step = Expect("70C: 00", "boot-up of node 12");
const START: Step = Send("000: 01 0C", "NMT start, node 12");
const SYNC: Step = Send("080:", "SYNC");
const READ_POSITION: Step = Send("60C: 40 04 60 00 00 00 00 00", "SDO read 0x6004, position");
const READ_OFFSET: Step = Send("60C: 40 09 65 00 00 00 00 00", "SDO read 0x6509, offset");
const READ_TYPE: Step = Send("60C: 40 00 18 02 00 00 00 00", "SDO read 0x1800:2, transmission type");
const TYPE_WRITTEN: Step = Expect("58C: 60 00 18 02 00 00 00 00", "written");
const TYPE_254: Step = Expect("58C: 4F 00 18 02 FE 00 00 00", "254, the default");

const STEPS: &[Step] = &[
    Note("11.2.1 Configuration of the node ID: 12"),
    PowerCycle,
    Expect("701: 00", "boot-up of node 1"),
    ENTER_LSS,
    Send("7E5: 11 0C 00 00 00 00 00 00", "LSS configure node ID 12"),
    Expect("7E4: 11 00 00 00 00 00 00 00", "no error"),
    LSS_STORE,
    LSS_STORED,
    Wait(100),
    PowerCycle,
    BOOT_12,
    Note("11.2.2 Configuration of the bit rate: 125 kbit/s"),
    Send("000: 02 0C", "NMT stop, node 12"),
    ENTER_LSS,
    Send("7E5: 13 00 04 00 00 00 00 00", "LSS configure bit timing: table 0, index 4"),
    Expect("7E4: 13 00 00 00 00 00 00 00", "no error"),
    Send("7E5: 15 F4 01 00 00 00 00 00", "LSS activate bit timing: twice 500 ms"),
    Note("500 ms to the switch, in which the master changes too, and 500 ms of silence"),
    Wait(600),
    MasterBitRate(BitRate::Kbit125),
    Wait(500),
    LSS_STORE,
    LSS_STORED,
    Wait(100),
    PowerCycle,
    BOOT_12,
    Note("Transmission at every SYNC: the PDO is switched on"),
    AT_90_DEGREES,
    Send("60C: 2F 00 18 02 01 00 00 00", "SDO write 0x1800:2 = 1, at every SYNC"),
    TYPE_WRITTEN,
    Send("60C: 23 00 18 01 8C 01 00 00", "SDO write 0x1800:1 = 0x18C, on"),
    Expect("58C: 60 00 18 01 00 00 00 00", "written"),
    START,
    SYNC,
    Expect("18C: 00 10 00 00", "position 4096"),
    SYNC,
    Expect("18C: 00 10 00 00", "position 4096"),
    Note("At every third SYNC"),
    Send("60C: 2F 00 18 02 03 00 00 00", "SDO write 0x1800:2 = 3"),
    TYPE_WRITTEN,
    SYNC,
    Wait(10),
    SYNC,
    Wait(10),
    SYNC,
    Expect("18C: 00 10 00 00", "position 4096"),
    Note("Cyclic transmission, every 10 ms"),
    Send("60C: 2F 00 18 02 FE 00 00 00", "SDO write 0x1800:2 = 254, by the event timer"),
    TYPE_WRITTEN,
    Send("60C: 2B 00 18 05 0A 00 00 00", "SDO write 0x1800:5 = 10 ms"),
    Expect("58C: 60 00 18 05 00 00 00 00", "written"),
    Steady("18C: 00 10 00 00", "position 4096, from now on every 10 ms"),
    Wait(100),
    AT_180_DEGREES,
    Steady("18C: 00 20 00 00", "position 8192"),
    Wait(100),
    Send("60C: 2B 00 18 05 00 00 00 00", "SDO write 0x1800:5 = 0, no more"),
    Expect("58C: 60 00 18 05 00 00 00 00", "written"),
    Wait(20),
    Unsteady,
    Wait(50),
    Note("Preset: here is 0"),
    Send("60C: 23 03 60 00 00 00 00 00", "SDO write 0x6003 = 0"),
    Expect("58C: 60 03 60 00 00 00 00 00", "written"),
    READ_POSITION,
    Expect("58C: 43 04 60 00 00 00 00 00", "position 0"),
    READ_OFFSET,
    Expect("58C: 43 09 65 00 00 E0 FF FF", "offset -8192"),
    Note("Store by group: the application's parameters, not those of the communication"),
    Send("60C: 23 10 10 03 73 61 76 65", "SDO write 0x1010:3 = \"save\""),
    Expect("58C: 60 10 10 03 00 00 00 00", "written: they are stored"),
    Wait(100),
    PowerCycle,
    BOOT_12,
    AT_180_DEGREES,
    Wait(10),
    READ_POSITION,
    Expect("58C: 43 04 60 00 00 00 00 00", "position 0: the preset was stored"),
    READ_TYPE,
    TYPE_254,
    Note("A fault in operational: told, and the sensor goes to pre-operational by itself"),
    START,
    Step::Plant(InternalFault(true)),
    Expect("08C: 00 FF 81 02 00 00 00 00", "EMCY: controller error, error register 0x81"),
    Send("60C: 40 01 10 00 00 00 00 00", "SDO read 0x1001, error register"),
    Expect("58C: 4F 01 10 00 81 00 00 00", "0x81"),
    Send("60C: 40 03 10 01 00 00 00 00", "SDO read 0x1003:1, the last error"),
    Expect("58C: 43 03 10 01 00 FF 02 00", "0xFF00, manufacturer field 2"),
    Step::Plant(InternalFault(false)),
    Expect("08C: 00 00 00 00 00 00 00 00", "EMCY: no error"),
    Note("A measuring error is an alarm, and no EMCY"),
    Step::Plant(MeasuringError(true)),
    Wait(10),
    Send("60C: 40 03 65 00 00 00 00 00", "SDO read 0x6503, alarms"),
    Expect("58C: 4B 03 65 00 01 00 00 00", "position error"),
    Step::Plant(MeasuringError(false)),
    Note("Restore by group: the application's defaults"),
    Send("60C: 23 11 10 03 6C 6F 61 64", "SDO write 0x1011:3 = \"load\""),
    Expect("58C: 60 11 10 03 00 00 00 00", "written: they are restored at the next start"),
    READ_OFFSET,
    Expect("58C: 43 09 65 00 00 E0 FF FF", "offset -8192, still"),
    Wait(100),
    PowerCycle,
    BOOT_12,
    AT_180_DEGREES,
    Wait(10),
    READ_OFFSET,
    Expect("58C: 43 09 65 00 00 00 00 00", "offset 0"),
    READ_POSITION,
    Expect("58C: 43 04 60 00 00 20 00 00", "position 8192"),
    Note("Node ID and bit rate as from the factory"),
    Send("60C: 23 11 10 04 6C 6F 61 64", "SDO write 0x1011:4 = \"load\""),
    Expect("58C: 60 11 10 04 00 00 00 00", "written"),
    Wait(100),
    MasterBitRate(BitRate::Kbit500),
    PowerCycle,
    Expect("701: 00", "boot-up of node 1, at 500 kbit/s"),
];

const AT_90_DEGREES: Step = Step::Plant(AngleCdeg(9_000));
/// Also after a power-up: a board forgets the shaft that its console was told of.
const AT_180_DEGREES: Step = Step::Plant(AngleCdeg(18_000));
