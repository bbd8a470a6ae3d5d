//! Plays the committed cases: what fuzzing found, and what reaches far into each attack.
use std::{fs, path::Path};

#[test]
fn every_case_keeps_the_promises() {
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases");
    for (name, attack) in fuzz::ATTACKS {
        let mut files: Vec<_> = fs::read_dir(cases.join(name)).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{name} has no case");
        for file in files {
            println!("{}", file.display());
            attack(&fs::read(file).unwrap());
        }
    }
}
