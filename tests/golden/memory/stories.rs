//! How the state files came to be: what their devices were told.

/// A story of a device that had no file.
pub(crate) struct Story {
    pub(crate) name: &'static str,
    /// Whether it has no node ID in the beginning.
    pub(crate) blank: bool,
    pub(crate) lines: Vec<String>,
}

/// How often parameters are saved, or an address is stored: both sectors have been in use.
const SAVES: u32 = 260;
const ADDRESSES: u32 = 900;

/// Two low supplies and one high temperature; and the fault log is written.
const FAULTS: &[&str] = &[
    r#"plant {"supply_mv": 8000}"#,
    "advance 2100",
    r#"plant {"supply_mv": 24000}"#,
    "advance 100",
    r#"plant {"supply_mv": 8000}"#,
    "advance 2100",
    r#"plant {"supply_mv": 24000, "temperature_c": 130}"#,
    "advance 2100",
    r#"plant {"temperature_c": 25}"#,
    "advance 11000",
];

/// A power cut, after which the bus has the stored bit rate.
const START_AT_125K: &[&str] = &[r#"power {"on": false}"#, "rate 125000", r#"power {"on": true}"#, "advance 100"];

/// LSS: node ID 0x2A, 125 kbit/s, stored.
const LSS: &[&str] = &[
    "send 7E5#0401000000000000",
    "ask 7E5#112A000000000000 7E4",
    "ask 7E5#1300040000000000 7E4",
    "ask 7E5#1700000000000000 7E4",
];

/// Every parameter of a valve at 0x2A other than it was, and saved.
const VALVE_PARAMETERS: &[&str] = &[
    "ask 62A#2305100082000000 5AA",
    "ask 62A#2B171000E8030000 5AA",
    "ask 62A#23281001A1000000 5AA",
    "ask 62A#2300140100000080 5AA",
    "ask 62A#2F00160000000000 5AA",
    "ask 62A#2300160110004060 5AA",
    "ask 62A#2300160210000333 5AA",
    "ask 62A#2F00160002000000 5AA",
    "ask 62A#230014012B020000 5AA",
    "ask 62A#2300180100000080 5AA",
    "ask 62A#2F00180205000000 5AA",
    "ask 62A#2F001A0000000000 5AA",
    "ask 62A#23001A0110000433 5AA",
    "ask 62A#2F001A0001000000 5AA",
    "ask 62A#23001801AB010000 5AA",
    "ask 62A#23536000424F4F4D 5AA",
    "ask 62A#2310100173617665 5AA",
];

/// The same of an angle sensor, with a preset.
const SENSOR_PARAMETERS: &[&str] = &[
    r#"plant {"angle_cdeg": 9000}"#,
    "ask 62A#2305100082000000 5AA",
    "ask 62A#2B171000E8030000 5AA",
    "ask 62A#2F29100101000000 5AA",
    "ask 62A#2F29100202000000 5AA",
    "ask 62A#2B00180364000000 5AA",
    "ask 62A#2B001805FA000000 5AA",
    "ask 62A#2F00180203000000 5AA",
    "ask 62A#2F001A0000000000 5AA",
    "ask 62A#23001A0110000365 5AA",
    "ask 62A#23001A0220000460 5AA",
    "ask 62A#2F001A0002000000 5AA",
    "ask 62A#23001801AB010000 5AA",
    "ask 62A#23801F000C000000 5AA",
    "ask 62A#23036000D2040000 5AA",
    "ask 62A#2310100173617665 5AA",
];

/// UDS: the address of a valve on ISOBUS.
pub(crate) fn address(from: u32, to: u32) -> String {
    format!("ask {:08X}#042E1001{to:02X} 1BC408F1", 0x1BC7_8800 | from)
}

/// The stories of a kind, from the shortest to the longest.
pub(crate) fn of(kind: &str) -> Vec<Story> {
    let story = |name, parts: &[&[&str]]| Story {
        name,
        blank: false,
        lines: parts.concat().into_iter().map(str::to_owned).collect(),
    };
    let new = story("new", &[&["advance 2000"]]);
    let blank = Story { blank: true, ..story("blank", &[&["advance 2000"]]) };
    let load = &["ask 62A#231110016C6F6164 5AA"][..];
    if kind.ends_with("isobus") {
        let power = &[r#"power {"on": false}"#, r#"power {"on": true}"#, "advance 400"][..];
        let moved = address(0x80, 0x85);
        let set = story("set", &[&["advance 400", &moved], power, FAULTS]);
        let mut full = story("full", &[&["advance 400", &moved], power, FAULTS]);
        let to = |number: u32| if number == ADDRESSES { 0x8C } else { 0x81 + number % 15 };
        full.lines.extend((1..=ADDRESSES).map(|number| address(0x85, to(number))));
        return vec![new, set, full];
    }
    let (parameters, faults) =
        if kind.starts_with("hat") { (SENSOR_PARAMETERS, &[][..]) } else { (VALVE_PARAMETERS, FAULTS) };
    let begin: &[&[&str]] = &[&["advance 100"], LSS, START_AT_125K, parameters, faults];
    let set = story("set", begin);
    let restored = story("load", &[begin, &[load]].concat());
    let mut full = story("full", begin);
    for number in 1..=SAVES {
        let [low, high] = (number as u16 * 10).to_le_bytes();
        full.lines.push(format!("ask 62A#2B171000{low:02X}{high:02X}0000 5AA"));
        full.lines.push("ask 62A#2310100173617665 5AA".to_owned());
    }
    vec![blank, new, set, restored, full]
}
