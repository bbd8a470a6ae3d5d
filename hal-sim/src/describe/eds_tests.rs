use std::collections::HashSet;

use super::*;

fn sheets() -> impl Iterator<Item = (Kind, String)> {
    Kind::ALL.into_iter().filter_map(|kind| Some((kind, eds(kind)?)))
}

/// Returns the lines of a section, without its header.
fn section<'a>(sheet: &'a str, name: &str) -> Vec<&'a str> {
    let head = format!("[{name}]");
    sheet.lines().skip_while(|line| *line != head).skip(1).take_while(|line| !line.is_empty()).collect()
}

#[test]
fn kinds_on_canopen_have_one() {
    let names: Vec<&str> = sheets().map(|(kind, _)| kind.name()).collect();
    assert_eq!(names, ["pvea-canopen", "pveo-canopen", "hat1000", "hat3000"]);
}

#[test]
fn every_object_of_the_dictionary_is_listed_once_and_described() {
    for (kind, sheet) in sheets() {
        let listed: Vec<&str> = ["MandatoryObjects", "OptionalObjects", "ManufacturerObjects"]
            .into_iter()
            .flat_map(|list| section(&sheet, list).into_iter().skip(1))
            .map(|line| line.split_once("=0x").expect("an index").1)
            .collect();
        let mut indices = HashSet::new();
        describe(kind, |entry, _| {
            let (index, sub) = (format!("{:04X}", entry.object().index), entry.object().sub);
            let own = section(&sheet, &index);
            let row = if own.iter().any(|line| line.starts_with("SubNumber=")) {
                section(&sheet, &format!("{index}sub{sub:X}"))
            } else {
                own
            };
            assert!(row.iter().any(|line| line.starts_with("AccessType=")), "{kind}: {index} {sub}: {row:?}");
            assert!(listed.contains(&&*index), "{kind}: {index}");
            indices.insert(index);
        });
        assert_eq!(indices.len(), listed.len(), "{kind}");
    }
}

/// The name of a row with sub-index 0 combines the names of the object and of the sub-index.
#[test]
fn every_object_and_sub_index_has_a_name_of_its_own() {
    for (kind, sheet) in sheets() {
        let mut objects = HashSet::new();
        for (head, name) in sheet.lines().zip(sheet.lines().skip(1)) {
            let Some(name) = name.strip_prefix("ParameterName=") else { continue };
            assert!(!name.is_empty() && name.trim() == name, "{kind}: {head} {name:?}");
            assert!(head.contains("sub") || objects.insert(name), "{kind}: two objects are called {name}");
        }
        describe(kind, |entry, _| {
            let is_composed = sheet.contains(&format!("[{:04X}sub0]", entry.object().index));
            assert!(!is_composed || entry.object().sub > 0 || entry.name.contains(": "), "{kind}: {}", entry.name);
        });
    }
}

#[test]
fn tools_can_read_every_character() {
    for (kind, sheet) in sheets() {
        assert!(sheet.is_ascii(), "{kind}");
        // Some tools treat the rest of a line after a semicolon as a comment.
        assert!(!sheet.contains(';'), "{kind}");
    }
}

#[test]
fn objects_as_the_page_has_them() {
    let sheet = eds(Kind::from_name("pvea-canopen").expect("a kind")).expect("an EDS");
    let wanted = [
        ("1014", &["ParameterName=COB-ID EMCY", "DefaultValue=$NODEID+0x80", "AccessType=ro", "PDOMapping=0"][..]),
        ("1018", &["ObjectType=9", "SubNumber=5"]),
        ("1018sub0", &["ParameterName=Highest sub-index", "DefaultValue=3"]),
        ("1018sub2", &["DefaultValue=0x53360000"]),
        ("1017", &["LowLimit=0", "HighLimit=32767"]),
        ("1600sub0", &["LowLimit=0", "HighLimit=8"]),
        ("2023", &["LowLimit=0", "HighLimit=127"]),
        ("3303", &["LowLimit=-1000", "HighLimit=1000"]),
        ("6300sub1", &["LowLimit=-16384", "HighLimit=32767"]),
        ("1A00sub2", &["DefaultValue=0x63010110", "AccessType=rw", "DataType=0x0007"]),
        ("6040", &["DataType=0x0006", "AccessType=rww", "PDOMapping=1", "DefaultValue=0"]),
        ("6041", &["AccessType=ro", "PDOMapping=1", "DefaultValue=8"]),
        ("6053", &["DataType=0x0009", "DefaultValue=PVEA-CI S6"]),
        ("DeviceInfo", &["VendorNumber=0x01000019", "OrderCode=11149437", "BaudRate_800=0", "BaudRate_250=1"]),
        ("DummyUsage", &["Dummy0001=1", "Dummy0007=1"]),
    ];
    for (name, lines) in wanted {
        let found = section(&sheet, name);
        for line in lines {
            assert!(found.contains(line), "[{name}] has no {line}: {found:?}");
        }
    }
    for serial_number in ["1018sub4", "6052"] {
        assert!(section(&sheet, serial_number).iter().all(|line| !line.starts_with("DefaultValue")));
    }
}

/// The complete list. All other objects have no range, or the full range of their type.
#[test]
fn limits_are_where_the_page_has_a_range() {
    let valve = [
        "1017: 0 to 32767",
        "1400sub2: 255 to 255",
        "1600sub0: 0 to 8",
        "1A00sub0: 0 to 8",
        "2001: 0 to 127",
        "2002: 0 to 127",
        "200F: 0 to 127",
        "2019: 0 to 127",
        "201D: 0 to 127",
        "2023: 0 to 127",
        "2024: 0 to 127",
        "2040: 0 to 127",
        "3300: -127 to 127",
        "3301: -127 to 127",
        "3302: -127 to 127",
        "3303: -1000 to 1000",
        "3304: -1000 to 1000",
        "6042: 1 to 2",
        "6300sub1: -16384 to 32767",
        "6301sub1: -16384 to 32767",
    ];
    let sensor = [
        "1029sub1: 0 to 2",
        "1029sub2: 0 to 2",
        "1A00sub0: 0 to 8",
        "2001sub2: 1 to 255", // 255 takes the node ID away
        "2002sub2: 0 to 8",
        "6003: 0 to 16383",
        "6004: 0 to 16383",
        "6509: -8192 to 8191",
    ];
    for (kind, sheet) in sheets() {
        let (mut object, mut low, mut found) = ("", "", Vec::new());
        for line in sheet.lines() {
            if let Some(name) = line.strip_prefix('[') {
                object = name.trim_end_matches(']');
            } else if let Some(limit) = line.strip_prefix("LowLimit=") {
                low = limit;
            } else if let Some(high) = line.strip_prefix("HighLimit=") {
                found.push(format!("{object}: {low} to {high}"));
            }
        }
        assert_eq!(found, if kind.name().starts_with("hat") { &sensor[..] } else { &valve }, "{kind}");
    }
}

/// The limits are valid for the data type, and the default is within them.
#[test]
fn limits_are_values_of_the_object() {
    for (kind, _) in sheets() {
        describe(kind, |entry, initial| {
            let Some((low, high)) = entry.limits else { return };
            let object = entry.object();
            let bits = 8 * u32::from(entry.size());
            let (lowest, highest) = match entry.data_type() {
                DataType::I8 | DataType::I16 | DataType::I32 => (-1_i64 << (bits - 1), (1_i64 << (bits - 1)) - 1),
                _ => (0, (1_i64 << bits) - 1),
            };
            let range = i64::from(low)..=i64::from(high);
            assert!(
                range.contains(&i64::from(low)) && lowest <= low.into() && i64::from(high) <= highest,
                "{object:?}"
            );
            if let Initial::Fixed(Value::Number(number)) = initial {
                let default = default(entry.data_type(), Initial::Fixed(Value::Number(number))).expect("a number");
                let default: i64 = default.strip_prefix("0x").map_or_else(
                    || default.parse().expect("decimal"),
                    |hex| i64::from_str_radix(hex, 16).expect("hex"),
                );
                assert!(range.contains(&default), "{object:?}: {default}");
            }
        });
    }
}
