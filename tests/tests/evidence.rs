//! The two generated parts of docs/evidence.md: the assumptions of docs/behaviour.md, and the tests of each of its
//! sections, by the marks "SPEC 4.4" in the tests.
//!
//! `RENEW_GOLDEN=1 cargo test -p tests --test evidence` writes them anew and fails; the next run passes.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

const PAGE: &str = "docs/evidence.md";
/// The folders that tests are in, within each of which `is_test` selects the files.
const ROOMS: [&str; 7] =
    ["tests/tests", "tests/golden", "tests/firmware-in-the-loop/tests", "protocol-core", "nvm", "hal-sim", "pve-sim"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A numbered section of the behaviour page that has no numbered sections within it.
struct Section {
    number: String,
    heading: String,
    text: String,
}

/// Returns the numbered sections. The text before the first numbered heading of a chapter belongs to the chapter alone.
fn sections(page: &str) -> Vec<Section> {
    let mut sections: Vec<Section> = Vec::new();
    for line in page.lines() {
        let heading = line.trim_start_matches('#');
        let number = heading.split_whitespace().next().unwrap_or_default().trim_end_matches('.');
        let is_numbered = line.starts_with('#') && number.starts_with(|c: char| c.is_ascii_digit());
        if is_numbered {
            sections.push(Section { number: number.into(), heading: heading.trim().into(), text: String::new() });
        } else if let Some(section) = sections.last_mut() {
            section.text += &format!("{line}\n");
        }
    }
    let numbers: Vec<String> = sections.iter().map(|section| format!("{}.", section.number)).collect();
    let is_whole = |section: &Section| {
        !numbers.iter().any(|number| {
            number.starts_with(&format!("{}.", section.number)) && number.len() > section.number.len() + 1
        })
    };
    sections.retain(is_whole);
    sections
}

impl Section {
    fn link(&self) -> String {
        let kept = self.heading.to_lowercase();
        let kept = kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        let anchor: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        format!("[{}](behaviour.md#{anchor})", self.heading)
    }

    /// Returns the sentences and table rows with the mark (A).
    fn assumptions(&self) -> Vec<String> {
        let (mut found, mut prose, mut object, mut heading) = (Vec::new(), String::new(), String::new(), String::new());
        for line in self.text.lines().chain([""]) {
            let line = line.trim();
            let known = found.len();
            let begins = line.is_empty() || line.starts_with(['|', '#']) || line.starts_with("- ");
            if begins {
                found.extend(sentences(&std::mem::take(&mut prose)));
            }
            if let Some(row) = line.strip_prefix('|') {
                let mut cells: Vec<&str> = row.trim_end_matches('|').split('|').map(str::trim).collect();
                // A sub-index stands below its object.
                if cells[0].is_empty() {
                    cells[0] = &object;
                }
                found.push(
                    cells.iter().filter(|cell| !["", "–"].contains(cell)).copied().collect::<Vec<_>>().join(", "),
                );
                object = cells[0].to_owned();
            } else {
                prose += &format!("{} ", line.trim_start_matches("- "));
            }
            found[known..].iter_mut().for_each(|text| text.insert_str(0, &heading));
            if line.starts_with('#') {
                heading = format!("*{}*: ", line.trim_start_matches('#').trim());
                prose.clear();
            }
        }
        found.retain(|text| text.contains("(A)"));
        found
    }
}

/// Splits prose at each full stop before a blank and the beginning of a sentence.
fn sentences(prose: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    for part in prose.split_inclusive(". ") {
        let is_new = part.starts_with(|c: char| c.is_uppercase() || c.is_ascii_digit() || "`*[".contains(c));
        if is_new {
            found.push(String::new());
        }
        found.last_mut().expect("at least one").push_str(part);
    }
    found.into_iter().map(|sentence| sentence.trim().to_owned()).collect()
}

/// Returns the Rust files with tests in a folder, this one aside.
fn tests(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() && !path.ends_with("target") {
            found.extend(tests(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") && is_test(&path) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Returns whether a file holds tests, and nothing that runs outside of them.
fn is_test(path: &Path) -> bool {
    let name = path.strip_prefix(root()).expect("a file of the repository").with_extension("");
    let is_in_tests = name.components().any(|part| ["tests", "golden"].contains(&&*part.as_os_str().to_string_lossy()));
    let is_named_so = name.to_string_lossy().ends_with("tests");
    let is_own = name.ends_with("tests/evidence");
    (is_in_tests || is_named_so) && !is_own && fs::read_to_string(path).expect("text").contains("#[test]")
}

/// Returns the numbers behind each "SPEC" of a text: `SPEC 2, 4.4` and `SPEC 5–7`.
fn marks(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for list in text.split("SPEC ").skip(1) {
        for item in list.split(", ") {
            let end = item.find(|c: char| !(c.is_ascii_digit() || ".–".contains(c))).unwrap_or(item.len());
            let (number, is_last) = (item[..end].trim_end_matches('.'), end < item.len());
            match number.split_once('–') {
                Some((first, last)) => {
                    let (first, last): (u32, u32) = (first.parse().expect("a number"), last.parse().expect("a number"));
                    found.extend((first..=last).map(|number| number.to_string()));
                }
                None if !number.is_empty() => drop(found.insert(number.to_owned())),
                None => {}
            }
            if is_last {
                break;
            }
        }
    }
    found
}

/// Returns the files by the sections that they are marked with.
fn tests_by_section() -> BTreeMap<String, Vec<String>> {
    let root = root();
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for path in ROOMS.iter().flat_map(|room| tests(&root.join(room))) {
        let name = path.strip_prefix(&root).expect("a file of the repository").to_string_lossy().replace('\\', "/");
        for number in marks(&fs::read_to_string(&path).expect("text")) {
            found.entry(number).or_default().push(name.clone());
        }
    }
    // Files of a folder stand together.
    found
        .values_mut()
        .for_each(|files| files.sort_by_key(|file| file.rsplit_once('/').map(|(a, b)| (a.to_owned(), b.to_owned()))));
    found
}

/// Writes files as their folders, each with its files.
fn by_folder(files: &[String]) -> String {
    let mut folders: Vec<(&str, Vec<&str>)> = Vec::new();
    for file in files {
        let (folder, name) = file.trim_end_matches(".rs").rsplit_once('/').expect("a folder");
        match folders.last_mut() {
            Some((last, names)) if *last == folder => names.push(name),
            _ => folders.push((folder, vec![name])),
        }
    }
    let folders = folders.iter().map(|(folder, names)| format!("`{folder}/`: {}", names.join(", ")));
    folders.collect::<Vec<_>>().join("<br>")
}

/// Puts a text into the page, between the two lines that name it.
fn put(page: &str, name: &str, text: &str) -> String {
    let (begin, end) = (format!("<!-- {name}: generated -->\n"), format!("<!-- end of {name} -->"));
    let (before, rest) = page.split_once(&begin).unwrap_or_else(|| panic!("{PAGE} lacks {begin}"));
    let (_, after) = rest.split_once(&end).unwrap_or_else(|| panic!("{PAGE} lacks {end}"));
    format!("{before}{begin}\n{text}\n{end}{after}")
}

#[test]
fn every_section_has_tests_and_the_page_lists_them() {
    let behaviour = fs::read_to_string(root().join("docs/behaviour.md")).expect("the page");
    let tests = tests_by_section();
    let sections = sections(&behaviour);
    assert!(sections.len() > 10, "only {} sections were found", sections.len());

    let untested: Vec<&str> =
        sections.iter().map(|section| &*section.number).filter(|n| !tests.contains_key(*n)).collect();
    assert!(untested.is_empty(), "no test has a mark \"SPEC {}\"", untested.join("\" or \"SPEC "));
    let is_known =
        |number: &str| behaviour.contains(&format!("# {number} ")) || behaviour.contains(&format!("# {number}. "));
    let foreign: Vec<_> = tests.iter().filter(|(number, _)| !is_known(number)).collect();
    assert!(foreign.is_empty(), "docs/behaviour.md lacks the sections of these marks: {foreign:?}");

    let mut table = String::from("| section | tests |\n| --- | --- |\n");
    let mut assumed = String::new();
    for section in &sections {
        table += &format!("| {} | {} |\n", section.link(), by_folder(&tests[&section.number]));
        let assumptions = section.assumptions();
        if !assumptions.is_empty() {
            let list = assumptions.iter().map(|text| format!("- {}\n", text.replace("](#", "](behaviour.md#")));
            assumed += &format!("**{}**\n\n{}\n", section.link(), list.collect::<String>());
        }
    }
    // Each mark of the page is on the list, the one in the legend aside.
    let marked = behaviour.split_once("\n## 1.").expect("a section 1").1.matches("(A)").count();
    assert_eq!(assumed.matches("(A)").count(), marked, "assumptions that the list misses");

    let path = root().join(PAGE);
    let page = fs::read_to_string(&path).expect("the page");
    let renewed = put(&put(&page, "assumptions", assumed.trim_end()), "tests", table.trim_end());
    if page != renewed {
        let renew = std::env::var_os("RENEW_GOLDEN").is_some();
        if renew {
            fs::write(&path, &renewed).expect("a page that can be written");
        }
        let done = if renew { "is renewed: see git diff" } else { "is out of date: RENEW_GOLDEN=1 renews it" };
        let (old, new) = page.lines().zip(renewed.lines()).find(|(old, new)| old != new).unwrap_or_default();
        panic!("{PAGE} {done}\n- {old}\n+ {new}");
    }
}

#[test]
fn marks_are_read_as_they_are_written() {
    let read = |text| marks(text).into_iter().collect::<Vec<_>>().join(" ");
    assert_eq!(read("(SPEC 4.2; CiA 301 7.2.4) and SPEC 9."), "4.2 9");
    assert_eq!(read("(SPEC 2, 4.5, 6), SPEC 5–7"), "2 4.5 5 6 7");
    assert_eq!(read("SPEC sheet, 3"), "");
}
