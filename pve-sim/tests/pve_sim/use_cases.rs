//! The use cases check each byte of each frame (SPEC 8): a changed byte turns its use case red.

use std::thread;

use hal_sim::scenario::Scenario;
use pve_sim::use_case::{ALL, UseCase};

/// Returns whether the use case would pass with this text.
fn passes(text: &str) -> bool {
    Scenario::parse(text).is_ok_and(|scenario| scenario.run(1).is_success())
}

/// Returns the expected frames of a line, with their positions in the text.
fn frames(text: &str) -> Vec<(usize, &str)> {
    let mut frames = Vec::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        if let Some(place) = line.find("expect = ").filter(|_| line.starts_with("  {")) {
            let begin = place + "expect = ".len();
            let rest = &line[begin..];
            let end = if rest.starts_with('[') { rest.find(']') } else { rest[1..].find('"').map(|end| end + 2) };
            let value = &rest[..end.expect("a value")];
            let mut at = start + begin;
            for (part, frame) in value.split('"').enumerate() {
                // Every other part is between quotes.
                if part % 2 == 1 {
                    frames.push((at, frame));
                }
                at += frame.len() + 1;
            }
        }
        start += line.len();
    }
    frames
}

/// Returns the text once for each expected frame, with one changed byte: the first one, the second one, and so on in
/// turn. With the change.
fn changed(case: &UseCase) -> Vec<(String, String)> {
    let text = case.text;
    let change = |(number, (start, frame)): (usize, (usize, &str))| {
        let data = frame.find('#').expect("data") + 1;
        let digits: Vec<usize> =
            (data..frame.len()).filter(|place| frame.as_bytes()[*place].is_ascii_hexdigit()).collect();
        let place = start + digits[number % digits.len()];
        let digit = text[place..=place].chars().next().and_then(|digit| digit.to_digit(16)).expect("a digit");
        let mut other = text.to_owned();
        other.replace_range(place..=place, &format!("{:X}", digit ^ 1));
        let line = 1 + text[..start].matches('\n').count();
        (format!("{}:{line}: {frame}, column {}", case.file, place - start), other)
    };
    frames(text).into_iter().enumerate().map(change).collect()
}

#[test]
fn one_wrong_byte_in_any_frame_turns_its_use_case_red() {
    let changed: Vec<(String, String)> = ALL.iter().flat_map(changed).collect();
    assert!(changed.len() > 150, "{}", changed.len());
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let green: Vec<&str> = thread::scope(|scope| {
        let parts = changed.chunks(changed.len().div_ceil(threads));
        let runs: Vec<_> = parts
            .map(|part| {
                scope.spawn(move || part.iter().filter(|(_, text)| passes(text)).map(|(what, _)| &**what).collect())
            })
            .collect();
        runs.into_iter().flat_map(|run| -> Vec<&str> { run.join().expect("no panic") }).collect()
    });
    assert!(green.is_empty(), "{green:#?}");
}

/// A use case that is not strict would accept frames that it does not name; the manual names all.
#[test]
fn every_use_case_is_strict_and_passes() {
    assert_eq!(ALL.iter().map(|case| case.name).collect::<Vec<_>>(), ["1", "2", "3", "4", "5", "6", "isobus", "hat"]);
    for case in ALL {
        assert!(case.text.lines().any(|line| line == "strict = true"), "{}", case.file);
        assert!(passes(case.text), "{}", case.file);
        let frames = frames(case.text).len();
        assert_eq!(frames, case.text.matches('#').count() - other_signs(case.text), "{}: each is found", case.file);
    }
}

/// Returns the number of `#` outside of expected frames: in comments, and in sent frames.
fn other_signs(text: &str) -> usize {
    let comments =
        text.lines().filter(|line| line.starts_with('#') || line.starts_with("  #") || line.contains("  # "));
    comments.count() + text.matches("send = \"").count()
}
