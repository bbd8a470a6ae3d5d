//! Recordings of every kind of device, each with one changed frame. All changes are reported except those listed below.
//!
//! `REPLAY_MUTATIONS=10000 cargo test --release -p hal-sim --lib mutations -- --nocapture` makes this many changes of
//! each kind, and prints how many were reported. The following changes may pass:
//!
//! - The first frame is dropped, or has another time or identifier. A log has no power-up: the first frame determines
//!   it, or the device was powered up before the log. The summary reports this.
//! - A time changes within the tolerance: loggers are late. A frame moved before the boot-up is reported, because the
//!   device then counts as powered up before the log.
//! - Equal frames within the tolerance are swapped: each may be the other frame, logged late.
//! - A position changes to another position that the device reaches within the tolerance: the spool moves while a frame
//!   is late. Where the spool reverses, it may go further: the command may have been late, too.
//! - A heartbeat or an AVEF shows another state that the device has within the tolerance: the command was logged late.
//! - A frame is missing within the tolerance of the end: it may have been sent after the log.

use super::*;

/// The tolerance of the replays, in microseconds.
const TOLERANCE: u64 = 5_000;

/// The number of changes of each kind, unless `REPLAY_MUTATIONS` sets another number.
const FEW: u64 = 25;

/// A position field in the data of a frame: index of the first byte, length, and encoding.
type Carried = (usize, usize, fn(i32, bool) -> i32);

/// A recording of a device.
struct Recording {
    line: String,
    is_hat: bool,
    records: Vec<Record>,
    /// The indices of the device's frames.
    own: Vec<usize>,
    looks: Vec<Look>,
}

impl Recording {
    fn new(line: &str, device: &str, play: impl FnOnce(&mut Session)) -> Self {
        let mut session = Session::new(line);
        play(&mut session);
        let is_own = |place: &usize| &*session.senders[*place] == device;
        let own: Vec<usize> = (0..session.records.len()).filter(is_own).collect();
        let node = session.world.find(device).unwrap();
        let looks = session.looks.into_iter().filter(|look| look.node == node).collect();
        let is_hat = device.starts_with("hat");
        Self { line: line.to_owned(), is_hat, records: session.records, own, looks }
    }

    fn frame(&self, place: usize) -> (u64, Frame) {
        let Record { at, entry: Entry::Frame(frame) } = self.records[place] else { unreachable!() };
        (at.as_micros(), frame)
    }

    /// Returns whether a frame is equivalent to the frame that it replaces, within the tolerance of both times.
    fn alike(&self, (at, frame): (u64, Frame), (other_at, other): (u64, Frame)) -> bool {
        // The tolerance, plus the maximum time for which a frame waits for the bus.
        const AROUND: u64 = TOLERANCE + 2_500;
        if frame == other {
            return true;
        }
        let (carried, state) = (carried(&other), state(&other));
        if carried.is_empty() && state == 0
            || frame.id() != other.id()
            || frame.len() != other.len()
            || frame.is_remote()
        {
            return false;
        }
        let around = at.max(other_at) - AROUND..=at.min(other_at) + AROUND;
        let near = || self.looks.iter().filter(|look| around.contains(&look.at.as_micros()));
        // Every state near the frame, in the place of its own.
        let states = near().map(|look| u64::from(look.state).unbounded_shl(state.trailing_zeros()) & state);
        let states: BTreeSet<u64> = states.filter(|code| other.len() != 1 || *code != 0).collect();
        let told = |position: i32, floats: bool| {
            let mut data = *other.bytes();
            for (at, len, tell) in &carried {
                data[*at..at + len].copy_from_slice(&tell(position, floats).to_le_bytes()[..*len]);
            }
            let others = u64::from_le_bytes(data) & !state;
            states.iter().any(|code| other.refilled((others | code).to_le_bytes()) == frame)
        };
        let way: Vec<i32> = near().map(|look| look.position).collect();
        // Between two samples, the position changes by at most the fastest step. A movement that reverses may also go
        // further, by the distance that it covers twice.
        let steps: Vec<i32> = way.windows(2).map(|pair| around_turn(pair[1] - pair[0], self.is_hat)).collect();
        let sum = |sign: i32| steps.iter().map(|step| (step * sign).max(0)).sum::<i32>();
        let step = steps.iter().map(|step| step.abs()).max().unwrap_or_default() + sum(1).min(sum(-1));
        way.iter().any(|at| (at - step..=at + step).any(|at| told(if self.is_hat { at & 0x3FFF } else { at }, false)))
            || near().any(|look| look.floats) && told(16_384, true)
    }

    /// Returns whether each frame of the device is present, in its order and at its time.
    fn is_kept_by(&self, records: &[Record]) -> bool {
        let end = records.iter().map(|record| record.at.as_micros()).max().unwrap();
        let mut keys: Vec<u32> = self.own.iter().map(|place| self.frame(*place).1.key()).collect();
        keys.sort_unstable();
        keys.dedup();
        keys.into_iter().all(|key| {
            let mut logged = records.iter().filter_map(|record| match record.entry {
                Entry::Frame(frame) if frame.key() == key && !frame.is_remote() => Some((record.at.as_micros(), frame)),
                _ => None,
            });
            let sent = self.own.iter().map(|place| self.frame(*place)).filter(|(_, frame)| frame.key() == key);
            let is_paired = sent.into_iter().all(|sent| match logged.next() {
                Some(logged) => logged.0.abs_diff(sent.0) <= TOLERANCE && self.alike(logged, sent),
                None => sent.0 + TOLERANCE + 1000 > end,
            });
            is_paired && logged.next().is_none()
        })
    }
}

/// Returns a shaft's distance in the shorter direction; a spool's distance is unchanged.
fn around_turn(way: i32, is_hat: bool) -> i32 {
    if is_hat { (way + 8192).rem_euclid(16_384) - 8192 } else { way }
}

/// Returns the position fields of a frame, according to the mappings in these recordings.
fn carried(frame: &Frame) -> Vec<Carried> {
    fn on(position: i32, full: i32) -> i32 {
        (position.abs() * full * 2 + 16_384) / 32_768 * position.signum()
    }
    let spool: fn(i32, bool) -> i32 = |at, floats| if floats { 32_767 } else { at };
    let per_127: fn(i32, bool) -> i32 = |at, floats| if floats { 127 } else { on(at, 127) };
    let inverted: fn(i32, bool) -> i32 = |at, floats| if floats { -127 } else { -on(at, 127) };
    let per_1000: fn(i32, bool) -> i32 = |at, floats| if floats { 1000 } else { on(at, 1000) };
    let shaft: fn(i32, bool) -> i32 = |at, _| at;
    let text = frame.to_string();
    match (text.split(':').next().unwrap(), frame.data()) {
        ("1A0", _) => vec![(2, 2, spool)],
        ("1C2", _) => vec![(0, 1, per_127), (1, 1, inverted), (2, 2, per_1000), (6, 2, spool)],
        ("181", _) => vec![(0, 4, shaft)],
        ("1ABCDE01", _) => vec![(2, 4, shaft)],
        ("5A0", [0x4B, 0x01, 0x63, 0x01, ..]) => vec![(4, 2, spool)],
        ("5A0", [0x4F, 0x01, 0x33, 0x00, ..]) => vec![(4, 1, per_127)],
        ("5A0", [0x4F, 0x02, 0x33, 0x00, ..]) => vec![(4, 1, inverted)],
        ("5A0", [0x4B, 0x04, 0x33, 0x00, ..]) => vec![(4, 2, per_1000)],
        ("581", [0x43, 0x04, 0x60, 0x00, ..]) => vec![(4, 4, shaft)],
        ("0CFE1383", _) => vec![(0, 1, |at, _| 125 + on(at, 100).max(0)), (1, 1, |at, _| 125 + on(-at, 100).max(0))],
        _ => vec![],
    }
}

/// Returns the bits of a heartbeat or an AVEF that show a state; 0 for other frames.
fn state(frame: &Frame) -> u64 {
    match frame.to_string().split(':').next().unwrap() {
        "720" | "701" if frame.data() != [0] => 0xFF,
        "0CFE1383" => 0x0F_0000,
        _ => 0,
    }
}

/// A change of a frame of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mutation {
    Byte(usize, u8),
    Bit(usize),
    Dlc(u8),
    Remote,
    Identifier(u32),
    Time(i64),
    WithinTolerance(i64),
    Dropped,
    Duplicated(u64),
}

impl Mutation {
    fn draw(random: &mut fastrand::Rng, frame: &Frame) -> Self {
        let len = usize::from(frame.len());
        loop {
            match random.u8(0..9) {
                0 | 1 if len > 0 => return Self::Byte(random.usize(..len), random.u8(..)),
                2 if len > 0 => return Self::Bit(random.usize(..len * 8)),
                3 => return Self::Dlc(random.u8(..=8)),
                4 if random.u8(..4) == 0 => return Self::Remote,
                4 if frame.is_extended() => return Self::Identifier(frame.key() ^ 1 << random.u32(..29)),
                4 => return Self::Identifier(frame.key() ^ 1 << random.u32(..11)),
                5 => {
                    let most = [8_000, 40_000, 3_000_000][random.usize(..3)];
                    let late = random.i64(TOLERANCE as i64 + 1..most);
                    return Self::Time(if random.bool() { late } else { -late });
                }
                6 => return Self::WithinTolerance(random.i64(-4_500..=4_500)),
                7 => return Self::Dropped,
                8 => return Self::Duplicated(random.u64(0..20_000)),
                _ => {}
            }
        }
    }

    /// Returns the recording with the frame at index `place` changed.
    fn apply(self, records: &[Record], place: usize) -> Vec<Record> {
        let mut records = records.to_vec();
        let Record { at, entry: Entry::Frame(frame) } = records[place] else { unreachable!() };
        let shifted = |by: i64| Timestamp::from_micros(at.as_micros().saturating_add_signed(by));
        let mut data = *frame.bytes();
        let id = frame.id();
        match self {
            Self::Byte(byte, value) => {
                data[byte] = value;
                records[place].entry = Entry::Frame(frame.refilled(data));
            }
            Self::Bit(bit) => {
                data[bit / 8] ^= 1 << (bit % 8);
                records[place].entry = Entry::Frame(frame.refilled(data));
            }
            Self::Dlc(len) => records[place].entry = Entry::Frame(Frame::with_len(id, data, len)),
            Self::Remote => records[place].entry = Entry::Frame(Frame::remote(id, frame.len())),
            Self::Identifier(key) => {
                let id =
                    if frame.is_extended() { extended(key & 0x1FFF_FFFF).into() } else { standard(key as u16).into() };
                records[place].entry = Entry::Frame(Frame::with_len(id, data, frame.len()));
            }
            Self::Time(by) | Self::WithinTolerance(by) => records[place].at = shifted(by),
            Self::Dropped => drop(records.remove(place)),
            Self::Duplicated(later) => records.push(Record { at: shifted(later as i64), ..records[place] }),
        }
        // Sorted by time, as a logger would write them.
        records.sort_by_key(|record| record.at);
        records
    }
}

/// Asserts that a recording contains at least the given number of different frames with each beginning and content.
fn has(recording: &Recording, frames: &[(&str, &str, usize)]) {
    let own: BTreeSet<String> = recording.own.iter().map(|place| recording.frame(*place).1.to_string()).collect();
    for (start, rest, least) in frames {
        let found = own.iter().filter(|frame| frame.starts_with(start) && frame.contains(rest)).count();
        assert!(found >= *least, "{}: {found} of {start}…{rest} in {own:#?}", recording.line);
    }
}

/// Changes a recording in many ways. Asserts that each change is reported unless it may pass.
fn mutate(recording: &Recording) {
    let told_of = |records: &[Record]| {
        let file = log(records, Format::Candump);
        let options = options(&recording.line, &file);
        let outcome = replay(&options).map_err(|error| error.to_string());
        let is_told = outcome.as_ref().map_or(true, |outcome| !outcome.is_as_logged());
        (is_told, outcome.map_or_else(|error| error, |outcome| outcome.report(&options)))
    };
    let (is_told, report) = told_of(&recording.records);
    assert!(!is_told, "{}: {report}", recording.line);
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse().expect("a number"));
    let (count, seed): (u64, u64) = (number("REPLAY_MUTATIONS").unwrap_or(FEW), number("REPLAY_SEED").unwrap_or(1));
    let (mut told, mut power_up, mut tolerated, mut same) = (0, 0, 0, 0);
    for turn in 0..count {
        let mut random = fastrand::Rng::with_seed(seed << 32 | turn);
        let nth = random.usize(..recording.own.len());
        let place = recording.own[nth];
        let (_, frame) = recording.frame(place);
        let mutation = Mutation::draw(&mut random, &frame);
        let records = mutation.apply(&recording.records, place);
        if records == recording.records {
            same += 1;
            continue;
        }
        let is_power_up = nth == 0
            && !matches!(mutation, Mutation::Byte(..) | Mutation::Bit(_) | Mutation::Dlc(_) | Mutation::Duplicated(_));
        let is_kept = recording.is_kept_by(&records);
        let (is_told, report) = told_of(&records);
        let line = &recording.line;
        assert!(
            is_told || is_kept || is_power_up,
            "not told: REPLAY_SEED={seed}, turn {turn}: {line}: {mutation:?} of {frame}, line {}\n{report}",
            place + 1
        );
        // A frame before the boot-up means that the device was powered up before the log.
        let is_before = matches!(mutation, Mutation::WithinTolerance(by)
            if recording.frame(place).0.saturating_add_signed(by) <= recording.frame(recording.own[0]).0);
        let is_harmless = matches!(mutation, Mutation::WithinTolerance(_)) && is_kept && !is_power_up && !is_before;
        assert!(!(is_told && is_harmless), "told in vain: turn {turn}: {line}: {mutation:?} of {frame}\n{report}");
        match (is_told, is_power_up) {
            (true, _) => told += 1,
            (false, true) => power_up += 1,
            (false, false) => tolerated += 1,
        }
    }
    println!(
        "{}: {count} changes, {told} told, {tolerated} within the tolerances, {power_up} of the power-up, {same} of nothing",
        recording.line
    );
}

/// Every kind of SDO, EMCY, heartbeats, the default mapping, and another mapping with a different COB-ID, each while
/// the spool moves. Also float and LSS.
fn valve_on_canopen(kind: &str) {
    let recording = Recording::new(&format!("--device {kind}@0x20"), kind, |session| {
        session
            .send(3, &["620: 40 18 10 01 00 00 00 00", "620: 40 53 60 00 00 00 00 00", "620: 60 00 00 00 00 00 00 00"]);
        session.send(3, &["620: 70 00 00 00 00 00 00 00", "620: 2B 17 10 00 32 00 00 00", "000: 01 20"]);
        session.send(9, &["220: 03 00 00 00", "220: 0B 00 00 00"]);
        let scales =
            ["01 63 01", "01 33 00", "02 33 00", "04 33 00"].map(|object| format!("620: 40 {object} 00 00 00 00"));
        for (scale, set_point) in scales.iter().zip(["00 40", "00 C0"].into_iter().cycle()) {
            session.send(4, &[&format!("220: 0F 00 {set_point}"), scale.as_str()].repeat(6));
        }
        session.send(20, &["220: 0F 00 00 00"; 12]);
        let remap = [
            "620: 23 00 18 01 A0 01 00 80",
            "620: 2F 00 1A 00 00 00 00 00",
            "620: 23 00 1A 01 08 00 01 33",
            "620: 23 00 1A 02 08 00 02 33",
            "620: 23 00 1A 03 10 00 04 33",
            "620: 23 00 1A 04 10 00 41 60",
            "620: 23 00 1A 05 10 01 01 63",
            "620: 2F 00 1A 00 05 00 00 00",
            "620: 23 00 18 01 C2 01 00 00",
        ];
        session.send(3, &remap);
        session.send(6, &["220: 0F 00 00 C0"; 20]);
        session.send(9, &["220: 0F 00 FF 7F"; 50]);
        // No commands: time guarding responds.
        session.send(400, &["620: 40 00 20 00 00 00 00 00"]);
        session.send(30, &["000: 80 20", "7E5: 04 01 00 00 00 00 00 00", "7E5: 5E 00 00 00 00 00 00 00"]);
    });
    let scales = ["4B 01 63 01", "4F 01 33", "4F 02 33", "4B 04 33"].map(|scale| ("5A0:", scale, 4));
    has(&recording, &scales);
    has(&recording, &[("1A0:", "", 15), ("1C2:", "", 20), ("1C2:", "7F 81 E8 03 0F 00 FF 7F", 1)]);
    has(&recording, &[("0A0:", "03 80", 1), ("5A0: 80", "", 1), ("7E4:", "", 1)]);
    mutate(&recording);
}

#[test]
fn pvea_canopen() {
    valve_on_canopen("pvea-canopen");
}

#[test]
fn pveo_canopen() {
    valve_on_canopen("pveo-canopen");
}

/// Claims, flows, faults and their messages, UDS.
fn valve_on_isobus(kind: &str) {
    let recording = Recording::new(&format!("--device {kind}@0x83"), kind, |session| {
        session.send(300, &["18EEFF27: 02 00 20 00 00 82 00 A0"]);
        for command in ["C8 FF 31", "FA FF 32", "64 FF 31", "00 FF 33", "7D FF 32"] {
            session.send(53, &[format!("0CFE3327: {command} FF FF FF FF FF").as_str(); 8]);
        }
        session.send(60, &["18EAFF27: 00 EE 00", "18EA8327: CA FE 00", "18EA8327: CB FE 00"]);
        session.send(60, &["18EA8327: EB FE 00", "1BC783F1: 03 22 F1 8C 55 55 55 55", "18EA8327: CA FE 00"]);
    });
    has(&recording, &[("0CFE1383:", " 7D 31 ", 4), ("0CFE1383: 7D", " 32 ", 2)]);
    // An on/off valve has no float.
    has(&recording, &[("0CFE1383:", " 33 ", if kind == "pvea-isobus" { 2 } else { 0 })]);
    has(&recording, &[("18FECA83:", "", 2), ("18FECB83:", "", 1), ("18E8FF83:", "", 1), ("18EEFF83:", "", 1)]);
    mutate(&recording);
}

#[test]
fn pvea_isobus() {
    valve_on_isobus("pvea-isobus");
}

#[test]
fn pveo_isobus() {
    valve_on_isobus("pveo-isobus");
}

/// A shaft moved by a valve across the end of the turn: reported on SYNC, by a timer under a 29-bit identifier, and by
/// SDO.
fn sensor(kind: &str) {
    let both =
        format!("--device {kind}@1,bit-rate=250k --device pvea-canopen@0x20 --link pvea-canopen={kind},rate=9000");
    let recording = Recording::new(&both, kind, |session| {
        session
            .send(3, &["601: 2B 17 10 00 32 00 00 00", "601: 40 08 10 00 00 00 00 00", "601: 40 00 20 00 00 00 00 00"]);
        // The preset is near the end of the turn.
        session
            .send(3, &["601: 23 03 60 00 80 3E 00 00", "601: 2F 00 18 02 01 00 00 00", "601: 23 00 18 01 81 01 00 00"]);
        session.send(3, &["000: 01 00", "220: 03 00 00 00", "220: 0B 00 00 00"]);
        session.send(7, &["220: 0F 00 00 40", "080:", "601: 40 04 60 00 00 00 00 00"].repeat(12));
        let remap = [
            "601: 23 00 18 01 81 01 00 80",
            "601: 2F 00 1A 00 00 00 00 00",
            "601: 23 00 1A 01 10 00 03 65",
            "601: 23 00 1A 02 20 00 04 60",
            "601: 2F 00 1A 00 02 00 00 00",
            "601: 2F 00 18 02 FE 00 00 00",
            "601: 2B 00 18 05 07 00 00 00",
            "601: 23 00 18 01 01 DE BC 3A",
        ];
        session.send(3, &remap);
        session.send(16, &["220: 0F 00 00 C0"; 20]);
        session.send(30, &["601: 2B 00 18 05 00 00 00 00", "080:"]);
    });
    has(
        &recording,
        &[("181:", "3F 00 00", 2), ("181:", "00 00 00", 2), ("581: 43 04 60 00", "", 8), ("581: 80", "", 1)],
    );
    has(&recording, &[("1ABCDE01: 00 00", "", 30)]);
    mutate(&recording);
}

#[test]
fn hat1000() {
    sensor("hat1000");
}

#[test]
fn hat3000() {
    sensor("hat3000");
}
