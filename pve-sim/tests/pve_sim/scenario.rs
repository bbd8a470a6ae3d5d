//! `pve-sim scenario`: the scenarios of the repository and of its guide, exit codes, results for CI, and reproducible
//! runs.

use std::fs;
use std::path::{Path, PathBuf};

use crate::simulator::{output, pve_sim, refusal, spawn};

/// A scenario that passes.
const RIGHT: &str = "devices = [\"pvea-canopen@0x20\"]\nsteps = [{ expect = \"720#00\" }]\n";

/// A scenario with two failures.
const WRONG: &str = "title = \"<wrong> & wrong\"\ndevices = [\"pvea-canopen@0x20\"]\nsteps = [\n{ expect = \"720#01\", within_ms = 10 },\n\
                     { never = { powered = true }, for_ms = 1 },\n]\n";

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// Runs scenarios; returns the exit code and stdout.
fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let output = output(&[&["scenario"], arguments].concat());
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    (output.status.code(), String::from_utf8(output.stdout).expect("text"))
}

/// Writes files into a folder of their own.
fn files(texts: &[(&str, &str)]) -> (tempfile::TempDir, Vec<String>) {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = texts.iter().map(|(name, text)| {
        let path = folder.path().join(name);
        fs::write(&path, text).expect("a file");
        path.to_str().expect("text").to_owned()
    });
    let paths = paths.collect();
    (folder, paths)
}

#[test]
fn the_scenarios_of_the_repository_pass() {
    let found = fs::read_dir(repository("scenarios")).expect("the folder");
    let mut paths: Vec<String> = found.map(|file| file.expect("a file").path().display().to_string()).collect();
    paths.retain(|path| path.ends_with(".toml"));
    paths.sort();
    assert!(paths.len() >= 13, "{paths:?}");
    for path in &paths {
        let text = fs::read_to_string(path).expect("a scenario");
        assert!(text.starts_with("#:schema ../docs/scenario.schema.json\ntitle = "), "{path}");
    }
    for seed in ["1", "2", "18446744073709551615"] {
        let mut arguments: Vec<&str> = paths.iter().map(String::as_str).collect();
        arguments.extend(["--seed", seed]);
        let (code, told) = run(&arguments);
        assert_eq!(code, Some(0), "seed {seed}\n{told}");
        assert!(told.ends_with(&format!("{} passed, 0 failed\n", paths.len())), "{told}");
    }
}

/// Use case 2 reads like the manual.
#[test]
fn use_case_2_is_short() {
    let text = fs::read_to_string(repository("scenarios/use-case-2.toml")).expect("the scenario");
    assert!(text.lines().count() <= 30, "{text}");
}

#[test]
fn the_scenarios_of_the_guide_pass() {
    let page = fs::read_to_string(repository("docs/scenarios.md")).expect("the page");
    let blocks = page.split("```toml\n").skip(1).filter_map(|block| block.split("```").next());
    let whole: Vec<&str> = blocks.filter(|block| block.contains("steps")).collect();
    assert!(!whole.is_empty());
    for text in whole {
        let (_folder, paths) = files(&[("guide.toml", text)]);
        let (code, told) = run(&[&paths[0]]);
        assert_eq!(code, Some(0), "{text}\n{told}");
    }
}

#[test]
fn a_failure_is_exit_1_and_all_of_them_are_told_in_order() {
    let (_folder, paths) = files(&[("wrong.toml", WRONG), ("right.toml", RIGHT)]);
    let (code, told) = run(&[&paths[0], &paths[1], &paths[0]]);
    assert_eq!(code, Some(1));
    let lines: Vec<&str> = told.lines().filter(|line| line.starts_with("ok") || line.starts_with("FAIL")).collect();
    let starts =
        [format!("FAIL {}: <wrong>", paths[0]), format!("ok   {}: 1 step", paths[1]), format!("FAIL {}", paths[0])];
    assert!(lines.iter().zip(&starts).all(|(line, start)| line.starts_with(start)) && lines.len() == 3, "{told}");
    for line in [":4: expect 720: 01 within 10 ms: failed at ", ":5: never state"] {
        assert_eq!(told.matches(line).count(), 2, "{told}");
    }
    assert!(told.ends_with("1 passed, 2 failed\n"), "{told}");
}

#[test]
fn what_cannot_be_read_is_exit_2_before_anything_runs() {
    let (folder, paths) =
        files(&[("right.toml", RIGHT), ("empty.toml", ""), ("typo.toml", &RIGHT.replace("expect", "expct"))]);
    fs::write(folder.path().join("bytes.toml"), [0xFF, 0xFE]).expect("a file");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let junit = path("results.xml");
    for (name, said) in [
        ("empty.toml", ":1: no devices; add devices = "),
        ("typo.toml", ":2: unknown key 'expct'; did you mean 'expect'?; accepted: after_ms, "),
        ("none.toml", ": "),
        ("bytes.toml", ": "),
        ("", ": "),
    ] {
        let name = path(name);
        let text = refusal(&["scenario", &paths[0], &name, "--junit", &junit], 2);
        assert!(text.starts_with(&format!("pve-sim: {name}{said}")), "{text}");
    }
    assert!(!Path::new(&junit).exists());
    // Each unreadable file has its line.
    let output = output(&["scenario", &paths[1], &paths[0], &paths[2]]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0));
    assert_eq!(String::from_utf8(output.stderr).expect("text").lines().count(), 2);
}

#[test]
fn the_whole_trace_with_the_notes() {
    let (_folder, paths) = files(&[("right.toml", &RIGHT.replace("{ expect", "{ note = \"1. Power up\", expect"))]);
    let (code, told) = run(&["--verbose", &paths[0]]);
    assert_eq!(code, Some(0));
    let lines: Vec<&str> = told.lines().collect();
    assert_eq!(lines[0], "-- 1. Power up", "{told}");
    assert!(lines[1].contains(" ms  <-  720: 00") && lines[1].ends_with("pvea-canopen: boot-up"), "{told}");
    assert!(lines[2].starts_with("ok   ") && lines.len() == 4, "{told}");
}

#[test]
fn results_for_ci() {
    let (folder, paths) = files(&[("wrong.toml", WRONG), ("right.toml", RIGHT)]);
    let junit = folder.path().join("results.xml").display().to_string();
    let (code, _) = run(&["--junit", &junit, &paths[0], &paths[1]]);
    assert_eq!(code, Some(1));
    let text = fs::read_to_string(&junit).expect("the results");
    assert!(text.contains("tests=\"2\" skipped=\"0\" failures=\"1\" errors=\"0\""), "{text}");
    assert!(text.contains(&format!("<testcase name=\"{}\"", paths[1])), "{text}");
    assert!(text.contains(":4: expect 720: 01") && text.contains("; ") && text.contains(":5: never state"), "{text}");
    assert!(text.contains("&lt;-  720: 00"), "the frames before: {text}");
}

/// Neither a terminal nor an XML reader gets the control characters and noncharacters of a note.
#[test]
fn a_note_with_odd_characters_is_shown_escaped() {
    let odd = WRONG.replacen("{ expect", "{ note = \"red\\u001b[31m\\ufffe\", expect", 1);
    let (folder, paths) = files(&[("odd.toml", &odd)]);
    let junit = folder.path().join("results.xml").display().to_string();
    let (_, told) = run(&["--verbose", "--junit", &junit, &paths[0]]);
    assert_eq!(told.matches("-- red\\u{1b}[31m\\u{fffe}\n").count(), 2, "{told}");
    let text = fs::read_to_string(&junit).expect("the results");
    assert!(text.contains("-- red\\u{1b}[31m\\u{fffe}\n") && !text.contains('\u{FFFE}'), "{text}");
}

/// A terminal would obey the control characters of a file name, and XML cannot contain them.
#[cfg(unix)]
#[test]
fn file_names_are_escaped() {
    let (folder, paths) = files(&[("\u{1B}[31m wrong.toml", WRONG), ("\u{1B}[31m empty.toml", "")]);
    let (junit, escaped) = (folder.path().join("results.xml").display().to_string(), r"\u{1b}[31m");
    let (code, told) = run(&["--junit", &junit, &paths[0]]);
    assert_eq!(code, Some(1));
    for text in [told, fs::read_to_string(&junit).expect("the results")] {
        assert!(
            text.contains(&format!("{escaped} wrong.toml:4: expect 720: 01")) && !text.contains('\u{1B}'),
            "{text}"
        );
    }
    for arguments in [["scenario", &paths[1]], ["scenario", &format!("{}/none", paths[0])], ["decode", &paths[1]]] {
        let refused = output(&arguments);
        let text = String::from_utf8(refused.stderr).expect("text");
        assert!(text.contains(escaped) && !text.contains('\u{1B}') && text.lines().count() == 1, "{text:?}");
    }
}

#[test]
fn results_that_cannot_be_written_are_exit_1_with_one_line() {
    let (folder, paths) = files(&[("right.toml", RIGHT)]);
    let junit = folder.path().join("missing").join("results.xml").display().to_string();
    let output = output(&["scenario", &paths[0], "--junit", &junit]);
    let text = String::from_utf8(output.stderr).expect("text");
    assert_eq!(output.status.code(), Some(1));
    assert!(text.starts_with(&format!("pve-sim: --junit {junit}: ")) && text.lines().count() == 1, "{text}");
    // The results would overwrite a scenario.
    refusal(&["scenario", "--junit", &paths[0], &paths[0]], 2);
    assert_eq!(fs::read_to_string(&paths[0]).expect("the scenario"), RIGHT);
}

#[test]
fn two_runs_are_the_same_to_the_last_byte() {
    let (folder, mut paths) = files(&[("wrong.toml", WRONG), ("right.toml", RIGHT)]);
    paths = paths.iter().cycle().take(40).cloned().collect();
    let junit = folder.path().join("results.xml").display().to_string();
    let mut arguments: Vec<&str> = paths.iter().map(String::as_str).collect();
    arguments.extend(["--junit", &junit, "--seed", "7"]);
    let results = |_| (run(&arguments), fs::read_to_string(&junit).expect("the results"));
    let [one, other] = [0, 1].map(results);
    assert!(one == other);
    arguments.pop();
    arguments.push("8");
    assert!(run(&arguments).1 != one.0.1, "another seed is another start");
}

#[test]
fn a_reader_that_is_gone_changes_nothing() {
    let (_folder, paths) = files(&[("right.toml", RIGHT)]);
    let (mut child, _watch) = spawn(&mut pve_sim(&["scenario", &paths[0]]));
    drop(child.stdout.take());
    assert_eq!(child.wait().expect("its end").code(), Some(0));
}
