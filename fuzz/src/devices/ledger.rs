//! The account of confirmed stores, and of the contents that a start must therefore find (SPEC 4.5, 6 and 9).

use hal_sim::{BitRate, Frame, Kind, Setup};
use protocol_core::device::Protocol;
use protocol_core::frame::{Id, standard};

use super::client::{self, Answer, Object};
use super::objects::{self, default};
use super::rig::Rig;

/// A group of objects that one record stores. A power cut leaves it old or new.
#[derive(Debug)]
struct Group {
    objects: Vec<Object>,
    /// The contents that the next start can find; `None` for any.
    possible: Option<Vec<Stored>>,
}

/// A content that a start finds.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Stored {
    Defaults,
    Values(Vec<Answer>),
}

/// The knowledge of the memory of a device.
#[derive(Debug)]
pub(super) struct Ledger {
    groups: Vec<Group>,
    /// The node IDs or addresses that the next start can find; `None` for any.
    ids: Option<Vec<Option<u8>>>,
    rates: Option<Vec<BitRate>>,
    /// Whether a client may have demanded "load" since the last power-up.
    load_asked: bool,
}

/// The result of a request to store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Stored,
    Refused,
    Nothing,
}

impl From<Option<Result<(), u32>>> for Told {
    fn from(answer: Option<Result<(), u32>>) -> Self {
        match answer {
            Some(Ok(())) => Self::Stored,
            Some(Err(_)) => Self::Refused,
            None => Self::Nothing,
        }
    }
}

/// Records a further possible value, or the only one.
fn note<T>(possible: &mut Option<Vec<T>>, value: T, told: Told) {
    match told {
        Told::Stored => *possible = Some(vec![value]),
        Told::Nothing => {
            if let Some(all) = possible {
                all.push(value);
            }
        }
        Told::Refused => {}
    }
}

impl Ledger {
    /// Creates the account of a memory that the first start fills, or that holds anything.
    pub(super) fn of(setup: Setup, is_new: bool) -> Self {
        let groups = objects::groups(setup.kind).into_iter();
        let groups = groups.map(|objects| Group { objects, possible: Some(vec![Stored::Defaults]) }).collect();
        let (ids, rates) = (Some(vec![setup.node_id]), setup.bit_rate.map(|rate| vec![rate]));
        let mut ledger = Self { groups, ids, rates, load_asked: false };
        if !is_new {
            ledger.forget();
        }
        ledger
    }

    /// Forgets everything, because any content may have been stored, and "load" demanded.
    fn forget(&mut self) {
        self.groups.iter_mut().for_each(|group| group.possible = None);
        (self.ids, self.rates, self.load_asked) = (None, None, true);
    }

    /// Records a power-up, which executes "load".
    pub(super) fn start(&mut self) {
        self.load_asked = false;
    }

    /// Forgets the contents that a frame of another node may change.
    pub(super) fn hear(&mut self, kind: Kind, frame: &Frame) {
        let data = frame.bytes();
        match frame.id() {
            Id::Standard(id) if (0x601..=0x67F).contains(&id.as_raw()) => {
                match u16::from_le_bytes([data[1], data[2]]) {
                    0x1010 | 0x1011 if matches!(data[0] >> 5, 1) => {
                        self.groups.iter_mut().for_each(|group| group.possible = None);
                        self.load_asked |= data[1] == 0x11;
                        if matches!(kind, Kind::Hat(_)) {
                            (self.ids, self.rates) = (None, None);
                        }
                    }
                    0x2001 => self.ids = None,
                    0x2002 => self.rates = None,
                    _ => {}
                }
            }
            Id::Standard(id) if id == standard(0x7E5) => match data[0] {
                0x11 => self.ids = None,
                0x13 => self.rates = None,
                // The request stores what any earlier one has configured.
                0x17 => (self.ids, self.rates) = (None, None),
                _ => {}
            },
            Id::Extended(id) if id.as_raw() >> 22 == 0x6F || id.as_raw() >> 16 & 0xFF == 0xEB => self.ids = None,
            _ => {}
        }
    }

    /// Checks a device after its power-up, by the values of its objects.
    pub(super) fn check(rig: &mut Rig, unit: usize) {
        let id = rig.id(unit);
        let device = &rig.units[unit];
        let rate = rig.world.device(device.node).expect("powered").bit_rate();
        let Ledger { ids, rates, .. } = &device.ledger;
        assert!(ids.as_ref().is_none_or(|ids| ids.contains(&id)), "starts as {id:?} of {ids:?}");
        assert!(rates.as_ref().is_none_or(|rates| rates.contains(&rate)), "starts at {rate:?} of {rates:?}");
        let Some(id) = id.filter(|_| device.kind.protocol() == Protocol::Canopen) else { return };
        let kind = device.kind;
        for number in 0..device.ledger.groups.len() {
            let Group { objects, possible } = &rig.units[unit].ledger.groups[number];
            let (objects, Some(possible)) = (objects.clone(), possible.clone()) else { continue };
            let found = read_all(rig, unit, &objects).expect("an answer");
            let is_default =
                |id| objects.iter().zip(&found).all(|(object, found)| *found == Ok(default(kind, id, *object)));
            let holds = possible.iter().any(|stored| match stored {
                // The defaults of a valve are stored at the start that executes "load", for the node ID of that start.
                Stored::Defaults => is_default(id) || matches!(kind, Kind::Pve(_)) && (1..=0x7F).any(is_default),
                Stored::Values(values) => *values == found,
            });
            assert!(holds, "{objects:04X?} start with {found:02X?} of {possible:02X?}");
        }
    }
}

fn read_all(rig: &mut Rig, unit: usize, objects: &[Object]) -> Option<Vec<Answer>> {
    objects.iter().map(|object| client::read(rig, unit, *object)).collect()
}

/// Forgets everything about two devices with one node ID, because either can have answered a store.
fn forget_all(rig: &mut Rig) {
    rig.units.iter_mut().for_each(|unit| unit.ledger.forget());
}

/// Returns the other devices on the bus, without those that are held bus-off.
fn others(rig: &Rig, unit: usize) -> impl Iterator<Item = usize> {
    let on_bus = move |other: &usize| !rig.world.is_bus_off_forced(rig.units[*other].node);
    (0..rig.units.len()).filter(move |other| *other != unit).filter(on_bus)
}

/// Returns whether another device may answer for this one.
fn has_twin(rig: &Rig, unit: usize) -> bool {
    others(rig, unit).any(|other| rig.id(other) == rig.id(unit))
}

/// Returns whether LSS reaches this device alone.
fn is_alone(rig: &Rig, unit: usize) -> bool {
    others(rig, unit).all(|other| rig.units[other].kind.protocol() != Protocol::Canopen)
}

/// Reads all parameters and stores them with "save". Returns whether the device confirmed it.
pub(super) fn save(rig: &mut Rig, unit: usize) -> bool {
    let count = rig.units[unit].ledger.groups.len();
    let mut values = Vec::new();
    for number in 0..count {
        let objects = rig.units[unit].ledger.groups[number].objects.clone();
        let Some(found) = read_all(rig, unit, &objects) else { return false };
        values.push(Stored::Values(found));
    }
    if values.is_empty() {
        return false;
    }
    let twin = has_twin(rig, unit);
    let mut told = Told::from(client::write(rig, unit, (0x1010, 1), b"save"));
    if twin {
        forget_all(rig);
        return false;
    }
    let ledger = &mut rig.units[unit].ledger;
    let was_told = told == Told::Stored;
    // One of two records may be written, and the other not.
    if told == Told::Refused && count > 1 {
        told = Told::Nothing;
    }
    for (group, values) in ledger.groups.iter_mut().zip(values) {
        note(&mut group.possible, values, told);
        // The "load" of a valve outlives a "save". A reset may have executed it since.
        if ledger.load_asked && was_told && count == 1 {
            note(&mut group.possible, Stored::Defaults, Told::Nothing);
        }
    }
    was_told
}

/// Demands the defaults by "load".
pub(super) fn load(rig: &mut Rig, unit: usize) {
    let twin = has_twin(rig, unit);
    let mut told = Told::from(client::write(rig, unit, (0x1011, 1), b"load"));
    if twin {
        return forget_all(rig);
    }
    let ledger = &mut rig.units[unit].ledger;
    if told == Told::Refused && ledger.groups.len() > 1 {
        told = Told::Nothing;
    }
    ledger.load_asked |= told != Told::Refused;
    for group in &mut ledger.groups {
        note(&mut group.possible, Stored::Defaults, told);
    }
}

/// Stores a node ID and, if given, a bit rate by LSS.
pub(super) fn store_by_lss(rig: &mut Rig, unit: usize, node_id: u8, rate: Option<BitRate>) -> bool {
    let node_id = node_id.clamp(1, 0x7F);
    let mut lss = |request: [u8; 3]| {
        let [command, a, b] = request;
        let frame = Frame::full(standard(0x7E5).into(), [command, a, b, 0, 0, 0, 0, 0]);
        if !is_alone(rig, unit) {
            rig.units.iter_mut().for_each(|unit| unit.ledger.hear(unit.kind, &frame));
        }
        let answers = |answer: &Frame| answer.id() == standard(0x7E4).into() && answer.bytes()[0] == command;
        rig.ask(unit, frame, answers).map(|answer| if answer.bytes()[1] == 0 { Ok(()) } else { Err(0) })
    };
    lss([0x04, 1, 0]);
    let mut asked = lss([0x11, node_id, 0]);
    if let (Some(Ok(())), Some(rate)) = (asked, rate) {
        asked = lss([0x13, 0, rate.table_index()]);
    }
    let told = if asked == Some(Ok(())) { Told::from(lss([0x17, 0, 0])) } else { Told::Nothing };
    let alone = is_alone(rig, unit);
    let ledger = &mut rig.units[unit].ledger;
    if alone {
        note(&mut ledger.ids, Some(node_id), told);
        if let Some(rate) = rate {
            note(&mut ledger.rates, rate, told);
        }
    } else {
        (ledger.ids, ledger.rates) = (None, None);
    }
    told == Told::Stored
}

/// Writes the node ID by UDS.
pub(super) fn write_by_uds(rig: &mut Rig, unit: usize, node_id: u8) {
    let Some(present) = rig.id(unit) else { return };
    let id = |raw| protocol_core::frame::extended(raw).into();
    let request = Frame::of(id(0x1BC7_8800 | u32::from(present)), &[4, 0x2E, 0x10, 0x01, node_id]).expect("five bytes");
    let twin = has_twin(rig, unit);
    let answer = rig.ask(unit, request, |frame| frame.id() == id(0x1BC4_08F1) && frame.bytes()[2] != 0x22);
    let told = match answer.map(|answer| answer.bytes()[1]) {
        Some(0x6E) => Told::Stored,
        Some(_) => Told::Refused,
        None => Told::Nothing,
    };
    if twin {
        forget_all(rig);
    } else {
        note(&mut rig.units[unit].ledger.ids, Some(node_id), told);
    }
}
