//! The expected answers, as files beside this one.
//!
//! `RENEW_GOLDEN=1 cargo test --test golden` writes those that differ. A test that has written one fails: a renewal is
//! never green, and what it wrote is in `git diff`.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use super::program::root;

/// The variable that has differing files written anew.
const RENEW: &str = "RENEW_GOLDEN";
/// The lines that are shown before the first one that differs, and from it on.
const CONTEXT: usize = 4;
/// The characters of a long line that are shown before the first one that differs, and from it on.
const WIDTH: usize = 60;

/// The folder of the files.
pub(crate) fn folder() -> PathBuf {
    root().join("tests/golden")
}

/// Compares a text with a file.
#[track_caller]
pub(crate) fn check(name: &str, actual: &str) {
    check_all(&[(name.to_owned(), actual.to_owned())]);
}

/// Compares texts with files, all of them before it fails.
#[track_caller]
pub(crate) fn check_all(texts: &[(String, String)]) {
    let mut told = String::new();
    for (name, actual) in texts {
        let path = folder().join(name);
        // A file that is not there is one that says nothing.
        let expected = fs::read_to_string(&path).unwrap_or_default();
        if expected == *actual {
            continue;
        }
        if std::env::var_os(RENEW).is_some() {
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            fs::write(&path, actual).expect("a file that can be written");
            let _ = writeln!(told, "tests/golden/{name} is renewed: see git diff, then run without {RENEW}");
        } else {
            told += &difference(name, &expected, actual);
        }
    }
    assert!(told.is_empty(), "\n{told}");
}

/// Shows the first difference, with what stands before it.
fn difference(name: &str, expected: &str, actual: &str) -> String {
    let (old, new): (Vec<&str>, Vec<&str>) = (expected.split('\n').collect(), actual.split('\n').collect());
    let first = old.iter().zip(&new).take_while(|(old, new)| old == new).count();
    let mut text = format!("tests/golden/{name}:{}: what is expected (-) and what came (+)\n", first + 1);
    let line = |lines: &[&str]| lines.get(first).copied().unwrap_or_default().to_owned();
    let column = line(&old).chars().zip(line(&new).chars()).take_while(|(old, new)| old == new).count();
    let mut show = |mark: char, lines: &[&str], from: usize, to: usize| {
        for (number, line) in lines.iter().enumerate().take(to).skip(from) {
            let from = if number == first { column.saturating_sub(WIDTH) } else { 0 };
            let part: String = line.chars().skip(from).take(2 * WIDTH).collect();
            let (before, after) = (from > 0, line.chars().count() > from + 2 * WIDTH);
            let _ = writeln!(text, "{mark} {}{part}{}", if before { "…" } else { "" }, if after { "…" } else { "" });
        }
    };
    show(' ', &old, first.saturating_sub(CONTEXT), first);
    // As far as none of them is the same again.
    let differs = |number: &usize| old.get(*number) != new.get(*number);
    let end = first + (first..first + CONTEXT).take_while(differs).count();
    show('-', &old, first, end);
    show('+', &new, first, end);
    let differing = old.iter().zip(&new).filter(|(old, new)| old != new).count() + old.len().abs_diff(new.len());
    let _ = writeln!(text, "{differing} lines differ; meant so: {RENEW}=1 cargo test --test golden\n");
    text
}

#[test]
fn the_first_difference_is_shown_with_what_stands_before_it() {
    let text = difference("x.txt", "a\nb\nc 1 d\ne", "a\nb\nc 2 d\ne");
    assert!(
        text.starts_with("tests/golden/x.txt:3: what is expected (-) and what came (+)\n  a\n  b\n- c 1 d\n+ c 2 d\n"),
        "{text}"
    );
    assert!(text.contains("+ c 2 d\n1 lines differ; "), "{text}");
    let long = |end: &str| format!("{}{end}{}", "x".repeat(1000), "y".repeat(1000));
    let text = difference("x.txt", &long("old"), &long("new"));
    assert!(text.contains(&format!("- …{}old{}…\n", "x".repeat(WIDTH), "y".repeat(WIDTH - 3))), "{text}");
}
