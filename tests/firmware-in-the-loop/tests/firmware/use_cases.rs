//! The use cases of the manuals (SPEC 8), the files that the host's devices pass, with the image in the place of the
//! first device.

use firmware_in_the_loop::board::{Board, NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::rig::BoardTarget;
use hal_sim::scenario::{Outcome, Scenario};

/// Returns the use case of a name.
pub fn use_case(name: &str) -> Scenario {
    parsed(name, &text(name))
}

fn text(name: &str) -> String {
    let path = format!("{}/../../scenarios/use-case-{name}.toml", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn parsed(name: &str, text: &str) -> Scenario {
    Scenario::parse(text).unwrap_or_else(|error| panic!("use case {name}: {error:?}"))
}

fn played(board: &'static Board, scenario: &Scenario) -> Outcome {
    let mut rig = BoardTarget::new(board, scenario);
    rig.power_up();
    scenario.play(&mut rig)
}

fn passes(board: &'static Board, name: &str) {
    let outcome = played(board, &use_case(name));
    assert!(outcome.is_success(), "{}{}", outcome.trace(), outcome.failures(&format!("use-case-{name}.toml")));
}

macro_rules! use_cases {
    ($($test:ident: $name:literal,)*) => {
        /// The names of all.
        pub const ALL: &[&str] = &[$($name),*];

        $(#[test]
        fn $test() {
            passes(&NUCLEO_F429ZI, $name);
        })*

        mod f446re {
            use super::*;

            $(#[test]
            fn $test() {
                passes(&NUCLEO_F446RE, $name);
            })*
        }
    };
}

use_cases! {
    use_case_1: "1",
    use_case_2: "2",
    use_case_3: "3",
    use_case_4: "4",
    use_case_5: "5",
    use_case_6: "6",
    use_case_hat: "hat",
    use_case_isobus: "isobus",
}

/// Changes the last expected frame of each; the tests of `pve-sim use-case` change all.
#[test]
fn a_changed_byte_turns_a_use_case_red() {
    for name in ALL {
        let mut text = text(name);
        let expected = text.rfind("expect = ").expect("a frame");
        let place = expected + text[expected..].find('#').expect("data") + 1;
        let other = if text.as_bytes()[place] == b'0' { "1" } else { "0" };
        text.replace_range(place..=place, other);
        assert!(!played(&NUCLEO_F429ZI, &parsed(name, &text)).is_success(), "{name}");
    }
}

#[test]
fn no_use_case_is_left_out() {
    let folder = format!("{}/../../scenarios", env!("CARGO_MANIFEST_DIR"));
    let files = std::fs::read_dir(folder).expect("the scenarios").map(|file| file.expect("a file").file_name());
    let mut names: Vec<String> = files
        .filter_map(|file| Some(file.to_str()?.strip_prefix("use-case-")?.strip_suffix(".toml")?.to_owned()))
        .collect();
    names.sort();
    assert_eq!(names, ALL);
}

/// A board shows its frames, not its state.
#[test]
fn what_a_board_cannot_be_asked_for_is_refused() {
    let run = |step: &str| {
        let text = format!("devices = [\"pvea-canopen@0x20\"]\nsteps = [\n{{ expect = \"720#00\" }},\n{step}\n]");
        let outcome = played(&NUCLEO_F429ZI, &Scenario::parse(&text).unwrap_or_else(|error| panic!("{error:?}")));
        assert!(!outcome.is_success(), "{step}");
        (outcome.failures("x.toml"), outcome.trace().to_owned())
    };
    for step in [r#"{ expect = { dsm = "init" } }"#, r#"{ never = { dsm = "active" }, for_ms = 10 }"#] {
        let (told, trace) = run(step);
        assert!(told.contains("x.toml:4: a state of pvea-canopen: "), "{told}");
        assert!(told.contains("the target gives no access to the state; use frames"), "{told}");
        assert_eq!(trace, "", "nothing has happened");
    }
    assert!(run(r#"{ power = { reset = "watchdog" } }"#).0.contains("the watchdog of a board is its own"));
    assert!(run(r#"{ plant = { memory = "damaged" } }"#).0.contains("the memory of a board is its flash"));
}
