//! What the sectors of the memory hold after the stories of the golden files, and what a board does that starts with
//! them (CONTRIBUTING.md, "Golden files"). Times are left out: they are the image's.
//!
//! The contents in `tests/golden/board/v1/` were written by the image when that was its layout, and are never written
//! again. `./run --test firmware golden:: -- --ignored` writes those that are missing.

#[path = "../../../golden/memory/dump.rs"]
mod dump;
#[path = "../../../golden/expected.rs"]
mod expected;
#[path = "../../../golden/memory/stories.rs"]
mod stories;

/// As the golden tests of the program have it.
mod program {
    pub(crate) fn root() -> std::path::PathBuf {
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
    }
}

use std::fmt::Write as _;
use std::fs;

use firmware_in_the_loop::board::{Board, NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::flash::{ERASED, SECTOR_SIZE};
use firmware_in_the_loop::rig::ImageRig;
use protocol_core::controller::BitRate;

use super::client::{ImageClient, frame};

/// The layout that the image writes.
const LAYOUT: &str = "v2";
/// The layouts that images before it wrote.
const EARLIER: [&str; 1] = ["v1"];
/// The bytes of the memory.
const SIZE: usize = 2 * SECTOR_SIZE;
const KINDS: [&str; 6] = ["pvea-canopen", "pveo-canopen", "pvea-isobus", "pveo-isobus", "hat1000", "hat3000"];
/// How long a board takes at most to become a device of another kind, in milliseconds: four erases.
const BECOME: u64 = 3000;
/// How long a board has to start, and to answer, in milliseconds.
const START: u64 = 400;

/// Index and sub-index of what the stories change, and of what tells one device from another.
const VALVE: &[(u16, u8)] = &[
    (0x1001, 0),
    (0x1005, 0),
    (0x1014, 0),
    (0x1017, 0),
    (0x1018, 2),
    (0x1018, 4),
    (0x1028, 1),
    (0x1400, 1),
    (0x1600, 0),
    (0x1600, 1),
    (0x1600, 2),
    (0x1800, 1),
    (0x1800, 2),
    (0x1A00, 0),
    (0x1A00, 1),
    (0x2002, 0),
    (0x200F, 0),
    (0x2024, 0),
    (0x6053, 0),
];
const SENSOR: &[(u16, u8)] = &[
    (0x1001, 0),
    (0x1005, 0),
    (0x1014, 0),
    (0x1017, 0),
    (0x1018, 2),
    (0x1018, 4),
    (0x1029, 1),
    (0x1029, 2),
    (0x1800, 1),
    (0x1800, 2),
    (0x1800, 3),
    (0x1800, 5),
    (0x1A00, 0),
    (0x1A00, 1),
    (0x1A00, 2),
    (0x1F80, 0),
    (0x2001, 2),
    (0x2002, 2),
    (0x6003, 0),
    (0x6509, 0),
];

/// A board with this memory, switched on; the bus at the first rate of its kind, or at another one.
fn started(board: &'static Board, memory: &[u8], rate: BitRate) -> ImageClient {
    ImageClient::started(ImageRig::with_memory(board, rate, memory))
}

/// Plays a story on a board whose memory is erased; what its sectors hold then.
fn told(kind: &str, story: &stories::Story) -> Vec<u8> {
    let mut client = started(&NUCLEO_F429ZI, &vec![ERASED; SIZE], BitRate::Kbit250);
    client.wait_ms(START);
    let new = if story.blank { "blank".to_owned() } else { format!("kind {kind}") };
    if story.blank {
        client.obeyed(&format!("kind {kind}"));
        client.wait_ms(BECOME);
    }
    client.obeyed(&new);
    client.rig.set_bit_rate(first_rate(kind));
    client.wait_ms(BECOME);
    client.aside.clear();
    for line in &story.lines {
        act(&mut client, line);
    }
    // The fault log is written within 10 s.
    client.wait_ms(11_000);
    let board = client.rig.board;
    client.rig.boards.power(board, false);
    client.connections().flash.lock().content(SIZE).to_vec()
}

/// Does what a line of a story says.
fn act(client: &mut ImageClient, line: &str) {
    let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
    match word {
        "advance" => client.wait_ms(rest.parse().expect("a number")),
        "send" => client.rig.send(of_candump(rest)),
        "ask" => {
            let (text, answer) = rest.rsplit_once(' ').expect("a frame and an identifier");
            exchange(client, text, answer);
        }
        // {"name": value, …}
        "plant" => {
            for pair in rest.trim_matches(['{', '}']).split(", ") {
                client.obeyed(&pair.replace(['"', ':'], ""));
            }
        }
        "power" if rest.contains("true") => client.rig.power_cycle(),
        "power" => {}
        "rate" => client.rig.set_bit_rate(match rest {
            "125000" => BitRate::Kbit125,
            _ => panic!("no such rate: {line}"),
        }),
        _ => panic!("no such word: {line}"),
    }
}

/// The frame of a text in the notation of candump.
fn of_candump(text: &str) -> protocol_core::frame::Frame {
    let (id, data) = text.split_once('#').expect("a frame");
    let bytes: Vec<&str> = data.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).expect("text")).collect();
    frame(&format!("{id}: {}", bytes.join(" ")))
}

/// Sends a request; the answer under an identifier.
fn exchange(client: &mut ImageClient, request: &str, identifier: &str) -> String {
    client.aside.clear();
    client.rig.send(of_candump(request));
    let head = format!("{identifier}: ");
    loop {
        let frame = client.receive().unwrap_or_else(|| panic!("no answer to {request}")).to_string();
        if let Some(data) = frame.strip_prefix(&head) {
            return data.to_owned();
        }
    }
}

/// The bit rate of a new device.
fn first_rate(kind: &str) -> BitRate {
    if kind.starts_with("hat") { BitRate::Kbit500 } else { BitRate::Kbit250 }
}

/// What a board does that starts with this memory.
fn found(board: &'static Board, kind: &str, memory: &[u8], rate: BitRate) -> String {
    let mut client = started(board, memory, rate);
    let mut text: String = client.listen_ms(START).iter().map(|frame| format!("{frame}\n")).collect();
    let status = client.status();
    for (name, value) in status.iter().take_while(|(name, _)| name != "overruns") {
        let _ = writeln!(text, "{name} {value}");
    }
    let number =
        |name: &str| status.iter().find(|(known, _)| known == name).and_then(|(_, value)| value.parse::<u32>().ok());
    let Some(node) = number("node_id") else { return text };
    if kind.ends_with("isobus") {
        for (request, identifier) in [
            (format!("{:08X}#03221001", 0x1BC7_8800 | node), format!("{:08X}", 0x1BC0_00F1 | node << 11)),
            (format!("{:08X}#0322F18C", 0x1BC7_8800 | node), format!("{:08X}", 0x1BC0_00F1 | node << 11)),
            (format!("18EA{node:02X}27#00EE00"), format!("18EEFF{node:02X}")),
        ] {
            let _ = writeln!(text, "{request} -> {}", exchange(&mut client, &request, &identifier));
        }
        client.send(&format!("18EA{node:02X}27: CB FE 00"));
        client.listen_ms(START).iter().filter(|frame| !frame.to_string().starts_with("0CFE")).for_each(|frame| {
            let _ = writeln!(text, "{frame}");
        });
    } else {
        for (index, sub) in if kind.starts_with("hat") { SENSOR } else { VALVE } {
            let [low, high] = index.to_le_bytes();
            let request = format!("{:03X}#40{low:02X}{high:02X}{sub:02X}00000000", 0x600 + node);
            let answer = exchange(&mut client, &request, &format!("{:03X}", 0x580 + node));
            let _ = writeln!(text, "{index:04X}:{sub} {answer}");
        }
    }
    client.end_without_reset();
    text
}

/// The memory of a kind, as a story left it.
fn written(layout: &str, kind: &str, story: &str) -> Vec<u8> {
    let path = expected::folder().join(format!("board/{layout}/{kind}-{story}.hex"));
    dump::parse(&fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
}

/// The stories of a kind that a board plays: without those of hundreds of stores.
fn stories_of(kind: &str) -> Vec<stories::Story> {
    stories::of(kind).into_iter().filter(|story| story.name != "full").collect()
}

/// What a board makes of the memories of a kind.
fn of_kind(kind: &str) {
    let mut text = String::new();
    let layouts = [LAYOUT].into_iter().chain(EARLIER);
    for (layout, story) in layouts.flat_map(|layout| stories_of(kind).into_iter().map(move |story| (layout, story))) {
        let memory = written(layout, kind, story.name);
        let has_moved = !kind.ends_with("isobus") && matches!(story.name, "set" | "load");
        let rate = if has_moved { BitRate::Kbit125 } else { first_rate(kind) };
        let told = found(&NUCLEO_F429ZI, kind, &memory, rate);
        let _ = write!(text, "== {}, of {layout}\n{told}\n", story.name);
        if story.name == "set" {
            assert_eq!(found(&NUCLEO_F446RE, kind, &memory, rate), told, "both boards read alike");
        }
    }
    expected::check(&format!("board/{kind}.txt"), &text);
}

#[test]
fn pvea_canopen() {
    of_kind("pvea-canopen");
}

#[test]
fn pveo_canopen() {
    of_kind("pveo-canopen");
}

#[test]
fn pvea_isobus() {
    of_kind("pvea-isobus");
}

#[test]
fn pveo_isobus() {
    of_kind("pveo-isobus");
}

#[test]
fn hat1000() {
    of_kind("hat1000");
}

#[test]
fn hat3000() {
    of_kind("hat3000");
}

/// Writes the contents that are missing, and no other.
#[test]
#[ignore = "writes the memory of a new layout"]
fn write_what_is_missing() {
    for kind in KINDS {
        for story in stories_of(kind) {
            let path = expected::folder().join(format!("board/{LAYOUT}/{kind}-{}.hex", story.name));
            if !path.exists() {
                fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
                fs::write(&path, dump::print(&told(kind, &story))).expect("a file");
            }
        }
    }
}
