//! Lines of the console that do not arrive as they were typed: none is obeyed, and each is answered.

use firmware_in_the_loop::board::{NUCLEO_F429ZI, NUCLEO_F446RE};
use firmware_in_the_loop::broken::Break;
use firmware_in_the_loop::part::{Damage, Flag};

use super::client::ImageClient;
use super::f446re::{about_to_erase, begin_erase};

const DAMAGED: &str = "damaged in transmission: send the line again";
const SUPPLY: &str = "supply_mv 24000\n";
/// Turns a `4` into a `5`, of which no text tells that it is wrong.
const ONE_BIT: u8 = 1;
/// Makes the next buffer ready to receive.
const FILLS: [&str; 1] = ["firmware::board::serial::Receiver::fill"];
/// Characters that a buffer of the console holds.
const BUFFER: usize = 64;
/// More lines than the console has room for.
const LINES: usize = 100;
/// Characters that come in a millisecond, at the most.
const CHARACTERS_PER_MS: usize = 12;

/// Types characters, and lets them come. Returns the lines of the answer.
fn answers(client: &mut ImageClient, typed: &str, ms: u64) -> Vec<String> {
    client.printed();
    client.connections().terminal.lock().typed.extend(typed.bytes());
    client.wait_ms(ms);
    client.printed().lines().map(str::to_owned).collect()
}

/// Has the character at a place of what is typed next come damaged.
fn damage(client: &ImageClient, place: usize, damage: Damage) {
    client.connections().terminal.lock().damage = Some((place, damage));
}

/// Some of the lines were obeyed, the others are told to be damaged, and no other line was made of them.
#[track_caller]
fn expect_ok_or_damaged(told: &[String]) {
    assert!(told.iter().any(|answer| answer == DAMAGED), "{told:?}");
    assert!(told.iter().all(|answer| answer == "ok" || answer == DAMAGED), "{told:?}");
    assert!(told.len() <= LINES, "{told:?}");
}

#[track_caller]
fn is_unchanged(mut client: ImageClient) {
    // Of the last line perhaps the end was lost.
    answers(&mut client, "\n", 20);
    assert_eq!(client.status_of("supply_mv"), "24000");
    client.end_without_reset();
}

#[test]
fn a_line_that_comes_during_an_erase_arrives_whole() {
    let mut client = about_to_erase();
    let (_, until) = begin_erase(&mut client);
    assert_eq!(answers(&mut client, "supply_mv 23000\n", 100), Vec::<String>::new(), "the processor stands");
    assert!(client.rig.now() < until, "it still does");
    assert_eq!(answers(&mut client, "", 250), ["ok"]);
    assert_eq!(client.status_of("supply_mv"), "23000");
    client.end_without_reset();
}

#[test]
fn more_lines_than_fit_during_an_erase_are_told_to_be_damaged() {
    let mut client = about_to_erase();
    begin_erase(&mut client);
    expect_ok_or_damaged(&answers(&mut client, &SUPPLY.repeat(LINES), 400));
    is_unchanged(client);
}

#[test]
fn a_damaged_character_spoils_its_line_and_no_other() {
    for board in [&NUCLEO_F429ZI, &NUCLEO_F446RE] {
        let mut client = ImageClient::booted_on(board);
        for flag in [Flag::Noise, Flag::Framing] {
            for place in [SUPPLY.find("24").expect("a value") + 1, SUPPLY.len() - 2] {
                damage(&client, place, Damage { flag, flipped: ONE_BIT });
                assert_eq!(answers(&mut client, SUPPLY, 20), [DAMAGED], "{flag:?} at {place}");
                assert_eq!(client.status_of("supply_mv"), "24000", "{flag:?} at {place}");
            }
        }
        client.end_without_reset();
    }
}

#[test]
fn a_damaged_end_takes_the_next_line_with_it() {
    let mut client = ImageClient::booted();
    damage(&client, SUPPLY.len() - 1, Damage { flag: Flag::Framing, flipped: ONE_BIT });
    assert_eq!(answers(&mut client, SUPPLY, 20), Vec::<String>::new());
    assert_eq!(answers(&mut client, "supply_mv 8500\n", 20), [DAMAGED]);
    assert_eq!(client.status_of("supply_mv"), "24000");
    client.end_without_reset();
}

#[test]
fn a_line_typed_by_hand_with_a_damaged_character_is_not_obeyed() {
    let mut client = ImageClient::booted();
    let value = SUPPLY.find("24").expect("a value") + 1;
    for (place, character) in SUPPLY.char_indices() {
        if place == value {
            damage(&client, 0, Damage { flag: Flag::Noise, flipped: ONE_BIT });
        }
        let expected: &[&str] = if character == '\n' { &[DAMAGED] } else { &[] };
        assert_eq!(answers(&mut client, &character.to_string(), 10), expected, "{character:?}");
    }
    assert_eq!(client.status_of("supply_mv"), "24000");
    client.end_without_reset();
}

/// The console's task is held up between two buffers, as by the device's task: nothing is in the next one when the loss
/// is known.
#[test]
fn characters_lost_between_two_buffers_spoil_their_line() {
    let mut client = ImageClient::booted();
    let held = Break::Hang.apply(client.machine(), &FILLS);
    answers(&mut client, "supply_mv 240", 10);
    answers(&mut client, "00", 10);
    held.mend(client.machine());
    // The emulator looks at the mended instruction after the next interrupt.
    client.wait_ms(200);
    assert_eq!(answers(&mut client, "\n", 20), [DAMAGED]);
    assert_eq!(client.status_of("supply_mv"), "24000");
    client.end_without_reset();
}

/// While the console prints the help, it takes no line: a buffer that was full with "help" is followed by another one.
#[test]
fn what_fits_while_it_prints_is_obeyed_and_a_character_more_damages_its_line() {
    let mut client = ImageClient::booted();
    let help = client.obeyed("help").len();
    let fits = format!("help\n{}   lever off\nsupply_mv 2400", SUPPLY.repeat(6));
    assert_eq!(fits.len(), 2 * BUFFER);
    for (more, answer, supply_mv) in [("", "ok", "2400"), ("0", DAMAGED, "24000")] {
        let told = answers(&mut client, &format!("{fits}{more}"), 200);
        assert_eq!(told[help..], ["ok", "ok", "ok", "ok", answer, answer, answer, answer], "with {more:?}");
        assert_eq!(answers(&mut client, "\n", 20), [answer], "with {more:?}");
        assert_eq!(client.status_of("supply_mv"), supply_mv, "with {more:?}");
    }
    client.end_without_reset();
}

/// The same, as far as there is room.
#[test]
fn more_lines_than_fit_while_it_prints_are_told_to_be_damaged() {
    let mut client = ImageClient::booted();
    let help = client.obeyed("help").len();
    let typed = format!("help\n{}", SUPPLY.repeat(LINES));
    let told = answers(&mut client, &typed, (typed.len() / CHARACTERS_PER_MS + 200) as u64);
    assert_eq!(told[help], "ok");
    expect_ok_or_damaged(&told[help + 1..]);
    is_unchanged(client);
}
