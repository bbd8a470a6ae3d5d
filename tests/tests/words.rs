//! The words of the plant in files that no compiler checks against the table of the core: pages, Python package, panel.

use std::fs;
use std::path::Path;

use protocol_core::device::plant::{Product, Values, WORDS, Word};

/// The words of `memory` that are none on a console.
const DAMAGED: &str = "damaged";

fn file(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns the text between two others.
fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let (_, rest) = text.split_once(from).unwrap_or_else(|| panic!("{from} is missing"));
    rest.split_once(to).unwrap_or_else(|| panic!("{to} is missing")).0
}

/// Returns every text between quotation marks.
fn quoted(text: &str, mark: char) -> Vec<&str> {
    text.split(mark).skip(1).step_by(2).collect()
}

fn names<'a>(words: impl IntoIterator<Item = &'a Word>) -> Vec<&'a str> {
    words.into_iter().map(|word| word.name).collect()
}

fn is_switch(word: &Word) -> bool {
    word.values == Values::Words(&["on", "off"])
}

/// Returns the range of a word with its unit, as text with these signs; empty where there is none.
fn range(word: &Word, to: &str, minus: &str) -> String {
    let unit = match word.values {
        Values::Number { unit, .. } | Values::NumberOrRange { unit, .. } => format!(" {unit}"),
        Values::NumberOrOff { .. } | Values::Words(_) => String::new(),
    };
    let range = word.values.range().map(|(min, max)| format!("{min}{to}{max}{unit}"));
    range.unwrap_or_default().replace('-', minus)
}

/// Returns the cells of the rows of a page, between two texts, that begin with a word in backquotes.
fn rows(page: &str, from: &str, to: &str) -> Vec<Vec<String>> {
    let page = file(page).replace("\\|", "/");
    let rows = between(&page, from, to).lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| row.split('|').map(|cell| cell.trim().to_owned()).skip(1).collect()).collect()
}

/// Returns the words that a board has.
fn of_board() -> impl Iterator<Item = &'static Word> {
    WORDS.iter().filter(|word| !word.simulated)
}

/// Checks the rows of a page: a word each, and the cell of values.
fn check_rows(page: &str, rows: &[Vec<String>], known: &[&Word], values: usize) {
    let words: Vec<&str> = rows.iter().map(|row| row[0].trim_matches('`')).collect();
    assert_eq!(words, names(known.iter().copied()), "{page}");
    for (word, row) in known.iter().zip(rows) {
        let cell = &row[values];
        let range = range(word, "…", "−");
        assert!(cell.starts_with(&range), "{page}: {}: {range} is not what {cell:?} begins with", word.name);
        if range.is_empty() {
            assert!(!cell.contains('…'), "{page}: {}: there is no range as in {cell:?}", word.name);
        }
    }
}

#[test]
fn the_tables_of_the_consoles() {
    let board = rows("docs/board.md", "These words change the plant of the device.", "These words control the board:");
    let mut sim = rows("docs/pve-sim.md", "### Faults by hand", "### From another terminal");
    sim.retain(|row| row[0] != "`status`" && row[0] != "`help`");
    let (board, sim) = ((board, of_board().collect::<Vec<_>>()), (sim, WORDS.iter().collect()));
    for (page, (rows, known), value) in [("docs/board.md", board, 1), ("docs/pve-sim.md", sim, 2)] {
        check_rows(page, &rows, &known, value);
        for (word, row) in known.iter().zip(&rows) {
            let words: &[&str] = match word.values {
                Values::Number { .. } => &[],
                Values::NumberOrRange { .. } => &["5..20"],
                Values::NumberOrOff { .. } => &["off"],
                Values::Words(words) => words,
            };
            assert_eq!(quoted(&row[value], '`'), words, "{page}: {}", word.name);
            let healthy = word.healthy().expect(word.name).to_string();
            assert_eq!(row[value + 1].trim_matches('`'), healthy, "{page}: {}", word.name);
            if value == 2 {
                let product = match word.product {
                    Some(Product::Valve) => "valves",
                    Some(Product::Encoder) => "angle sensors",
                    None => "all",
                };
                assert_eq!(row[1], product, "{page}: {}", word.name);
            }
        }
    }
}

#[test]
fn the_table_of_the_control_interface() {
    let page = "docs/control.md";
    let rows = rows(page, "### Plant", "## Waiting");
    check_rows(page, &rows, &WORDS.iter().collect::<Vec<_>>(), 1);
    for (word, row) in WORDS.iter().zip(&rows) {
        let cell = &row[1];
        let told: Vec<&str> = match word.name {
            "spool" => quoted(cell, '"').into_iter().filter(|told| *told != "fault").collect(),
            "memory" => quoted(cell, '`').into_iter().filter(|told| *told != DAMAGED).collect(),
            _ if is_switch(word) => {
                assert!(cell.starts_with("true, false"), "{page}: {}: {cell:?}", word.name);
                continue;
            }
            _ => continue,
        };
        assert_words(word.name, &told, page);
    }
}

#[test]
fn the_python_package() {
    let (device, state) = (file("python/src/pve_sim/_device.py"), file("python/src/pve_sim/_state.py"));
    for (class, product) in [("Valve", Product::Valve), ("Sensor", Product::Encoder)] {
        let plant = between(&device, &format!("[{class}Change]) ->"), "Raises:").split_whitespace().collect::<Vec<_>>();
        let plant = plant.join(" ");
        let is_name = |text: &&str| text.bytes().all(|byte| byte.is_ascii_lowercase() || byte == b'_');
        let told: Vec<&str> = quoted(&plant, '`').into_iter().filter(is_name).collect();
        assert_eq!(told, names(product.words()), "{class}.plant");
        for word in product.words() {
            let (_, text) = plant.split_once(&format!("`{}`", word.name)).expect(word.name);
            let text = text.split("; `").next().expect("text");
            let range = range(word, " to ", "-");
            assert!(text.contains(&range), "{class}.plant: {}: {range} is missing in {text:?}", word.name);
            if range.is_empty() {
                assert!(!text.contains(" to "), "{class}.plant: {}: there is no range as in {text:?}", word.name);
            }
        }
        let fields = between(&state, &format!("class {class}Plant:"), "@dataclass");
        let fields = fields.lines().filter_map(|line| line.trim_start().split_once(": "));
        let fields: Vec<&str> = fields.map(|(name, _)| name).filter(|name| is_name(name)).collect();
        assert_eq!(fields, names(product.words()), "{class}Plant");
    }
    for (name, word) in [("SpoolFault", "spool"), ("Memory", "memory")] {
        let literal = quoted(between(&state, &format!("\n{name} = Literal["), "]\n"), '"');
        let literal: Vec<&str> = literal.into_iter().filter(|value| *value != DAMAGED).collect();
        assert_words(word, &literal, name);
    }
}

#[test]
fn the_panel() {
    let (plant, words) = (file("pve-sim/panel/plant.js"), file("pve-sim/panel/words.js"));
    let controls = between(&plant, "const CONTROLS = {\n", "\n};");
    let controls: Vec<(&str, &str)> = controls
        .lines()
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.trim().split_once(": "))
        .collect();
    let mut told: Vec<&str> = controls.iter().map(|(name, _)| *name).collect();
    // The panel has the words of a board: slow and weak devices are for tests.
    let mut known = names(of_board());
    told.sort_unstable();
    known.sort_unstable();
    assert_eq!(told, known);
    for (name, control) in controls {
        let word = WORDS.iter().find(|word| word.name == name).expect(name);
        match word.values {
            Values::Number { min, max, unit } | Values::NumberOrRange { min, max, unit } => {
                check_slider(name, control, (min, max), unit);
            }
            Values::NumberOrOff { max, .. } => {
                assert!(words.contains(&format!("export const FULL = {max};")), "{name}")
            }
            Values::Words(_) if is_switch(word) => assert!(control.contains("=> check("), "{name}: {control}"),
            Values::Words(_) => {
                let list = between(&plant, &format!("const {} = [[", name.to_uppercase()), "]];");
                // Each item is a value and its label; a spool without a fault has no word.
                let items = list.split("], [").map(|item| quoted(item, '"')[0]);
                let items: Vec<&str> = items
                    .filter(|value| *value != DAMAGED)
                    .map(|value| if value.is_empty() { "ok" } else { value })
                    .collect();
                assert_words(name, &items, name);
            }
        }
    }
}

/// Checks that a slider shows the unit of its word and nothing beyond its range. Its field reaches up to `limit`.
fn check_slider(name: &str, control: &str, (min, max): (i32, i32), unit: &str) {
    let number = |key: &str| {
        let (_, rest) = control.split_once(&format!(" {key}: "))?;
        rest.split([',', ' ']).next()?.parse::<f64>().ok()
    };
    let size = number("unit").unwrap_or_else(|| panic!("{name} is no slider: {control}"));
    let shown = [("V", 1000.0, "mV"), ("°C", 1.0, "°C"), ("°", 100.0, "1/100 degree"), ("rpm", 1.0, "turns a minute")];
    let is_shown = |(symbol, factor, of): (&str, f64, &str)| {
        factor == size && of == unit && control.contains(&format!("\"{symbol}\""))
    };
    assert!(shown.into_iter().any(is_shown), "{name}: {unit} in {control}");
    let [low, high] = ["min", "max"].map(|key| (number(key).expect(key) * size).round());
    assert!(f64::from(min) <= low && high <= f64::from(max), "{name}: {min} to {max} in {control}");
    if let Some(limit) = number("limit") {
        assert_eq!((limit * size).round(), f64::from(max), "{name}");
    }
}

fn assert_words(name: &str, values: &[&str], place: &str) {
    let word = WORDS.iter().find(|word| word.name == name).expect(name);
    assert!(matches!(word.values, Values::Words(known) if known == values), "{place}: {values:?}, not {}", word.values);
}
