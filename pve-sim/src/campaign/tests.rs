//! Results files and reports of invented rows.

use std::fs;
use std::path::{Path, PathBuf};

use hal_sim::campaign::Verdict;

use super::manifest::{FORMAT, LimitsUs, Manifest};
use super::merge::{MergeOptions, merge};
use super::reports::{Reports, report};
use super::results::{Cell, Row, Writer};

fn manifest(rows: usize) -> Manifest {
    Manifest {
        format: FORMAT,
        version: "0.1.0".to_owned(),
        commit: None,
        plan: "it's a.toml".to_owned(),
        plan_hash: "0123456789abcdef".to_owned(),
        title: "</script> & \"title\"".to_owned(),
        seeds: vec![1],
        seed: Some(1),
        shard: None,
        rows,
        limits: LimitsUs { detected_us: Some(100_000), safe_us: Some(200_000), observe_us: 600_000 },
        forked: true,
        machine: "linux x86_64, 2 cores".to_owned(),
        missing: None,
    }
}

/// Returns a row of this many grid cells and a last cell of the refinement, which is late.
fn row(row: usize, cells: usize) -> Row {
    let cell = |place: usize| Cell {
        number: (place < cells).then_some((row * cells + place) as u64),
        at_us: if place < cells { place as u64 * 10_000 } else { cells as u64 * 10_000 - 1_000 },
        verdict: if place < cells { Verdict::Safe } else { Verdict::Late },
        detected_us: Some(123_456),
        safe_us: (place < cells).then_some(999_999),
        struck: 3,
    };
    let trace = "     0.268 ms  <-  720: 00   valve: boot-up\n".repeat(200);
    let fault = format!("lose 220, count {row}");
    let reference = Some("a, \"b\"".to_owned());
    Row { row, fault, reference, seed: 1, worst: cells, trace, cells: (0..=cells).map(cell).collect() }
}

fn written(path: &Path, manifest: &Manifest, rows: &[Row]) -> String {
    let mut writer = Writer::create(path, manifest).expect("a file");
    rows.iter().for_each(|row| writer.append(row).expect("a row"));
    fs::read_to_string(path).expect("text")
}

fn folder() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_owned();
    (folder, move |name| path.join(name))
}

#[test]
fn a_torn_file_goes_on_behind_its_last_complete_row() {
    let (_folder, path) = folder();
    let short = |mut row: Row| {
        row.trace.truncate(45);
        row
    };
    let (manifest, rows) = (manifest(3), [row(0, 2), row(1, 2), row(2, 2)].map(short));
    let whole = written(&path("whole"), &manifest, &rows);
    let starts: Vec<usize> = whole.match_indices("{\"row\":{").map(|(place, _)| place).collect();
    // The file may end within its manifest.
    for length in ("{\"manifest\":".len()..whole.len()).step_by(7) {
        fs::write(path("torn"), &whole[..length]).expect("a file");
        let (mut writer, done) = Writer::resume(&path("torn"), &manifest).expect("results");
        let complete = starts.iter().filter(|start| **start <= length).count().saturating_sub(1);
        assert_eq!(done, (0..complete).collect(), "{length}");
        rows[complete..].iter().for_each(|row| writer.append(row).expect("a row"));
        drop(writer);
        assert!(fs::read_to_string(path("torn")).expect("text") == whole, "{length}");
        fs::write(path("torn"), &whole[..length]).expect("a file");
        assert!(written(&path("torn"), &manifest, &rows) == whole, "{length}");
    }
}

#[test]
fn a_results_file_has_one_writer() {
    let (_folder, path) = folder();
    let ours = manifest(1);
    for second in [Writer::create, |path: &Path, ours: &Manifest| Writer::resume(path, ours).map(|(writer, _)| writer)]
    {
        let mut first = Writer::create(&path("results"), &ours).expect("a file");
        let refused = second(&path("results"), &ours).map(drop).expect_err("the first writer is there").to_string();
        assert!(refused.ends_with("another pve-sim is writing to this file; use another --results"), "{refused}");
        first.append(&row(0, 2)).expect("a row");
        let text = fs::read_to_string(path("results")).expect("text");
        assert_eq!(text.matches("{\"row\":{").count(), 1, "{text}");
        drop(first);
        assert!(second(&path("results"), &ours).is_ok());
    }
}

#[test]
fn other_files_are_not_replaced_and_other_results_not_resumed() {
    let (_folder, path) = folder();
    let ours = manifest(3);
    for text in ["a", "{}\n", "{\"manifest\":{}}\n", "\u{0}"] {
        fs::write(path("other"), text).expect("a file");
        assert!(Writer::create(&path("other"), &ours).is_err());
        assert!(Writer::resume(&path("other"), &ours).is_err());
        assert_eq!(fs::read_to_string(path("other")).expect("text"), text);
    }
    written(&path("results"), &ours, &[row(0, 2)]);
    let shard = Some("1/2".parse().expect("a shard"));
    let others = [
        Manifest { plan_hash: "fedcba9876543210".to_owned(), ..ours.clone() },
        Manifest { version: "0.2.0".to_owned(), ..ours.clone() },
        Manifest { shard, ..ours.clone() },
        Manifest { seeds: vec![2], ..ours.clone() },
    ];
    for other in others {
        let error = Writer::resume(&path("results"), &other).expect_err("another campaign").to_string();
        assert!(error.contains("these results differ in plan, version, seed, shard or --no-fork"), "{error}");
    }
    assert!(Writer::resume(&path("results"), &Manifest { machine: "another".to_owned(), ..ours.clone() }).is_ok());
    fs::write(path("results"), fs::read_to_string(path("results")).expect("text").replace("struck", "struk"))
        .expect("a file");
    let error = Writer::resume(&path("results"), &ours).expect_err("a damaged line").to_string();
    assert!(error.contains("results: line 2: "), "{error}");
}

#[test]
fn shards_merge_to_the_whole_and_missing_rows_are_named() {
    let (_folder, path) = folder();
    let rows: Vec<Row> = (0..10).map(|number| row(number, 3)).collect();
    let whole = written(&path("whole"), &manifest(10), &rows);
    let mut files = Vec::new();
    for part in 1..=4 {
        let shard: super::manifest::Shard = format!("{part}/4").parse().expect("a shard");
        let own: Vec<Row> = rows.iter().filter(|row| shard.has(row.row)).cloned().collect();
        files.push(path(&format!("part {part}")));
        written(&files[part - 1], &Manifest { shard: Some(shard), ..manifest(10) }, &own);
    }
    let merged = |files: &[PathBuf]| {
        let results = Some(path("merged"));
        let mut told = Vec::new();
        let options = MergeOptions { files: files.to_vec(), results, reports: Reports::default() };
        let passed = merge(&options, &mut told).map_err(|error| error.to_string());
        (passed, String::from_utf8(told).expect("text"))
    };
    // Each row has a cell that is late.
    let (passed, told) = merged(&[&files[..], &files[..1]].concat());
    assert_eq!(passed, Ok(false));
    assert!(told.ends_with("30 of 30 injected faults detected\n30 passed, 10 failed\n"), "{told}");
    assert!(fs::read_to_string(path("merged")).expect("text") == whole);
    let (passed, told) = merged(&files[..3]);
    assert_eq!(passed, Ok(false));
    assert!(told.contains("\nmissing: 2 of 10 rows, with all their cells: 3, 7\n"), "{told}");

    written(&files[1], &Manifest { plan_hash: String::new(), ..manifest(10) }, &[]);
    let (refused, _) = merged(&files);
    assert!(
        refused.expect_err("another plan").contains("these results differ in plan, version, seed or --no-fork from ")
    );
    written(&files[1], &manifest(10), &[Row { seed: 2, ..rows[4].clone() }]);
    let (refused, _) = merged(&files);
    assert!(refused.expect_err("another row").contains("row 4 is different in another file"));
}

#[test]
fn rows_that_do_not_belong_to_a_file_are_refused() {
    let (_folder, path) = folder();
    let rows: Vec<Row> = (0..4).map(|number| row(number, 2)).collect();
    let shard = Some("1/2".parse().expect("a shard"));
    for (manifest, order, number) in [
        (manifest(4), [0, 1, 1].as_slice(), 1),
        (manifest(4), [2, 1].as_slice(), 1),
        (manifest(3), [0, 3].as_slice(), 3),
        (Manifest { shard, ..manifest(4) }, [0, 1].as_slice(), 1),
    ] {
        let rows: Vec<Row> = order.iter().map(|number| rows[*number].clone()).collect();
        written(&path("edited"), &manifest, &rows);
        let error = Writer::resume(&path("edited"), &manifest).expect_err("a foreign row").to_string();
        assert!(error.contains(&format!("row {number} does not belong here")), "{error}");
        let options = MergeOptions { files: vec![path("edited")], results: None, reports: Reports::default() };
        assert!(merge(&options, &mut Vec::new()).is_err(), "{order:?}");
    }
}

/// Whoever turns the worst verdict of a row into a better one forgets the index of the worst cell.
#[test]
fn a_better_verdict_than_that_of_the_worst_cell_is_refused() {
    let (_folder, path) = folder();
    let text = written(&path("results"), &manifest(1), &[row(0, 2)]);
    fs::write(path("results"), text.replace("\"late\"", "\"no-effect\"")).expect("a file");
    let options = MergeOptions { files: vec![path("results")], results: None, reports: Reports::default() };
    let error = merge(&options, &mut Vec::new()).expect_err("an edited verdict").to_string();
    assert!(error.contains("results: line 2: cell 2 is not the worst cell of row 0"), "{error}");
}

#[test]
fn a_missing_row_fails_in_each_report() {
    let (_folder, path) = folder();
    written(&path("part"), &manifest(2), &[Row { cells: row(0, 2).cells[..2].to_vec(), worst: 0, ..row(0, 2) }]);
    let file = |name: &str| Some(path(name));
    let reports = Reports { html: None, csv: None, json: file("json"), junit: file("junit") };
    let mut told = Vec::new();
    let options = MergeOptions { files: vec![path("part")], results: None, reports };
    assert_eq!(merge(&options, &mut told).map_err(|error| error.to_string()), Ok(false));
    let read = |name: &str| fs::read_to_string(path(name)).expect("text");
    assert!(String::from_utf8_lossy(&told).contains("missing: 1 of 2 rows, with all their cells: 1\n"));
    assert!(read("json").contains("\"missing\":\"1 of 2 rows"));
    let junit = read("junit");
    assert!(
        junit.contains("tests=\"2\" skipped=\"0\" failures=\"1\"") && junit.contains("missing: 1 of 2 rows"),
        "{junit}"
    );
}

#[test]
fn cells_without_their_fault_are_counted() {
    for (count, told) in [
        (1, "1 cell proves nothing: its fault was not injected\n"),
        (2, "2 cells prove nothing: their faults were not injected\n"),
    ] {
        let mut nothing = row(0, count);
        nothing.cells.iter_mut().for_each(|cell| cell.verdict = Verdict::NotInjected);
        let reports = Reports { html: None, csv: None, json: None, junit: None };
        let mut summary = Vec::new();
        let passed = report(&manifest(1), &reports, || Ok([nothing.clone()].map(Ok).into_iter()), &mut summary);
        assert_eq!(passed.map_err(|error| error.to_string()), Ok(false));
        let summary = String::from_utf8(summary).expect("text");
        assert!(summary.contains(told), "{summary}");
    }
}

/// Reports of a campaign; returns the files by their options.
fn reports(rows: &[Row]) -> [String; 4] {
    let (_folder, path) = folder();
    let file = |name: &str| Some(path(name));
    let reports = Reports { html: file("html"), csv: file("csv"), json: file("json"), junit: file("junit") };
    let passed = report(&manifest(rows.len()), &reports, || Ok(rows.iter().cloned().map(Ok)), &mut Vec::new());
    assert_eq!(passed.map_err(|error| error.to_string()), Ok(false));
    ["html", "csv", "json", "junit"].map(|name| fs::read_to_string(path(name)).expect("text"))
}

#[test]
fn ten_thousand_cells_are_a_page_below_a_megabyte() {
    for (count, cells) in [(20, 500), (500, 20), (2000, 5)] {
        let rows: Vec<Row> = (0..count).map(|number| row(number, cells)).collect();
        let [page, ..] = reports(&rows);
        println!("{count} faults at {cells} instants: {} bytes", page.len());
        assert!(page.len() < 1_000_000, "{count} {}", page.len());
    }
}

#[test]
fn the_page_is_one_file_whatever_the_names() {
    let [page, ..] = reports(&[row(0, 5)]);
    assert_eq!(page.matches("</script>").count(), 2, "{page}");
    assert!(page.contains("\\u003c/script> & \\\"title\\\""), "{page}");
    let data = page.split_once("id=\"data\">").and_then(|(_, rest)| rest.split_once("</script>")).expect("the data").0;
    let data: serde_json::Value = serde_json::from_str(data).expect("JSON");
    assert_eq!(data["rows"][0]["verdicts"], "sssss");
    assert_eq!(data["rows"][0]["grid"], serde_json::json!([0, 10_000, 5]));
    assert_eq!(data["rows"][0]["refined"], serde_json::json!([[49_000, "l", 123_456, null]]));
    for needle in ["http://", "https://", "src=", "url("] {
        assert!(!page.replace("http://www.w3.org/2000/svg", "").contains(needle), "{needle}");
    }
}

#[test]
fn tables_and_documents_have_all_cells() {
    let [_, csv, json, junit] = reports(&[row(0, 2), row(1, 2)]);
    let lines: Vec<&str> = csv.split("\r\n").collect();
    assert_eq!(lines.len(), 8, "{csv}");
    assert!(lines[0].starts_with("row,cell,refined,fault,reference,seed,at_us,verdict,"), "{csv}");
    assert_eq!(
        lines[6],
        "1,,true,\"lose 220, count 1\",\"a, \"\"b\"\"\",1,19000,late,false,123456,,123456,3,0.1.0,,it's a.toml,\
         0123456789abcdef,\"linux x86_64, 2 cores\""
    );
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["manifest"]["plan_hash"], "0123456789abcdef");
    assert_eq!(json["rows"][1]["cells"][2]["verdict"], "late");
    assert!(junit.contains("tests=\"2\" skipped=\"0\" failures=\"2\""), "{junit}");
    assert!(
        junit
            .contains("reproduce: pve-sim campaign &apos;it&apos;\\&apos;&apos;s a.toml&apos; --seed 1 --cell 1@19000"),
        "{junit}"
    );
}
